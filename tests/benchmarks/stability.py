"""Does the press-fit ever end in something that looks like an answer and is none?

    python -m tests.benchmarks stability [FAMILY ...] [--quick] [--failed FILE]

Sweeps that look for failure. A case ends converged, or in one line that says what is wrong with it; what it left is
then checked by itself: `_stability_checks.py` says what is measured and how large it may be. Prints a row of each
family of cases and ends with 1 where anything was silently wrong or an exception came through. ``--failed`` writes
those cases with all that is needed to run them again.
"""

from __future__ import annotations

import argparse
import re
import sys
import traceback
import warnings
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from unittest.mock import patch

import numpy as np
from mpi4py import MPI

from macrofit.assembly import Assembly, assemble, discretise_bodies, friction_field
from macrofit.bodies.geometry import Drawing
from macrofit.bodies.mesh import MeshData, mesh_drawing
from macrofit.contact.law import classify, return_mapping
from macrofit.contact.status import OPEN, SLIP, STICK
from macrofit.errors import MacrofitError
from macrofit.friction import FrictionField
from macrofit.scene.keys import Scene

from ._measure import head, lines, row
from ._stability_cases import FAMILIES, MENDED, Case, cases
from ._stability_checks import BOUNDS, examine, wrong
from ._stability_views import Run, press

BALANCES = ("loads", "bulk", "force", "stored")


@dataclass
class Tally:
    """How the cases of a family ended."""

    cases: int = 0
    converged: int = 0
    cut: int = 0
    errors: int = 0
    failed: list[tuple[Case, str]] = field(default_factory=list)
    causes: Counter[str] = field(default_factory=Counter)  # of the clear errors, numbers left out
    worst: dict[str, float] = field(default_factory=dict)

    def add(self, found: dict[str, float]) -> None:
        """Keep the largest of each quantity."""
        for name, value in found.items():
            self.worst[name] = max(self.worst.get(name, 0.0), value)


@dataclass
class Bodies:
    """The bodies of the last case, which the next one may share; and the references met so far."""

    key: tuple[object, ...] = ()
    assembly: Assembly | None = None
    references: dict[tuple[object, ...], np.ndarray] = field(default_factory=dict)

    def of(self, case: Case, scene: Scene) -> Assembly:
        """The assembly of a case. Raises SceneError, MeshError."""
        key = (case.numbering, case.units)
        if self.assembly is None or self.key != key or not self.assembly.serves(scene):
            self.assembly, self.key = None, key
            with meshes_of(case):
                self.assembly = assemble(scene, MPI.COMM_SELF)
        return self.assembly


@contextmanager
def meshes_of(case: Case) -> Iterator[None]:
    """Bodies meshed in mm whatever the case's units, so that the meshes are the same, and renumbered as it says."""
    in_mm: dict[str, MeshData] = {}

    def mesh(drawing: Drawing, coarse: float, growth: float) -> MeshData:
        data = in_mm.get(drawing.contact)
        data = (
            mesh_drawing(drawing, coarse, growth) if data is None else replace(data, points=data.points * case.units[0])
        )
        return data if case.numbering is None else renumbered(data, np.random.default_rng(case.numbering))

    def keep(drawing: Drawing, coarse: float, growth: float) -> MeshData:
        return in_mm.setdefault(drawing.contact, mesh_drawing(drawing, coarse, growth))

    if case.units[0] != 1.0:
        with patch("macrofit.bodies.body.mesh_drawing", keep):
            discretise_bodies(replace(case, units=(1.0, 1.0)).scene, MPI.COMM_SELF)
    with patch("macrofit.bodies.body.mesh_drawing", mesh):
        yield


def renumbered(data: MeshData, rng: np.random.Generator) -> MeshData:
    """The same mesh with its points, triangles, their vertices and its edges in another order."""
    points, number = rng.permutation(len(data.points)), np.empty(len(data.points), dtype=np.int64)
    number[points] = np.arange(len(points))
    triangles = rng.permutation(number[data.triangles])
    turned = np.stack([np.roll(triangle, rng.integers(3)) for triangle in triangles])
    edges = {name: rng.permutation(number[pairs])[:, :: int(rng.choice([1, -1]))] for name, pairs in data.edges.items()}
    return MeshData(points=data.points[points], triangles=turned, edges=edges)


def run(case: Case, bodies: Bodies) -> Run:
    """Compute a case. Raises MacrofitError where its scene or mesh cannot be."""
    scene = case.scene
    assembly = bodies.of(case, scene)
    return press(scene, assembly, asked(case, scene, assembly))


def asked(case: Case, scene: Scene, assembly: Assembly) -> FrictionField:
    """The friction of a case, of which nothing has been asked yet."""
    if case.scatter is not None:
        return FrictionField(case.scatter)
    return friction_field(scene, MPI.COMM_SELF, assembly.seat, assembly.wheel)


def judge(case: Case, bodies: Bodies, tally: Tally) -> None:
    """Run a case and enter how it ended."""
    tally.cases += 1
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            done = run(case, bodies)
            found = examine(done, asked(case, done.scene, done.assembly))
            faults = wrong(found) + compared(case, done, bodies, tally)
    except MacrofitError as error:
        faults, found = told(error, tally), {}
    except Exception:
        tally.failed.append((case, traceback.format_exc()))
        return
    else:
        if done.error is None:
            tally.converged += 1
            tally.cut += done.cutbacks > 0
        else:
            faults += told(done.error, tally)
    tally.add(found)
    if faults:
        tally.failed.append((case, ", ".join(f"{name} {found.get(name, 0.0):.2g}" for name in faults)))


def told(error: MacrofitError, tally: Tally) -> list[str]:
    """Enter a clear error, and say where it is none."""
    tally.errors += 1
    text = str(error)
    tally.causes[f"{type(error).__name__}: {re.sub(r'(?<![a-z])-?[0-9]+([.][0-9]+)?(e[-+]?[0-9]+)?', '..', text)}"] += 1
    return [] if text.strip() and "\n" not in text else [f"unclear error {error!r}"]


def compared(case: Case, done: Run, bodies: Bodies, tally: Tally) -> list[str]:
    """Against the first case that must have the same answer: force, normal force, strain energy, in mm and N.

    Of every increment; of the last one where their numbers differ.
    """
    if not case.like or done.error is not None:
        return []
    length, force = case.units
    curve = np.array(
        [(r.force / force, r.normal_force / force, r.strain_energy / force / length) for r in done.records]
    )
    reference = bodies.references.setdefault(case.like, curve)
    largest = np.abs(reference).max(axis=0)
    if len(curve) != len(reference):
        curve, reference = curve[-1:], reference[-1:]
    error = float((np.abs(curve - reference).max(axis=0) / largest).max())
    tally.add({"reference": error})
    return [] if error <= case.tolerance else [f"reference {error:.1e}"]


def broken_mappings(count: int = 10_000, seed: int = 0) -> int:
    """Number of random trials for which the law breaks one of its own: none should.

    The cone is kept; what is let go of has the sense of the shear, so that dissipation is not negative; the traction
    of a traction is itself; it moves no farther than the trial does (by 1 + mu, the Lipschitz constant of the cone);
    and the status says what the law does.
    """
    rng = np.random.default_rng(seed)
    trial = rng.normal(size=(2, count)) * 10 ** rng.uniform(-6.0, 6.0, (2, count)) * (rng.random((2, count)) < 0.95)
    friction = rng.uniform(0.0, 2.0, count) * (rng.random(count) < 0.9)
    traction, status = return_mapping(trial, friction), classify(trial, friction)
    near = trial + rng.normal(size=trial.shape) * 10 ** rng.uniform(-12.0, 0.0, count) * np.abs(trial)
    moved = np.abs(return_mapping(near, friction) - traction)
    bound = -friction * traction[0]
    slips, sticks = status.kind == SLIP, status.kind == STICK
    kept = (traction[0] <= 0.0) & (np.abs(traction[1]) <= bound)
    kept &= traction[1] * (trial[1] - traction[1]) >= 0.0
    kept &= (return_mapping(traction, friction) == traction).all(axis=0)
    kept &= moved[0] <= np.abs(near - trial)[0]
    kept &= moved[1] <= (np.abs(near - trial)[1] + friction * np.abs(near - trial)[0]) * (1.0 + 1e-9)
    kept &= ~sticks | (traction == trial).all(axis=0)
    kept &= ~slips | (traction[1] == status.sign * bound)
    kept &= (status.kind != OPEN) | (traction == 0.0).all(axis=0)
    return int((~kept).sum())


COLUMNS = (
    "family", "what varies", "cases", "converged", "of these with cutbacks", "clear error", "silently wrong",
    "law", "balance", "energy of short steps", "of one more step", "found and mended",
)  # fmt: skip


def rows(name: str, tally: Tally) -> str:
    """The row of a family; law, balance and energies are the worst that was measured of any case, if any was."""
    balance = max(tally.worst.get(quantity, 0.0) for quantity in BALANCES)
    works = [f"{tally.worst[each]:.0e}" if each in tally.worst else "" for each in ("energy", "probe")]
    return row(
        name, FAMILIES[name][0], tally.cases, tally.converged, tally.cut, tally.errors, len(tally.failed),
        f"{tally.worst.get('law', 0.0):.0e}", f"{balance:.0e}", *works, MENDED.get(name, ""),
    )  # fmt: skip


def main(words: Sequence[str]) -> int:
    """Run the sweeps and print their table; 1 where anything was silently wrong."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks stability", description=__doc__.splitlines()[0])
    parser.add_argument("families", nargs="*", metavar="FAMILY", help="all by default")
    parser.add_argument("--quick", action="store_true", help="one case in 41")
    parser.add_argument("--every", type=int, default=1, metavar="N", help="one case in N")
    parser.add_argument("--failed", type=Path, metavar="FILE", help="where to write the cases that failed")
    options = parser.parse_args(words)
    unknown = sorted(set(options.families) - set(FAMILIES))
    if unknown:
        parser.error(f"no family {', '.join(unknown)}; there are {', '.join(FAMILIES)}")
    lines([head(*COLUMNS)])
    tallies: dict[str, Tally] = {}
    for name in options.families or FAMILIES:
        tallies[name], bodies = Tally(), Bodies()
        for case in cases(name, 41 if options.quick else options.every):
            judge(case, bodies, tallies[name])
        lines([rows(name, tallies[name])])
    failed = [f"{case}: {why}" for tally in tallies.values() for case, why in tally.failed]
    broken = broken_mappings()
    lines(conclusion(list(tallies.values()), broken))
    print("\n".join(failed), end="\n" * bool(failed), file=sys.stderr)
    if options.failed is not None:
        options.failed.write_text("".join(f"{line}\n" for line in failed))
    return int(bool(failed or broken))


def conclusion(tallies: Sequence[Tally], broken: int) -> list[str]:
    """The sum of the table in words."""
    count, errors, failed = (
        sum(numbers) for numbers in zip(*((t.cases, t.errors, len(t.failed)) for t in tallies), strict=True)
    )
    worst = Tally()
    for tally in tallies:
        worst.add(tally.worst)
    measured = ", ".join(
        f"{name} {worst.worst.get(name, 0.0):.0e} ({bound:.0e})" for name, bound in BOUNDS.items() if bound
    )
    causes = Counter(cause for tally in tallies for cause in tally.causes.elements())
    return [
        "",
        f"{count} cases: {sum(tally.converged for tally in tallies)} converged, {errors} ended in a clear error, "
        f"{failed} were silently wrong. Of 10000 random return mappings {broken} broke the law.",
        "",
        f"Worst of all against what is allowed: {measured}.",
        "",
        *(f"- {number} times: {cause}" for cause, number in causes.most_common()),
    ]


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
