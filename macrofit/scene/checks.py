"""The checks across the keys of a scene: each failure names the key and what to try."""

from __future__ import annotations

import math
from itertools import pairwise

from ..errors import SceneError
from .deviation import deviation_of
from .keys import AXLE_TEMPERATURE, Disc, Hub, MeshFile, Scene, Shaft
from .material import ChabocheHardening, Material, TabulatedHardening, yield_stress
from .profile import SMALL_STRAIN, bore_profile, overlap, sampled, seat_profile

SHORTEST_LENGTH = 1e-7
"""Shortest length of a body, in its largest: drawing and meshing tell points apart by some 1e-8 of it."""

SOFTEST = 2e-5
"""Smallest yield stress that can be followed, in Young's moduli: the elastic strain at yield, of which the plastic
strain of a step is found to 1e-3; a hub of 2e-5 E is right to 1 %, of 1e-5 E to 9 %, and of 5e-7 E bears nothing. A
tool that is nearly rigid may state less, as long as it does not flow: see `plasticity.yielding`."""

NO_LENGTHS = ("taper", "bore_taper", "web_offset")
"""Keys of a body that are no lengths, or may be as small as they like."""


def _need(condition: bool, message: str) -> None:
    if not condition:
        raise SceneError(message)


def check_scene(scene: Scene) -> None:
    """Check what no key says alone, see `keys` for the rest.

    Raises:
        SceneError: the first key that makes the scene impossible.
    """
    _check_motion(scene)
    for table, body in (("axle", scene.axle), ("wheel", scene.wheel)):
        _check_material(f"{table}.material", body.material, scene)
        if not isinstance(body, MeshFile):
            _check_lengths(table, body)
        if isinstance(body, Disc):
            _check_disc(table, body)
    if isinstance(scene.axle, Shaft):
        _check_shaft(scene.axle)
    if isinstance(scene.wheel, Hub):
        _check_hub(scene.wheel)
    _check_pair(scene)
    _check_surfaces(scene)
    _need(
        scene.mesh.growth > 0.0 or scene.mesh.corner_facet is None,
        "mesh.growth: 0 would mesh the whole body as fine as mesh.corner_facet; give one above 0",
    )
    for at in scene.output.fields_at or ():
        low, high = min(scene.displacements), max(scene.displacements)
        _need(
            low - 1e-9 <= at <= high + 1e-9,
            f"output.fields_at: {at} is outside the motion, {low} to {high} mm",
        )


def _check_material(where: str, material: Material, scene: Scene) -> None:
    """The yield stress is stated once, nothing softens, and the solver can follow it."""
    keys, stated = material.hardening, material.yield_stress
    if isinstance(keys, TabulatedHardening):
        _check_table(where, keys, stated)
    elif keys is not None:
        _need(
            stated is not None or material.grade is not None,
            f"{where}.hardening: says nothing without a yield stress; state {where}.yield_stress or a grade",
        )
    if isinstance(keys, ChabocheHardening):
        _need(
            len(keys.moduli) == len(keys.recalls),
            f"{where}.hardening: {len(keys.moduli)} moduli and {len(keys.recalls)} recalls; give one of each for "
            f"every back-stress",
        )
    first = yield_stress(material)
    if first is None or material.elastic:
        return
    key = "hardening.stress" if isinstance(keys, TabulatedHardening) else "grade" if stated is None else "yield_stress"
    moduli = [material.youngs_modulus]
    if key != "grade":  # a body much stiffer than the other is a tool, and need not flow
        moduli += [body.material.youngs_modulus for body in (scene.axle, scene.wheel)]
    _need(
        first >= SOFTEST * min(moduli),
        f"{where}.{key}: {first} is less than {SOFTEST:g} of "
        f"{where}.youngs_modulus, {material.youngs_modulus:.6g}: no solid yields so soon, and the contact would not "
        f"see what it bears; both are in MPa",
    )
    _need(
        scene.contact.formulation == "penalty" or scene.contact.theta == 0,
        f"contact.theta: {scene.contact.theta} is for elastic bodies, and {where} yields; take 0",
    )


def _check_table(where: str, keys: TabulatedHardening, stated: float | None) -> None:
    strain, stress = keys.plastic_strain, keys.stress
    _need(
        len(strain) == len(stress),
        f"{where}.hardening: {len(strain)} plastic strains and {len(stress)} stresses; give as many of both",
    )
    _need(strain[0] == 0.0, f"{where}.hardening.plastic_strain: must begin with 0, where the yield stress is")
    _need(
        all(a < b for a, b in pairwise(strain)),
        f"{where}.hardening.plastic_strain: must grow from point to point",
    )
    _need(
        stress[0] > 0.0 and all(a <= b for a, b in pairwise(stress)),
        f"{where}.hardening.stress: must be positive and never fall; a steel that softens is not computed",
    )
    _need(
        stated is None or stated == stress[0],
        f"{where}.yield_stress: {stated} is not the first stress of the table, {stress[0]}; leave it out",
    )


def _check_lengths(table: str, body: Shaft | Hub | Disc) -> None:
    """No length is lost beside the largest one; a radius of curvature may be as large as it likes."""
    given = {key: getattr(body, key) for key in body.__struct_fields__ if key not in NO_LENGTHS}
    lengths = {key: value for key, value in given.items() if isinstance(value, float | int) and value > 0.0}
    longest = max((key for key in lengths if not key.endswith(("_blend", "crown_radius"))), key=lambda k: lengths[k])
    for key, value in lengths.items():
        _need(
            value >= SHORTEST_LENGTH * lengths[longest],
            f"{table}.{key}: {value:.6g} is lost beside {table}.{longest}, {lengths[longest]:.6g}, of which it must be "
            f"{SHORTEST_LENGTH:g} at least; correct one of them, or leave out what may be (0)",
        )


def _check_shaft(axle: Shaft) -> None:
    start = axle.seat_radius - axle.taper_height
    _need(
        start > axle.inner_radius,
        f"axle.inner_radius: {axle.inner_radius} must be below the radius where the taper starts, {start}",
    )
    for key in ("lead_radius", "tail_radius"):
        value = getattr(axle, key)
        _need(
            value is None or value > axle.inner_radius,
            f"axle.{key}: {value} must be above axle.inner_radius, {axle.inner_radius}",
        )
    _need(
        axle.taper_length > 0.0 or axle.taper_height == 0.0,
        "axle.taper_length: must be positive where taper_height is given",
    )
    _need(
        axle.lead_radius is None or axle.lead_radius <= start,
        f"axle.lead_radius: {axle.lead_radius} must not exceed the radius where the taper starts, {start}",
    )
    reach = _blend_reach(axle.taper_blend, axle.taper_length, axle.taper_height, axle.taper)
    _need(
        reach <= min(axle.taper_length, axle.seat_length) + 1e-12,
        f"axle.taper_blend: an arc of radius {axle.taper_blend} reaches {reach:.3g} mm along taper and seat, "
        f"more than there is; try a smaller radius",
    )
    end = axle.seat_radius + 0.5 * axle.taper * axle.seat_length
    tail = end if axle.tail_radius is None else axle.tail_radius
    _need(
        axle.tail_blend <= min(abs(end - tail), axle.tail_length) + 1e-12,
        f"axle.tail_blend: {axle.tail_blend} does not fit the shoulder or the tail",
    )


def _check_hub(wheel: Hub) -> None:
    _need(
        wheel.hub_outer_radius > wheel.bore_radius + max(wheel.chamfer_height, wheel.rear_edge_blend),
        f"wheel.hub_outer_radius: {wheel.hub_outer_radius} must be above the bore with its chamfer, "
        f"{wheel.bore_radius + wheel.chamfer_height}",
    )
    _need(
        wheel.chamfer_length > 0.0 or wheel.chamfer_height == 0.0,
        "wheel.chamfer_length: must be positive where chamfer_height is given",
    )
    mouth = wheel.chamfer_height + 0.5 * wheel.bore_taper * wheel.chamfer_length  # above the corner of the chamfer
    reach = _blend_reach(wheel.chamfer_blend, wheel.chamfer_length, mouth, wheel.bore_taper)
    _need(
        reach <= wheel.chamfer_length + 1e-12,
        f"wheel.chamfer_blend: an arc of radius {wheel.chamfer_blend} reaches {reach:.3g} mm along the chamfer, "
        f"more than there is; try a smaller radius",
    )
    _need(
        wheel.chamfer_length + reach + wheel.rear_edge_blend < wheel.hub_length,
        f"wheel.hub_length: {wheel.hub_length} leaves no bore between chamfer and rear edge",
    )
    rear = wheel.bore_radius - 0.5 * wheel.bore_taper * wheel.hub_length
    _need(rear > 0.0, f"wheel.bore_taper: {wheel.bore_taper} closes the bore before its rear face")
    if wheel.web_thickness > 0.0:
        _check_web(wheel)


def _check_web(wheel: Hub) -> None:
    gap = wheel.rim_inner_radius - wheel.hub_outer_radius
    _need(
        gap > 2.0 * wheel.web_blend,
        f"wheel.rim_inner_radius: {wheel.rim_inner_radius} must be above hub_outer_radius with both fillets, "
        f"{wheel.hub_outer_radius + 2.0 * wheel.web_blend}",
    )
    _need(
        wheel.rim_outer_radius > wheel.rim_inner_radius,
        f"wheel.rim_outer_radius: {wheel.rim_outer_radius} must be above rim_inner_radius, {wheel.rim_inner_radius}",
    )
    _need(
        wheel.rim_width > wheel.web_thickness + 2.0 * wheel.web_blend,
        f"wheel.rim_width: {wheel.rim_width} must be above web_thickness with both fillets",
    )
    room = 0.5 * wheel.hub_length - 0.5 * wheel.web_thickness - wheel.web_blend
    _need(abs(wheel.web_offset) < room, f"wheel.web_offset: {wheel.web_offset} puts the web beside the hub")


def _check_disc(table: str, disc: Disc) -> None:
    _need(
        disc.contact_radius is None or disc.contact_radius <= disc.radius,
        f"{table}.contact_radius: {disc.contact_radius} must not exceed radius, {disc.radius}",
    )
    if disc.crown_radius > 0.0:
        _need(
            disc.radius < disc.crown_radius,
            f"{table}.radius: {disc.radius} must be below crown_radius, {disc.crown_radius}",
        )
        depth = disc.crown_radius - math.sqrt(disc.crown_radius**2 - disc.radius**2)
        _need(
            depth < disc.thickness,
            f"{table}.thickness: {disc.thickness} is less than the cap is deep, {depth:.4g}",
        )


def _check_pair(scene: Scene) -> None:
    axle, wheel = scene.axle, scene.wheel
    shapes = {type(axle), type(wheel)}
    _need(Disc not in shapes or shapes <= {Disc, MeshFile}, "wheel.shape: a disc is pressed against a disc only")
    if MeshFile in shapes and len(shapes) > 1:
        _need(
            scene.contact.direction is not None or Disc not in shapes,
            "contact.direction: say 'axial' or 'radial' where one body is drawn and the other comes from a file",
        )
    if not (isinstance(axle, Shaft) and isinstance(wheel, Hub)):
        return
    _check_interference(scene, axle, wheel)
    _check_penalty(scene, axle)
    start = axle.seat_radius - axle.taper_height
    mouth = (1.0 + scene.thermal_strain) * (wheel.bore_radius + wheel.chamfer_height)
    resting = scene.displacements[0] > 0.0
    _need(
        resting or start <= mouth,
        f"wheel.chamfer_height: the bore's mouth, {mouth}, is narrower than the axle where it enters, {start}; "
        f"give a taper or a chamfer, or motion.start > 0 for a shrink fit",
    )
    _check_beside(scene, axle, wheel)


def _check_interference(scene: Scene, axle: Shaft, wheel: Hub) -> None:
    """The deepest overlap of the profiles over the motion stays within small strain."""
    seat, bore = seat_profile(axle), bore_profile(wheel)
    interference, limit = axle.seat_radius - wheel.bore_radius, SMALL_STRAIN * axle.seat_radius
    if axle.taper == 0.0 and interference <= limit:
        return  # a cylinder is nowhere deeper in a bore that is nowhere narrower
    depth = max(overlap(seat, bore, displacement) for displacement in sampled(scene.displacements))
    _need(
        depth <= limit,
        f"wheel.bore_radius: {wheel.bore_radius} under a seat_radius of {axle.seat_radius} is an interference of "
        f"{depth:.4g} mm, beyond small strain (at most {limit:.3g} mm); "
        f"check whether a diameter was meant",
    )


def _check_beside(scene: Scene, axle: Shaft, wheel: Hub) -> None:
    """Lead and tail, where no contact is looked for, stay clear of the bore."""
    end = axle.seat_radius + 0.5 * axle.taper * axle.seat_length
    tail = end if axle.tail_radius is None else axle.tail_radius
    far = max(scene.displacements)
    _need(
        tail <= bore_profile(wheel)[0][1] or far <= axle.seat_length,
        f"motion.travel: {far} runs the wheel past the end of the seat, {axle.seat_length}, onto a tail wider than the "
        f"bore, where no contact is looked for; lengthen axle.seat_length",
    )
    lead = axle.seat_radius - axle.taper_height if axle.lead_radius is None else axle.lead_radius
    if axle.lead_length == 0.0 or lead <= bore_profile(wheel)[0][1]:
        return
    cylinder = [(-axle.taper_length - axle.lead_length, lead), (-axle.taper_length, lead)]
    at = min(scene.displacements)
    depth = max(overlap(cylinder, bore_profile(wheel), displacement) for displacement in sampled(scene.displacements))
    _need(
        depth <= 1e-9,
        f"axle.lead_radius: {lead} is wider than the bore, {wheel.bore_radius}, that is over it at a displacement of "
        f"{at} mm, where no contact is looked for; give a smaller lead_radius, or a higher taper_height",
    )


def _check_surfaces(scene: Scene) -> None:
    """Profiles and heat are of a radial gap, and only the wheel is heated."""
    for table, body in (("axle", scene.axle), ("wheel", scene.wheel)):
        for key in ("profile", "temperature"):
            _need(
                not getattr(body, key, None) or scene.direction == "radial",
                f"{table}.{key}: changes the radius of a seat or a bore, and the gap is axial here; leave it out",
            )
    _need(
        not getattr(scene.axle, "temperature", 0.0),
        AXLE_TEMPERATURE,
    )
    cooling = scene.motion.cooling
    _need(
        not cooling or scene.thermal_strain > 0.0,
        f"motion.cooling: {cooling} increments of a wheel that is not heated; give wheel.temperature too",
    )
    for body_name in ("axle", "wheel"):
        deviation_of(scene, body_name)


def _check_penalty(scene: Scene, axle: Shaft) -> None:
    """A fit presses with about E / (2 R) times its interference: a stiffness of E / (2 R) leaves more than half."""
    given, least = scene.contact.penalty_stiffness, 0.5 * axle.material.youngs_modulus / axle.seat_radius
    _need(
        scene.contact.formulation != "penalty" or given is None or given >= least,
        f"contact.penalty_stiffness: {given} leaves most of the interference; give at least "
        f"{10.0 * axle.material.youngs_modulus:.3g} (10 E per mm), or leave it out",
    )


def _check_motion(scene: Scene) -> None:
    motion = scene.motion
    if motion.displacements is not None:
        _need(
            motion.start == 0.0 and motion.travel == 0.0 and motion.increment == 1.0,
            "motion.displacements: leave out start, travel and increment where a list is given",
        )
        steps = zip(motion.displacements, motion.displacements[1:], strict=False)
        _need(all(a != b for a, b in steps), "motion.displacements: two equal displacements follow each other")
    else:
        _need(
            motion.travel >= motion.start,
            f"motion.travel: {motion.travel} lies before motion.start, {motion.start}; "
            f"for a reversal list motion.displacements",
        )
        count = (motion.travel - motion.start) / motion.increment
        _need(
            count <= 1e6,
            f"motion.increment: {motion.increment} makes {count:.3g} increments; at most a million",
        )


def _blend_reach(radius: float, length: float, height: float, taper: float) -> float:
    """Tangent length of an arc blending a slope of height/length into a cylinder or cone: R tan(alpha / 2)."""
    if length == 0.0:
        return 0.0
    return radius * math.tan(0.5 * abs(math.atan2(height, length) - math.atan(0.5 * taper)))
