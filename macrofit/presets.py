"""How fine a scene is meshed, in one word: what a preset does to the scene's own sizes, its error and its cost."""

from __future__ import annotations

from typing import NamedTuple


class Preset(NamedTuple):
    """Factors on the sizes that a scene gives or has by default, and what came of them for `wheelset`.

    The last three are measured by `python -m tests.benchmarks work_precision`, which compares them with what it finds.
    """

    facet: float  # times mesh.seat_facet, and mesh.bore_facet where it is given
    corner: float  # times mesh.seat_facet; where mesh.corner_facet is given, that times this over balanced's
    growth: float  # times mesh.growth
    force_error: float  # bound of the largest along the fitting curve, over its peak
    stress_error: float  # bound of that of the largest von Mises stress, the worse body
    cpu_s: float  # of 180 increments, beyond imports; of one machine

    def __str__(self) -> str:
        """Its errors and cost, for people."""
        force = f"{self.force_error:.0e}".replace("e-0", "e-")
        return f"force {force}, stress {100 * self.stress_error:.2g} %, {self.cpu_s:.2g} s"


PRESETS = {
    "fast": Preset(facet=3.0, corner=1.0, growth=1.0, force_error=8e-4, stress_error=12e-3, cpu_s=0.45),
    "balanced": Preset(facet=1.0, corner=0.5, growth=1.0, force_error=2e-4, stress_error=4e-3, cpu_s=1.1),
    "accurate": Preset(facet=0.5, corner=0.25, growth=0.5, force_error=4e-5, stress_error=5e-3, cpu_s=3.6),
}


def summary() -> str:
    """One line for help texts: every preset with its error and cost."""
    return "; ".join(f"{name}: {preset}" for name, preset in PRESETS.items())
