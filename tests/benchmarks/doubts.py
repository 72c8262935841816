"""How wrong does a run get, and is it said? The thresholds of the doubts, measured

    python -m tests.benchmarks doubts

Two hubs of 60 mm: that of `wheelset` (blends of 150 mm: arcs of 15 mm) without web, and the README's (arcs of 5 and
8 mm). Each row changes one thing. The force, at the end and at most along the curve, and the larger error of the two
bodies' peak stresses are held against the same hub with corner facets of 0.125 mm; "said" are the kinds of doubts.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from ._measure import head, row

STEEL = 206e3
HUBS: dict[str, dict[str, Any]] = {
    "wheelset's": {
        "axle": {"seat_radius": 95.0, "seat_length": 60.0, "taper_length": 10.0, "taper_height": 1.0,
                 "taper_blend": 150.0, "lead_length": 40.0, "tail_length": 100.0},
        "wheel": {"bore_radius": 94.7, "hub_length": 60.0, "hub_outer_radius": 152.0, "chamfer_length": 10.0,
                  "chamfer_height": 1.0, "chamfer_blend": 150.0},
        "friction": {"options": {"coefficient": 0.11}},
    },
    "README's": {
        "axle": {"seat_radius": 50.0, "seat_length": 60.0, "taper_length": 8.0, "taper_height": 0.4,
                 "taper_blend": 100.0, "tail_length": 50.0},
        "wheel": {"bore_radius": 49.95, "hub_length": 60.0, "hub_outer_radius": 90.0, "chamfer_length": 5.0,
                  "chamfer_height": 0.5, "chamfer_blend": 80.0},
        "friction": {"options": {"coefficient": 0.12}},
    },
}  # fmt: skip
FINE = {"mesh.corner_facet": 0.125}


def cases(quick: bool) -> Iterator[tuple[str, dict[str, Any]]]:
    """What is changed, in words and as keys of a scene."""
    yield "nothing", {}
    for facet in (20.0,) if quick else (2.0, 3.0, 4.0, 5.0, 6.0, 10.0, 20.0):
        yield f"facets of {facet:g} mm", {"mesh.seat_facet": facet}
    for step in (15.0,) if quick else (2.5, 5.0, 7.5, 15.0):
        yield f"steps of {step:g} mm", {"motion.increment": step, **FINE}
    for gamma0 in (0.1,) if quick else (1.0, 0.3, 0.1):
        yield f"gamma0 = {gamma0:g}", {"contact.gamma0": gamma0, **FINE}
    for stiff in (0.1,) if quick else (10.0, 1.0, 0.1):
        keys = {"contact.formulation": "penalty", "contact.penalty_stiffness": stiff * STEEL, **FINE}
        yield f"penalty of {stiff:g} E per mm", keys
    for ratio in () if quick else (0.3, 0.45, 0.49, 0.499):
        keys = {f"{body}.material": {"poisson_ratio": ratio} for body in ("axle", "wheel")}
        yield f"Poisson's ratio {ratio:g}, order 1", {**keys, "mesh.order": 1}
    yield "sharp corners", {"axle.taper_blend": 0.0, "wheel.chamfer_blend": 0.0}


def solved(hub: str, keys: dict[str, Any]) -> Any:
    """The solution of a hub with some keys changed."""
    from macrofit.scene import build_scene
    from macrofit.solve import solve

    tables = {name: dict(table) for name, table in HUBS[hub].items()}
    tables |= {"motion": {"travel": 55.0, "increment": 1.0}, "mesh": {}, "contact": {}, "output": {"fields_at": []}}
    for key, value in keys.items():
        table, _, name = key.partition(".")
        tables[table][name] = value
    return solve(build_scene(tables))


def compared(found: Any, reference: Any) -> list[str]:
    """Errors of force and stress, interpenetration, energy balance, and what was said."""
    from macrofit.results.doubts import doubts, interpenetration

    curve = np.interp(found.displacement, reference.displacement, reference.force)
    end, most = found.force[-1] / curve[-1] - 1.0, np.abs(found.force - curve).max() / curve.max()
    stress = [found.max_von_mises[body].value / at.value - 1.0 for body, at in reference.max_von_mises.items()]
    said = "; ".join(sorted({sentence.partition(":")[0] for sentence in doubts(found)})) or "nothing"
    return [f"{100 * end:+.2f} %", f"{100 * most:.1f} %", f"{100 * max(stress, key=abs):+.1f} %",
            f"{interpenetration(found):.1e}", f"{found.energy_balance:.1e}", said]  # fmt: skip


def main(arguments: Sequence[str]) -> int:
    """Print a table for each hub."""
    parser = argparse.ArgumentParser(prog="doubts", description=__doc__)
    parser.add_argument("--quick", action="store_true", help="a few rows of one hub")
    quick = parser.parse_args(arguments).quick
    for hub in list(HUBS)[: 1 if quick else None]:
        print(f"\n{hub} hub\n")
        print(head("changed", "force", "curve", "peak stress", "interpenetration", "energy balance", "said"))
        references: dict[Any, Any] = {}
        for words, keys in cases(quick):
            materials = {key: value for key, value in keys.items() if key.endswith("material")}
            if str(materials) not in references:
                references[str(materials)] = solved(hub, materials | FINE)
            print(row(words, *compared(solved(hub, keys), references[str(materials)])), flush=True)
    return 0
