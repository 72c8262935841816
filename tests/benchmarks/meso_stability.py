"""Do the rough plates end in a right answer or in a clear error, whatever they are asked?

    python -m tests.benchmarks meso_stability [--only FAMILY ...] [--verbose] [--quick]

Families of random friction tests, on small plates; each answer is judged by laws that do not depend on how the engines
are built (`_meso_checks`). `unsettled but said`: the answer carries a remark, such as that the explicit engine took
over where no equilibrium was found, or that work is unaccounted for. `silently wrong`: a law is broken and the package
does not say so; `worst balance` is the largest relative imbalance of force, momentum or energy among answers that
carry no reservation. Ends with 1 where anything is silently wrong, or an exception is not a clear error.
"""

from __future__ import annotations

import argparse
import time
import traceback
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import islice

import numpy as np

from meso.errors import MesoError
from meso.friction_test import prepared
from meso.plates import Plates, make_plates
from meso.settings import load
from meso.surfaces.surface import generator

from . import _meso_laws as laws
from ._measure import head, row
from ._meso_checks import Verdict, refused, verdict

SMALL = ("plates.spheres=600", "engine.samples=100")
STILL = ("surface.generator=self_affine",)  # any length of slide
EXPLICIT = ("engine.name=explicit",)
Case = Callable[[], Verdict]
Rng = np.random.Generator


def test(*keys: str) -> Case:
    """A friction test with plates of its own."""

    def judged() -> Verdict:
        try:
            plates = make_plates(load(None, [*SMALL, *keys]))
        except MesoError as error:
            return refused(error)
        return verdict(plates)

    return judged


def on(plates: Plates, *keys: str) -> Case:
    """A friction test with other contacts, loads or engines on the same plates."""

    def judged() -> Verdict:
        try:
            return verdict(replace(plates, settings=load(None, [*SMALL, *keys])))
        except MesoError as error:
            return refused(error)

    return judged


def log(rng: Rng, low: float, high: float) -> float:
    """Log-uniform."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def same(rng: Rng, every: int = 8, fixed: Sequence[str] = ()) -> Iterator[tuple[Plates, list[str]]]:
    """Plates of random surfaces and the keys they were made with, each `every` times."""
    while True:
        keys = [f"surface.{body}_seed={rng.integers(1, 9999)}" for body in ("wheel", "axle")]
        keys += [f"surface.max_height={rng.choice([0.005, 0.02, 0.06])}", *fixed]
        plates = make_plates(load(None, [*SMALL, *keys]))
        for _ in range(every):
            yield plates, keys


def surfaces(rng: Rng) -> Iterator[Case]:
    """levels 1-6, H 0-1, R 0-0.2 mm, both generators, seeds"""
    for k in range(72):
        seeds = [f"surface.{body}_seed={rng.integers(2**32)}" for body in ("wheel", "axle")]
        shape = [f"surface.levels={1 + k % 6}", f"surface.hurst_exponent={rng.choice([0.0, rng.uniform(), 1.0])}"]
        high = [0.0, log(rng, 1e-4, 0.05), log(rng, 0.05, 0.2)][min(2, rng.integers(8) // 2)]
        kind = ["surface.generator=self_affine", f"surface.rms_height={0.08 * high}"] if k % 3 == 0 else []
        yield test(*seeds, *shape, f"surface.max_height={high}", *kind)


def plates(rng: Rng) -> Iterator[Case]:
    """spheres, thickness, edge, cube, external faces, packing seeds"""
    for k in range(60):
        yield test(
            f"plates.spheres={rng.integers(300, 901)}", f"plates.thickness={rng.uniform(0.2, 0.5)}",
            f"plates.cube={0.5 + log(rng, 1e-3, 10.0)}", f"plates.packing_seed={rng.integers(2**31)}",
            f"plates.external_face={('solid', 'beams')[k % 2]}", f"engine.name={('auto', 'quasi-static')[k % 2]}",
            f"plates.external_modulus={('series', 'paper')[k // 2 % 2]}",
            *([] if k % 5 else ["plates.edge=0.5", "load.slide=0.5"]),
        )  # fmt: skip


def loads(rng: Rng) -> Iterator[Case]:
    """pressure 1-1000 MPa, at constant displacement and at constant force; interference 0.1-40 um"""
    for (each, keys), k in zip(same(rng), range(80), strict=False):
        how = f"load.pressure={log(rng, 1.0, 1000.0)}"
        if k % 4 == 3:
            how = f"load.interference={log(rng, 1e-4, 0.04)}"
        yield on(each, *keys, how, *(["load.control=force"] if k % 4 in (1, 2) else []))


def frictions(rng: Rng) -> Iterator[Case]:
    """micro friction 0-1.9"""
    for (each, keys), mu in zip(same(rng, 12), np.tile(np.linspace(0.0, 1.9, 12), 5), strict=False):
        yield on(each, *keys, f"contact.micro_friction={mu}")


def lengths(rng: Rng) -> Iterator[Case]:
    """slides of 2 um to 3 mm"""
    for k in range(24):
        slide = [f"load.slide={log(rng, 0.002, 1.0)}", *STILL] if k % 4 else [f"load.slide={1 + k // 4 % 3}"]
        yield test(*slide, f"surface.wheel_seed={k}", *(EXPLICIT if k % 3 == 2 else ()))


def increments(rng: Rng) -> Iterator[Case]:
    """increments of 0.1-100 um, tolerance 1e-9 to 0.05"""
    short = (*STILL, "load.slide=0.1")
    for (each, keys), k in zip(same(rng, 6, short), range(36), strict=False):
        size = (1e-4, 5e-4, 2e-3, 8e-3, 0.02, 0.05)[k % 6]
        yield on(each, *keys, f"engine.increment={size}", f"engine.tolerance={log(rng, 1e-9, 0.05)}")
    for each, keys in islice(same(rng, 6), 24):
        size = log(rng, 0.002, 0.1)
        yield on(each, *keys, f"engine.increment={size}", f"engine.tolerance={log(rng, 1e-9, 0.05)}")


def stiffnesses(rng: Rng) -> Iterator[Case]:
    """k_n times 0.02-100, k_t/k_n 0.01-100, both engines"""
    for (each, keys), k in zip(same(rng, 12), range(72), strict=False):
        law = [f"contact.normal_stiffness={log(rng, 0.02, 100.0)}", f"contact.tangential_ratio={log(rng, 0.01, 100.0)}"]
        yield on(
            each, *keys, *law, f"contact.micro_friction={rng.uniform(0.0, 0.5)}", *(EXPLICIT if k % 6 == 5 else ())
        )


def speeds(rng: Rng) -> Iterator[Case]:
    """explicit engine at 0.1-200 m/s, damping lengths, loads"""
    brief = (*STILL, "load.slide=0.01", *EXPLICIT)
    for (each, keys), speed in zip(same(rng, 6, brief), np.geomspace(100.0, 2e4, 18), strict=False):
        yield on(each, *keys, f"engine.speed={speed}")
    for (each, keys), k in zip(same(rng, 6, EXPLICIT), range(30), strict=False):
        held = ["load.control=force"] if k % 3 == 2 else []
        yield on(
            each, *keys, f"engine.speed={log(rng, 1e4, 2e5)}", f"engine.damping_length={log(rng, 1e-3, 10.0)}", *held,
            f"load.pressure={log(rng, 1.0, 1000.0)}", f"engine.samples={(10, 40, 250)[k % 3]}",
            f"engine.approach_speed={log(rng, 200.0, 2e4)}",
        )  # fmt: skip


def breakages(rng: Rng) -> Iterator[Case]:
    """strengths of the beams 5-500 GPa, external faces"""
    for (each, keys), k in zip(same(rng, 4), range(24), strict=False):
        strengths = f"{{tensile_strength={log(rng, 5e3, 5e5)}, shear_strength={log(rng, 5e3, 5e5)}}}"
        how = ["load.control=force"] if k % 4 == 3 else []
        yield on(each, *keys, f"engine.breakage={strengths}", "engine.speed=50000", *how)


def lost(rng: Rng) -> Iterator[Case]:
    """rough faces pressed lightly: contact lost and regained, both engines"""
    for (each, keys), k in zip(same(rng, 8, ["surface.max_height=0.1"]), range(40), strict=False):
        how = [f"load.interference={log(rng, 1e-5, 2e-3)}"] if k % 2 else [f"load.pressure={log(rng, 0.01, 3.0)}"]
        yield on(each, *keys, *how, f"contact.micro_friction={rng.uniform(0.0, 1.0)}", *(EXPLICIT if k % 4 > 1 else ()))


def steps_below(rng: Rng) -> Iterator[Case]:
    """time step 0.5-1 of the limit, both ways to ask for it"""
    for (each, keys), safety in zip(same(rng, 5, EXPLICIT), [0.5, 0.7, 0.9, 0.99, 1.0] * 4, strict=False):
        law = [f"contact.normal_stiffness={log(rng, 0.1, 20.0)}", f"contact.micro_friction={rng.uniform(0.0, 0.5)}"]
        yield on(each, *keys, *law, f"engine.safety={safety}", "engine.speed=40000")
    for each, keys in islice(same(rng, 2, EXPLICIT), 10):
        limit = prepared(replace(each, settings=load(None, [*SMALL, *keys]))).critical  # type: ignore[attr-defined]
        yield on(each, *keys, f"engine.time_step={rng.uniform(0.5, 0.99) * limit}", "engine.speed=40000")


def steps_above(rng: Rng) -> Iterator[Case]:
    """time step 1.01-1.2 of the limit: refused, and where it is forced, the divergence is told"""
    for (each, keys), k in zip(same(rng, 8, EXPLICIT), range(24), strict=False):
        above = (1.01, 1.02, 1.05, 1.2)[k % 4]
        yield laws.diverging(replace(each, settings=load(None, [*SMALL, *keys])), above, forced=k % 8 > 3)


def nonsense(rng: Rng) -> Iterator[Case]:
    """values that cannot be computed: each is refused"""
    impossible = (
        "surface.levels=0", "surface.levels=11", "surface.max_height=-1", "surface.max_height=0.9",
        "surface.max_height=nan", "surface.max_height=inf", "surface.hurst_exponent=1.1", "surface.wheel_seed=-1",
        "plates.spheres=0", "plates.spheres=3", "plates.spheres=40", "plates.thickness=1e-3", "plates.thickness=nan",
        "plates.thickness=1.0", "plates.cube=0.3", "plates.edge=0", "plates.edge=0.7", "load.slide=0.35",
        "load.slide=0", "load.pressure=0", "load.pressure=nan", "load.pressure=1e9", "load.interference=0.2",
        "load.interference=-0.01", "load.interference=nan", "contact.micro_friction=-0.1", "contact.micro_friction=2.1",
        "contact.micro_friction=nan", "contact.micro_friction=[]", "contact.normal_stiffness=0", "engine.increment=0",
        "contact.tangential_ratio=nan", "engine.tolerance=0", "engine.tolerance=nan", "engine.speed=0",
        "engine.speed=inf", "engine.safety=1.5", "engine.time_step=nan", "engine.time_step=1e-6", "engine.name=fast",
        "material.youngs_modulus=0", "material.poisson_ratio=0.25", "material.density=0", "surface.rms=1",
    )  # fmt: skip
    for key in impossible:
        yield laws.impossible(key, [*SMALL, *(EXPLICIT if "time_step" in key else ())])
    yield laws.impossible("engine.time_step=1e-9", [*SMALL, "engine.name=quasi-static"])


FAMILIES: dict[str, Callable[[Rng], Iterator[Case]]] = {
    each.__name__.replace("_", " "): each
    for each in (
        surfaces, plates, loads, frictions, lengths, increments, stiffnesses, speeds, breakages, lost,
        steps_below, steps_above, nonsense,
        laws.million, laws.engines, laws.invariances, laws.determinism, laws.lattices,
    )
}  # fmt: skip


@dataclass
class Tally:
    """One row of the table."""

    kinds: Counter[str] = field(default_factory=Counter)
    balance: float = 0.0
    troubles: list[str] = field(default_factory=list)

    def add(self, number: int, found: Verdict) -> None:
        """Count one case."""
        self.kinds[found.kind] += 1
        self.troubles += [f"case {number}: {fault}" for fault in found.faults]
        if found.kind == "answered":
            self.balance = max(self.balance, found.balance)


def swept(family: Callable[[Rng], Iterator[Case]], cases: int | None, verbose: bool = False) -> Tally:
    """Judge the cases of a family; an exception that is no clear error is a fault."""
    tally = Tally()
    for number, case in enumerate(islice(family(generator("stability")), cases)):
        started = time.process_time()
        try:
            found = case()
        except Exception:
            found = Verdict(faults=["uncaught " + traceback.format_exc().strip().replace("\n", " / ")])
        tally.add(number, found)
        if verbose:
            taken = time.process_time() - started
            told = found.refusal or found.said
            print(f"- {number} {found.kind} {told} {found.balance:.1e} {taken:.2f} s", flush=True)
    return tally


def main(words: Sequence[str]) -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks meso_stability", description=__doc__)
    parser.add_argument("--only", nargs="+", choices=list(FAMILIES), default=list(FAMILIES), metavar="FAMILY")
    parser.add_argument("--verbose", action="store_true", help="a line for each case")
    parser.add_argument("--quick", action="store_true", help="two cases of each family")
    options = parser.parse_args(words)
    columns = "family", "what varies", "cases", "answered", "clear error", "unsettled but said", "silently wrong"
    print(head(*columns, "worst balance"))
    total: Counter[str] = Counter()
    troubles = []
    for name in options.only:
        family = FAMILIES[name]
        if options.quick and family is laws.million:
            tally = swept(partial(laws.million, steps=20_000), 2, options.verbose)
        else:
            tally = swept(family, 2 if options.quick else None, options.verbose)
        total += tally.kinds
        troubles += [f"{name}, {trouble}" for trouble in tally.troubles]
        what = (family.__doc__ or "").strip().splitlines()[0]
        counts = [tally.kinds[kind] for kind in ("answered", "error", "said", "wrong")]
        print(row(name, what, tally.kinds.total(), *counts, f"{tally.balance:.0e}"), flush=True)
    counts = [total[kind] for kind in ("answered", "error", "said", "wrong")]
    print(row("all", "", total.total(), *counts, ""))
    for trouble in troubles:
        print(f"\n{trouble}")
    return int(total["wrong"] > 0)
