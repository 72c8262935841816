"""What the benchmarks of the plates share: watching Newton's iterations from outside."""

from __future__ import annotations

from meso import kernels

from ._profile import Watch


def newton_iterations() -> Watch:
    """The Newton iterations of every increment tried inside the block."""
    return Watch(kernels, "solve_increment", lambda arguments, result: int(result[0]))
