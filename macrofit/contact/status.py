"""Status of a facet of the seat."""

from __future__ import annotations

OPEN, STICK, SLIP = 0, 1, 2
"""Status of a facet."""
