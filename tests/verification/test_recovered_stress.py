"""Stress at the nodes on 1 mm facets against 0.5 mm, where the run's is largest: see `benchmarks.recovery`."""

from __future__ import annotations

from benchmarks.recovery import BODIES, compared, run
from found import Found

DEEP = {"axle": 0.02, "wheel": 0.005}
"""Largest differences below the surface, of its largest stress; at the Gauss points the elements give 0.7 %."""


def test_stress_below_the_surface_and_on_it(found: Found) -> None:
    (coarse, bodies), (reference, fine) = (run(facet, [22.0]) for facet in (1.0, 0.5))
    for name in BODIES:
        result = compared(coarse, bodies[name], reference, fine[name], 22.0)
        assert found(f"recovered stress of the {name}, 0.3 to 8 mm deep, over its largest", result.deep[0], DEEP[name])
        assert found(f"recovered stress on the surface of the {name}, over its largest", result.line[0], 0.025)
        assert result.away[0] < result.line[0]
