"""A run judged: what makes one doubt its numbers, each in a sentence with its figure and its remedy."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import TYPE_CHECKING

import numpy as np

from ..errors import MacrofitError
from ..scene.keys import Disc, MeshFile, Scene
from ..scene.material import TabulatedHardening
from .foresight import SEAT_FACETS, foreseen, too_few_facets

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ..friction import Outside
    from ..solution import Solution

DOUBTFUL = "Doubtful"
"""How the line of a doubt begins."""
LEFT_INTERFERENCE = 0.01
"""Largest mean interpenetration over the interference: with 2 % the force was 0.7 % low, the peak stress 8 %.

Nitsche's method leaves 1e-4, a penalty of 10 E per mm 2e-3 (`wheelset`).
"""
ENERGY_BALANCE = 0.05
"""Largest energy balance: 1 mm increments leave 2e-5 (`wheelset`), 10 mm ones 5e-4; partial slip in any steps 3e-6."""

LARGE_STRAIN = 0.1
"""Largest plastic strain of small strain theory: rotations and changes of area of that size are left out."""

RELEASED = 1e-4
"""Largest force over the normal force that a press holds and has let go all the same: plastic strains settle to 1e-3 of
a step's, which leaves 2e-5."""


OUTSIDE_ERROR = 0.01
"""Largest share of the force that may be wrong for what the provider of friction was asked for and does not know [-]:
as much as the network is off within its range. `wheelset` has 0.0014, `wheelset-en` 0.00001."""


class DoubtfulRun(MacrofitError):
    """A run with doubts where none are allowed."""


def doubts(solution: Solution) -> list[str]:
    """A sentence for each doubt about a run, what it showed before what its scene foretold."""
    checks: tuple[Callable[[Solution], Iterator[str]], ...] = (
        _touch, _interpenetration, _energy, _convergence, _past_end, _facets, _yield, _large_strain, _past_table, _held,
        _outside,
    )  # fmt: skip
    return [sentence for check in checks for sentence in check(solution)] + foreseen(solution.scene)


def doubtful_lines(sentences: Sequence[str]) -> list[str]:
    """The lines that say so, for people."""
    return [f"{DOUBTFUL}: {sentence}" for sentence in sentences]


def doubtful_runs(runs: Sequence[Sequence[str]]) -> list[str]:
    """A line for each kind of doubt about several runs: how many have it, and its sentence.

    Where sentences differ it is the first, and said to be: which one is the worst their words do not tell.
    """
    found: dict[str, dict[int, str]] = {}
    for number, sentences in enumerate(runs):
        for sentence in sentences:
            found.setdefault(sentence.partition(":")[0], {}).setdefault(number, sentence)
    told = []
    for said in found.values():
        first, *others = dict.fromkeys(said.values())
        told.append(f"{len(said)} of {len(runs)} runs, {'the first of them: ' if others else ''}{first}")
    return doubtful_lines(told)


def allow_none(sentences: Sequence[str], folder: object) -> None:
    """Where ``sentences`` holds a doubt, refuse the run.

    Raises:
        DoubtfulRun: with all of them.
    """
    if sentences:
        raise DoubtfulRun(f"doubtful, which --strict refuses: {'; '.join(sentences)} (the results are in {folder})")


def _touch(solution: Solution) -> Iterator[str]:
    records = solution.increments
    if records and not any(record.active_facets for record in records):
        yield (
            f"no contact: seat and bore never touched in {len(records)} increments, {records[0].displacement:g} to "
            f"{records[-1].displacement:g} mm; check the travel, the radii, and that meshes are in mm"
        )


def _interpenetration(solution: Solution) -> Iterator[str]:
    left = interpenetration(solution)
    if left > LEFT_INTERFERENCE:
        remedy = "contact.gamma0" if solution.scene.contact.formulation == "nitsche" else "contact.penalty_stiffness"
        yield (
            f"interpenetration: the bodies still overlap by {left:.2g} of their interference where they press, at "
            f"most {LEFT_INTERFERENCE:g} is sound (the force is then 0.3 % low); leave {remedy} out, or raise it"
        )


def interpenetration(solution: Solution) -> float:
    """Largest of the increments' mean interpenetration, weighted with pressure and length, over the interference.

    A mean, for at a sharp edge one facet always keeps some; 0 where the bodies have no interference.
    """
    scene, worst = solution.scene, 0.0
    interference = solution.interference if scene.interference is None else scene.interference
    if interference is None or interference <= 0.0 or len(solution.seat) < 2:
        return 0.0
    length = np.diff(solution.seat)
    for record in solution.increments:
        weight = np.maximum(record.facets.pressure, 0.0) * length
        whole = float(weight.sum())
        if whole > 0.0:
            worst = max(worst, float(weight @ np.maximum(-record.facets.gap, 0.0)) / whole)
    return worst / interference


def _energy(solution: Solution) -> Iterator[str]:
    if not solution.energy_balance <= ENERGY_BALANCE:  # so that NaN is doubtful
        yield (
            f"energy balance: work, stored and dissipated energy differ by {solution.energy_balance:.2g} of the "
            f"largest, at most {ENERGY_BALANCE:g} is sound; try a shorter motion.increment"
        )


def _convergence(solution: Solution) -> Iterator[str]:
    failed = sum(not record.converged for record in solution.increments)
    if failed:
        yield f"not converged: {failed} of {len(solution.increments)} increments; try a shorter motion.increment"


def _past_end(solution: Solution) -> Iterator[str]:
    """A wheel past the end of a seat from a file, which may go on; up to the end the force is right to 3e-4."""
    scene, ends = solution.scene, solution.bore_ends
    if not isinstance(scene.axle, MeshFile) or scene.direction != "radial" or ends is None or len(solution.seat) < 2:
        return
    past = ends[1] + max(scene.displacements) - float(solution.seat[-1])
    if past > float(np.diff(solution.seat)[-1]) and any(r.facets.pressure[-1] > 0.0 for r in solution.increments):
        yield (
            f"past the seat's end: the wheel goes {past:.4g} mm beyond the group 'seat', where no contact is looked "
            f"for; let the group reach further, unless the axle is narrower there"
        )


def _yield(solution: Solution) -> Iterator[str]:
    """An elastic body beyond the yield stress that it states."""
    for body, zone in solution.beyond_yield.items():
        yield (
            f"beyond yield: the {body} is taken as elastic, and its stress reaches {zone.value:.3g} times the yield "
            f"stress, {zone.depth_mm:.1f} mm deep and over {zone.area_mm2:.0f} mm2 of the section; leave "
            f"{body}.material.elastic out"
        )


def _held(solution: Solution) -> Iterator[str]:
    """A press that was to let go, and found no place without force."""
    records = solution.increments
    if not (solution.scene.motion.release and records):
        return
    left = abs(records[-1].force)
    if left > RELEASED * max(records[-1].normal_force, abs(records[-1].force)):
        yield (
            f"not released: {left / 1e3:.4g} kN are left at {records[-1].displacement:g} mm, for no displacement "
            f"without force was found; take motion.release out, or move the wheel back by motion.displacements"
        )


def _outside(solution: Solution) -> Iterator[str]:
    """A provider of friction that was asked for what it does not know."""
    yield from outside_doubts(solution.outside, solution.displacement.tolist())


def outside_doubts(found: Sequence[Outside], displacements: Sequence[float]) -> Iterator[str]:
    """A sentence for each reason for which a provider of friction may be wrong, where it counts.

    Args:
        found: the pairs that it concerns.
        displacements: of the increments [mm].
    """
    for each in found:
        if each.error > OUTSIDE_ERROR:
            head, colon, told = each.reason.partition(": ")
            low, high = each.pressure
            yield (
                f"{head}: {each.pairs} of {each.of} pairs of tiles at {displacements[each.increment]:g} mm, with "
                f"{each.share:.0%} of the largest normal force and {low:.3g} to {high:.3g} MPa"
                f"{', ' if colon else ''}{told}"
            )


def _large_strain(solution: Solution) -> Iterator[str]:
    """Flow beyond small strain theory; of which body is known where stresses were asked for."""
    most = max((record.plastic_strain for record in solution.increments), default=0.0)
    yield from large_strain(most, [body for body, zone in solution.flowed.items() if zone.value > LARGE_STRAIN])


def _past_table(solution: Solution) -> Iterator[str]:
    """Flow beyond what a measured curve says; of which body is known where stresses were asked for."""
    most = max((record.plastic_strain for record in solution.increments), default=0.0)
    strains = {body: zone.value for body, zone in solution.flowed.items()}
    yield from past_table(solution.scene, {body: strains.get(body, most) for body in ("axle", "wheel")})


def past_table(scene: Scene, strains: Mapping[str, float]) -> Iterator[str]:
    """A sentence for each body whose plastic strain is beyond the last point of a table that still rises there.

    Args:
        scene: with the tables.
        strains: the largest plastic strain of each body, or at least of the bodies together [-].
    """
    for body, material in (("axle", scene.axle.material), ("wheel", scene.wheel.material)):
        table = material.hardening
        if not isinstance(table, TabulatedHardening) or material.elastic or table.stress[-1] == table.stress[-2]:
            continue
        end = table.plastic_strain[-1]
        if not strains[body] <= end:  # so that NaN is doubtful
            yield (
                f"past the table: the {body} flowed by up to {strains[body]:.3g}, and {body}.material.hardening ends "
                f"at {end:g}, behind which its stress was taken as constant; give points up to that strain"
            )


def large_strain(most: float, flowed: Sequence[str] = ()) -> list[str]:
    """A sentence where the largest plastic strain of bodies of these names is beyond small strain theory."""
    if most <= LARGE_STRAIN:  # NaN is doubtful
        return []
    return [
        f"large strain: the {' and the '.join(flowed) or 'steel'} flowed by {most:.2g}, and small strain theory "
        f"ends at {LARGE_STRAIN:g}; give material.hardening, or a smaller interference or friction"
    ]


def _facets(solution: Solution) -> Iterator[str]:
    """Facets of lines from files, and of the contact's patch where the bodies are discs."""
    scene, seat = solution.scene, solution.seat
    if isinstance(scene.axle, MeshFile) and len(seat) > 1:
        ends = solution.bore_ends or (-np.inf, np.inf)
        yield from too_few_facets("seat", seat, min(float(seat[-1] - seat[0]), ends[1] - ends[0]))
    most = max((record.active_facets for record in solution.increments), default=0)
    if isinstance(scene.axle, Disc) and 0 < most < SEAT_FACETS:
        yield (
            f"too few facets: the contact reaches over {most} of them at most, {SEAT_FACETS} are wanted; "
            f"mesh.seat_facet = {scene.mesh.seat_facet * most / (2 * SEAT_FACETS):.2g}"
        )
