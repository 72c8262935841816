"""How stiff are plates and cubes of spheres, before their beams are scaled and after, and what does it change?

    python -m tests.benchmarks meso_modulus [--packings 3] [--quick]

First table: Young's modulus over the material's, mean and standard deviation over packings: with the beams as they were
calibrated (cubes of 2000 spheres), and scaled. Plates, 1 x 1 mm, are pulled through the thickness by a direct solve of
their own: free at the ends and on Diamond-Square surfaces (R = 0, 20, 40 um), or held at the ends, over the free one;
and pressed as one on their bars, over the steel cube that both stand for. Cubes are tested as `calibrate` does. Last
column: CPU milliseconds of making a lattice and finding its factor.
Second table: change of the meso coefficient over pairs of surfaces, by plates of both sizes.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import replace

import msgspec
import numpy as np
import numpy.typing as npt
from scipy.sparse import diags

from meso.calibrate import tensile_test
from meso.friction_test import run
from meso.lattice.calibration import steel
from meso.lattice.cholmod import factor
from meso.lattice.lattice import BACK, Lattice, build
from meso.lattice.modulus import STRAIN, scaled_to
from meso.material import Material
from meso.packing.cache import flat_packing
from meso.packing.pack import Packing, morph
from meso.settings import load
from meso.surfaces.surface import diamond_square, face_generator

from ._measure import cpu, head, row

MATERIAL = Material()
STEEL = MATERIAL.youngs_modulus
CUBE = 1.0
PLATES = ((0.4, 300), (0.4, 500), (0.4, 1000), (0.3, 1000), (0.4, 3000), (0.4, 12_000))
CUBES = (300, 1000, 3000, 12_000)
HEIGHTS = (0.0, 0.02, 0.04)
SLIDES = (("500, 0.4 mm", ("plates.spheres=500", "plates.thickness=0.4")),
          ("1000, 0.4 mm", ("plates.spheres=1000", "plates.thickness=0.4")),
          ("3000, 0.3 mm", ()))  # fmt: skip
BoolArray = npt.NDArray[np.bool_]


def pulled(packing: Packing, lattice: Lattice, *, held: bool = False) -> float:
    """Modulus of a plate through its thickness over the material's [-], its ends free sideways or held.

    Not the way of `meso.lattice.modulus`: the stiffness is factored.
    """
    top = packing.thickness + packing.surface.at(*packing.centres[:, :2].T)
    z, reach = packing.centres[:, 2], BACK * packing.radii
    front, ends = top - z < reach, (z < reach) | (top - z < reach)
    fixed: BoolArray = np.zeros((lattice.nodes, 6), dtype=np.bool_)
    fixed[ends] = [held, held, True, held, held, held]
    fixed[z.argmin(), :2] = fixed[packing.centres[:, 0].argmax(), 1] = True
    u = np.zeros((lattice.nodes, 6))
    u[ends, 2] = STRAIN * z[ends]
    free, flat = diags((~fixed).astype(float).ravel()), fixed.ravel()
    K = replace(lattice, anchored=lattice.anchored[:0], anchors=lattice.anchors[:0]).stiffness()
    found = factor(free @ K @ free + diags(flat.astype(float))).solve(np.where(flat, u.ravel(), -(K @ u.ravel())))
    force = (K @ found).reshape(-1, 6)[front, 2].sum()
    return float(force / np.prod(packing.size) / STRAIN / STEEL)


def pressed(packing: Packing, lattice: Lattice) -> float:
    """Stiffness of a plate on its bars, its front moved as one, over that of the steel cube [-]."""
    gap = packing.thickness - packing.centres[:, 2]
    front = np.flatnonzero(gap < BACK * packing.radii)
    compliance = factor(lattice.stiffness(), last=front).compliance()[2::6, 2::6]
    stiffness = np.linalg.solve(compliance, np.ones(len(front))).sum()
    return float(stiffness * (CUBE - gap[front].mean()) / (STEEL * np.prod(packing.size)))


def bare(packing: Packing, *, cube: float | None = None) -> Lattice:
    """The lattice with the beams as they were calibrated."""
    return build(packing, MATERIAL, steel(), cube=cube)


def plate_row(thickness: float, spheres: int, packings: int) -> str:
    """The first table's row of plates."""
    before, on_bars, ratio, times = [], [], [], []
    after: list[list[float]] = []
    for seed in range(packings):
        flat = flat_packing(spheres, (CUBE, CUBE), thickness, seed)
        rng = face_generator("wheel", seed)
        rough = [
            morph(flat, diamond_square(rng, levels=3, max_height=height, hurst_exponent=0.8, size=flat.size))
            for height in HEIGHTS
        ]
        before.append(pulled(flat, bare(flat)))
        cost, scaled = cpu(lambda flat=flat: scaled_to(STEEL, flat, bare(flat, cube=CUBE)), repeats=1)  # type: ignore[misc]
        times.append(1e3 * cost.median)
        on_bars.append(pressed(flat, scaled))
        ratio.append(pulled(flat, bare(flat), held=True) / before[-1])
        after.append([pulled(each, scaled_to(STEEL, each, bare(each))) for each in rough])
    figures = [spread(before), *(spread(column) for column in zip(*after, strict=True))]
    return row(f"plate {thickness:g} mm", spheres, *figures, spread(ratio), spread(on_bars), f"{np.mean(times):.1f}")


def cube_row(spheres: int, packings: int) -> str:
    """The first table's row of cubes."""
    before, after, times = [], [], []
    for seed in range(packings):
        box = flat_packing(spheres, (CUBE, CUBE), CUBE, seed)
        cost, scaled = cpu(lambda box=box: scaled_to(STEEL, box, bare(box)), repeats=1)  # type: ignore[misc]
        times.append(1e3 * cost.median)
        modulus = steel().youngs_modulus
        before.append(tensile_test(box, steel()).youngs_modulus / STEEL)
        beams = msgspec.structs.replace(steel(), youngs_modulus=modulus * scaled.scaling)
        after.append(tensile_test(box, beams).youngs_modulus / STEEL)
    return row("cube", spheres, spread(before), spread(after), "", "", "", "", f"{np.mean(times):.1f}")


def spread(values: Sequence[float]) -> str:
    """Mean and standard deviation."""
    return f"{np.mean(values):.3f} ± {np.std(values):.3f}"


def slide_row(name: str, keys: Sequence[str], pairs: int) -> str:
    """The second table's row: coefficients of the same surfaces and packings."""
    found = np.array([[coefficient([*keys, *seeds(k), f"plates.modulus={which}"]) for which in ("beams", "material")]
                      for k in range(pairs)])  # fmt: skip
    change = found[:, 1] / found[:, 0] - 1.0
    return row(name, pairs, *(f"{value:.4f}" for value in found.mean(axis=0)), f"{change.mean():+.2%}",
               f"{np.abs(change).max():.2%}")  # fmt: skip


def seeds(pair: int) -> list[str]:
    """Keys of a pair of surfaces."""
    return [f"surface.wheel_seed={2 * pair + 1}", f"surface.axle_seed={2 * pair + 2}"]


def coefficient(keys: Sequence[str]) -> float:
    """The meso coefficient with these keys."""
    return run(load(None, keys)).slides[0].curve.coefficient


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--packings", type=int, default=3)
    parser.add_argument("--quick", action="store_true", help="toy size")
    asked = parser.parse_args(arguments)
    packings, plates, cubes, slides = asked.packings, PLATES, CUBES, SLIDES
    if asked.quick:
        packings, plates, cubes, slides = 1, PLATES[:1], CUBES[:1], SLIDES[:1]
    print(head("box", "spheres", "modulus before", "scaled, flat", "R = 20 um", "R = 40 um", "ends held over free",
               "on its bars, over the cube", "CPU ms"))  # fmt: skip
    for thickness, spheres in plates:
        print(plate_row(thickness, spheres, packings), flush=True)
    for spheres in cubes:
        print(cube_row(spheres, packings), flush=True)
    print("\n" + head("spheres of both plates", "pairs", "mean before", "scaled", "mean change", "largest"))
    for name, keys in slides:
        print(slide_row(name, keys, 3 * packings), flush=True)
    return 0
