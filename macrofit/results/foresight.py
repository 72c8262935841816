"""What a scene lets one doubt before anything is computed: its mesh, steps and corners, and what they cost.

The figures in the messages were measured on hubs of 60 mm with the blends of `wheelset` (150 mm) and of the README's
hub (100 and 80 mm), against meshes of eight times as many facets; the scripts are in `tests.benchmarks.doubts`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from itertools import pairwise

import msgspec
import numpy as np

from ..base.arrays import FloatArray
from ..bodies.geometry import Generatrix, Sizes, draw_body
from ..bodies.mesh import read_mesh
from ..errors import MacrofitError
from ..plasticity.material import hardening
from ..scene.deviation import deviation_of
from ..scene.keys import Hub, MeshFile, Scene, Shaft
from ..scene.material import LinearHardening, cards, yield_stress

SEAT_FACETS = 10
"""Fewest facets along a contact line: with 10 the force was off by 1 % at the end, with 3 by 14 to 19 %."""
BLEND_FACETS = 6
"""Fewest facets in an arc: with 7 or more the peak stress was off by at most 5 %, with 5 by up to 36 %."""
BLEND_STEPS = 2.0
"""Fewest increments in the time a blend takes to enter: with 2 the peak stress was 2 % low, with 1 by 32 %."""
PLASTIC_STEPS = 5.0
"""The same where steel yields: with 7.5 the plastic strain was 7 % low, with 5 by 15 %, with 3.75 by 22 %."""
MODULI = (2e3, 5e9)
"""Young's moduli without a doubt [MPa]: solids in GPa are below, in Pa above, a rigid tool is not."""
LARGEST_ELASTIC_STRAIN = 0.05
"""Yield stresses without a doubt, over Young's modulus: maraging steel yields at 0.013, metallic glass at 0.02."""
PROOF_STRAIN = 0.002
"""Plastic strain at which standards state what a steel without a sharp yield point bears, Rp0.2 [-]."""
LOCKING_POISSON_RATIO = 0.45
"""Largest Poisson's ratio of elements of order 1: the force was 0.8 % high there, 2.5 % at 0.49, 12 % at 0.499."""
LEAST_GAMMA0 = 0.3
"""Smallest gamma0 of theta = 0: the peak stress was 1.5 % high with it, 7 % with 0.1; with 0.01 nothing converged."""

LARGE_PROFILE = 3.0
"""Largest deviation of a profile, in interferences: more looks like another unit."""
SMALL_PROFILE = 5e-4
"""Deviations without a unit that are all smaller look like ones in mm [mm]; no probe is better than 0.5 um."""
ROUGH_PROFILE = 0.02
"""Largest root mean square of what a profile does within a facet, in interferences: it is taken at three points."""
HOTTEST = 250.0
"""Warmer than this no standard lets a wheel be (GOST 4835, as cited elsewhere), and steel is no longer as stiff [K]."""


@dataclass(frozen=True)
class Arc:
    """A blend of a contact line that meets the other line."""

    key: str
    ends: tuple[float, float]  # mm, in the frame of its body
    facets: int
    share: float  # the length of its facets over mesh.corner_facet

    @property
    def length(self) -> float:
        """Its length along the axis [mm]."""
        return self.ends[1] - self.ends[0]


def foreseen(scene: Scene) -> list[str]:
    """A sentence for each doubt that a scene alone gives rise to; none for one that should do."""
    checks: tuple[Callable[[Scene], Iterator[str]], ...] = (
        _clearance, _moduli, _yield_stresses, _weak_steel, _locking, _linear_stress, _stabilisation, _few_facets,
        _few_in_blends, _long_steps, sharp_corners, _odd_meshes, _linear_flow, _long_plastic_steps, _profiles, _hot,
    )  # fmt: skip
    return [sentence for check in checks for sentence in check(scene)]


def too_few_facets(line: str, coordinate: FloatArray, covered: float) -> Iterator[str]:
    """The doubt about a line (facets + 1,) [mm] of which a length ``covered`` can be in contact."""
    count = covered / float(np.diff(coordinate).max())
    if count < SEAT_FACETS - 1e-9:
        yield (
            f"too few facets: about {count:.2g} along the {line}, {SEAT_FACETS} are wanted (3 make the force 14 % "
            f"wrong); {'mesh.seat_facet' if line == 'seat' else 'mesh.bore_facet'} = {covered / (2 * SEAT_FACETS):.2g}"
        )


def _odd_meshes(scene: Scene) -> Iterator[str]:
    """What a damaged mesh file would show; it is read again, for bodies are long factored when a run is judged."""
    for name, body in (("axle", scene.axle), ("wheel", scene.wheel)):
        file = getattr(scene.mesh, name)
        if isinstance(body, MeshFile) and file is not None:
            with suppress(MacrofitError):
                yield from (f"odd mesh: mesh.{name}: {odd}" for odd in read_mesh(file, name, scene.mesh.unit).oddities)


def _clearance(scene: Scene) -> Iterator[str]:
    if scene.interference is not None and scene.interference <= 0.0:
        yield (
            f"clearance: the bore is {abs(scene.interference):.4g} mm wider than the seat, on the radius; a press-fit "
            f"needs axle.seat_radius above wheel.bore_radius"
        )


def _moduli(scene: Scene) -> Iterator[str]:
    low, high = MODULI
    for name, body in (("axle", scene.axle), ("wheel", scene.wheel)):
        modulus = body.material.youngs_modulus
        if not low <= modulus <= high:
            yield (
                f"odd modulus: {name}.material.youngs_modulus = {modulus:g} is in MPa, and steel has 206000; is it "
                f"in {'GPa' if modulus < low else 'Pa'}?"
            )


def _yield_stresses(scene: Scene) -> Iterator[str]:
    for name, body in (("axle", scene.axle), ("wheel", scene.wheel)):
        material = body.material
        first, modulus, keys = yield_stress(material), material.youngs_modulus, material.hardening
        if first is not None and first > LARGEST_ELASTIC_STRAIN * modulus:
            yield (
                f"odd yield stress: {name}.material yields at {first:g} MPa, over {LARGEST_ELASTIC_STRAIN:g} of "
                f"youngs_modulus, {modulus:g} MPa, and no metal bears that; is it in Pa?"
            )
        slope = max(keys.isotropic, keys.kinematic) if isinstance(keys, LinearHardening) else 0.0
        if slope > modulus:
            yield (
                f"odd hardening: {name}.material.hardening grows by {slope:g} MPa, more than youngs_modulus, "
                f"{modulus:g} MPa; is it in Pa?"
            )


def _weak_steel(scene: Scene) -> Iterator[str]:
    """A yield stress or a curve that takes the place of a grade's card, and is below the least of its standard."""
    for name, material in (("axle", scene.axle.material), ("wheel", scene.wheel.material)):
        law = hardening(msgspec.structs.replace(material, elastic=False))
        if material.grade is None or law is None:
            continue
        least, found = float(cards()[material.grade]["yield_stress"]), law.tension(PROOF_STRAIN)
        if found < least - 1e-9:
            yield (
                f"weaker than its grade: {name}.material bears {found:.4g} MPa at {PROOF_STRAIN:.1%} of plastic strain "
                f"by its {'hardening' if material.yield_stress is None else 'yield_stress'}, which holds, and "
                f"{material.grade} by its standard {least:g} or more; correct it, or leave {name}.material.grade out"
            )


def _locking(scene: Scene) -> Iterator[str]:
    for name, body in (("axle", scene.axle), ("wheel", scene.wheel)):
        ratio = body.material.poisson_ratio
        if scene.mesh.order == 1 and ratio > LOCKING_POISSON_RATIO:
            yield (
                f"locking: elements of order 1 are too stiff at {name}.material.poisson_ratio = {ratio:g} (at 0.49 "
                f"the force is 2.5 % high, at 0.499 by 12 %); mesh.order = 2"
            )


def _linear_stress(scene: Scene) -> Iterator[str]:
    if scene.mesh.order == 1 and scene.output.stress and met_arcs(scene):
        yield (
            "stress of order 1: the peak stress in a blend is 10 to 25 % high with elements of order 1, however short "
            "its facets; mesh.order = 2 (the force is right to 0.7 %)"
        )


def _stabilisation(scene: Scene) -> Iterator[str]:
    contact = scene.contact
    given = contact.gamma0 if contact.formulation == "nitsche" and contact.theta == 0 else None
    if given is not None and given < LEAST_GAMMA0:
        yield f"weak contact: contact.gamma0 = {given:g} makes the peak stress up to 7 % high; leave it out for 10"


def _few_facets(scene: Scene) -> Iterator[str]:
    if isinstance(scene.axle, MeshFile) or isinstance(scene.wheel, MeshFile):
        return
    seat, bore = (_nodes(scene, line) for line in ("seat", "bore"))
    covered = min(float(seat[-1] - seat[0]), float(bore[-1] - bore[0]))
    for line, coordinate in (("seat", seat), ("bore", bore)):
        yield from too_few_facets(line, coordinate, covered)


def _few_in_blends(scene: Scene) -> Iterator[str]:
    for arc in met_arcs(scene):
        if arc.facets < BLEND_FACETS:
            yield (
                f"coarse blend: the arc of {arc.key} has {arc.facets} facets, {BLEND_FACETS} are wanted (5 make the "
                f"peak stress up to 36 % wrong); mesh.corner_facet = {arc.length / arc.share / 10.0:.2g}"
            )


def _long_steps(scene: Scene) -> Iterator[str]:
    arcs = met_arcs(scene)
    if not arcs or not scene.output.stress:
        return
    wheel, axle = scene.wheel, scene.axle
    assert isinstance(wheel, Hub)
    assert isinstance(axle, Shaft)
    shortest, entered = min(arc.length for arc in arcs), wheel.chamfer_length + sum(arc.length for arc in arcs)
    steps = [after - before for before, after in pairwise(scene.displacements) if -1e-9 <= before < entered]
    longest = max(steps, default=0.0)
    if BLEND_STEPS * longest > shortest * (1.0 + 1e-9):
        yield (
            f"long steps: increments of {longest:.3g} mm over a blend of {shortest:.3g} mm, where the peak stress "
            f"comes and goes (as long as the blend they make it 32 % low); motion.increment = {shortest / 5.0:.2g}"
        )


def sharp_corners(scene: Scene) -> Iterator[str]:
    """The doubt about corners without a blend that are pressed: stresses there grow with every finer mesh."""
    axle, wheel, places = scene.axle, scene.wheel, scene.displacements
    if not (isinstance(axle, Shaft) and isinstance(wheel, Hub)) or (scene.interference or 0.0) <= 0.0:
        return
    if max(places) - max(min(places), 0.0) < 0.5 * scene.mesh.seat_facet:
        return
    corners = []
    if wheel.chamfer_height > 0.0 and wheel.chamfer_blend == 0.0:
        corners.append("wheel.chamfer_blend")
    if axle.taper_blend == 0.0 and _passes(scene, (0.0, 0.0)):
        if axle.taper_height > 0.0:
            corners.append("axle.taper_blend")
        elif wheel.chamfer_height > 0.0:
            corners.append("axle.taper_length, taper_height and taper_blend")
    if corners:
        yield (
            f"sharp corners: the force ripples within each facet of travel, by 0.3 to 4 %, and the peak stress grows "
            f"with every finer mesh; give {' and '.join(corners)} (150 in wheelset)"
        )


def _yielding(scene: Scene) -> list[str]:
    return [name for name in ("axle", "wheel") if hardening(getattr(scene, name).material) is not None]


def _profiles(scene: Scene) -> Iterator[str]:
    facets = {"axle": Sizes.of(scene.mesh, "seat").facet, "wheel": Sizes.of(scene.mesh, "bore").facet}
    for body, facet in facets.items():
        found = deviation_of(scene, body)
        if found is None:
            continue
        largest, interference = found.largest, scene.interference or 0.0
        if interference > 0.0 and largest > LARGE_PROFILE * interference:
            yield (
                f"large profile: {body}.profile deviates by up to {1e3 * largest:.4g} um, {largest / interference:.2g} "
                f"times the interference; are these deviations of the radius, in {found.unit}?"
            )
        if found.assumed and 0.0 < largest < SMALL_PROFILE:
            yield (
                f"small profile: {body}.profile deviates by {1e3 * largest:.2g} um at most, which no probe sees; if it "
                f"is in mm, write deviation_mm in its header"
            )
        rough = found.roughness(facet)
        if interference > 0.0 and rough > ROUGH_PROFILE * interference:
            yield (
                f"rough profile: {body}.profile varies by {1e3 * rough:.2g} um (root mean square) within facets of "
                f"{facet:.3g} mm, of which three points are taken; filter it to that length, or shorten "
                f"{'mesh.seat_facet' if body == 'axle' else 'mesh.bore_facet'}"
            )


def _hot(scene: Scene) -> Iterator[str]:
    warmth = getattr(scene.wheel, "temperature", 0.0)
    if warmth > HOTTEST:
        yield (
            f"hot wheel: {warmth:g} K warmer than the axle, and its elastic constants are those of cold steel; "
            f"standards end at 250 C; wheel.temperature = {HOTTEST:g} or less"
        )


def _linear_flow(scene: Scene) -> Iterator[str]:
    if scene.mesh.order == 1 and _yielding(scene):
        yield (
            f"flow of order 1: the {' and the '.join(_yielding(scene))} may yield, for which elements of order 1 are "
            f"too stiff (the largest plastic strain was off by up to 24 %); mesh.order = 2"
        )


def _long_plastic_steps(scene: Scene) -> Iterator[str]:
    arcs = met_arcs(scene)
    if not arcs or not _yielding(scene):
        return
    shortest = min(arc.length for arc in arcs)
    longest = max((abs(after - before) for before, after in pairwise(scene.displacements)), default=0.0)
    if PLASTIC_STEPS * longest > shortest * (1.0 + 1e-9):
        yield (
            f"long steps for flow: increments of {longest:.3g} mm over a blend of {shortest:.3g} mm (a quarter of it "
            f"makes the plastic strain 22 % low, the force 0.8 % high); motion.increment = {shortest / 15.0:.2g}"
        )


def met_arcs(scene: Scene) -> list[Arc]:
    """The blends of taper, chamfer and rear edge that the other line passes while it is pressed."""
    axle, wheel = scene.axle, scene.wheel
    if not (isinstance(axle, Shaft) and isinstance(wheel, Hub)) or (scene.interference or 0.0) <= 0.0:
        return []
    far = max(scene.displacements)
    arcs = [arc for arc in _arcs(scene, "seat", "axle.taper_blend", 1.0) if _passes(scene, arc.ends)]
    for arc in _arcs(scene, "bore", "wheel.chamfer_blend", 0.97):
        if arc.ends[1] > -0.5 * wheel.hub_length:
            arcs.append(arc)
        elif arc.ends[1] + far > 0.0:
            arcs.append(Arc("wheel.rear_edge_blend", arc.ends, arc.facets, arc.share))
    return arcs


def _passes(scene: Scene, ends: tuple[float, float]) -> bool:
    """Whether the bore ever lies over a place of the seat."""
    assert isinstance(scene.wheel, Hub)
    return min(scene.displacements) - scene.wheel.hub_length < ends[1] and max(scene.displacements) > ends[0]


def _arcs(scene: Scene, line: str, key: str, share: float) -> Iterator[Arc]:
    generatrix, nodes = _line(scene, line), _nodes(scene, line)
    for bend, ends in zip(generatrix.bend, pairwise(generatrix.breaks.tolist()), strict=True):
        if bend != 0.0:
            inside = (nodes[:-1] >= ends[0] - 1e-9) & (nodes[1:] <= ends[1] + 1e-9)
            yield Arc(key, ends, int(inside.sum()), share)


def _line(scene: Scene, line: str) -> Generatrix:
    body = scene.axle if line == "seat" else scene.wheel
    return draw_body(body, line, Sizes.of(scene.mesh, line)).generatrix


def _nodes(scene: Scene, line: str) -> FloatArray:
    nodes: FloatArray = _line(scene, line).nodes(Sizes.of(scene.mesh, line))
    return nodes
