"""The checks across the keys of a scene: each failure names the key and what to try."""

from __future__ import annotations

import math

from ..errors import SceneError
from .keys import Disc, Hub, MeshFile, Scene, Shaft


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
        if isinstance(body, Disc):
            _check_disc(table, body)
    if isinstance(scene.axle, Shaft):
        _check_shaft(scene.axle)
    if isinstance(scene.wheel, Hub):
        _check_hub(scene.wheel)
    _check_pair(scene)
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
    reach = _blend_reach(axle.taper_blend, axle.taper_length, axle.taper_height)
    _need(
        reach <= min(axle.taper_length, axle.seat_length) + 1e-12,
        f"axle.taper_blend: an arc of radius {axle.taper_blend} reaches {reach:.3g} mm along taper and seat, "
        f"more than there is; try a smaller radius",
    )
    tail = axle.seat_radius if axle.tail_radius is None else axle.tail_radius
    _need(
        axle.tail_blend <= min(abs(axle.seat_radius - tail), axle.tail_length) + 1e-12,
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
    reach = _blend_reach(wheel.chamfer_blend, wheel.chamfer_length, wheel.chamfer_height)
    _need(
        reach <= wheel.chamfer_length + 1e-12,
        f"wheel.chamfer_blend: an arc of radius {wheel.chamfer_blend} reaches {reach:.3g} mm along the chamfer, "
        f"more than there is; try a smaller radius",
    )
    _need(
        wheel.chamfer_length + reach + wheel.rear_edge_blend < wheel.hub_length,
        f"wheel.hub_length: {wheel.hub_length} leaves no bore between chamfer and rear edge",
    )
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
    interference = axle.seat_radius - wheel.bore_radius
    _need(
        interference <= 0.02 * axle.seat_radius,
        f"wheel.bore_radius: {wheel.bore_radius} under a seat_radius of {axle.seat_radius} is an interference of "
        f"{interference:.4g} mm, beyond small strain (at most {0.02 * axle.seat_radius:.3g} mm); "
        f"check whether a diameter was meant",
    )
    _check_penalty(scene, axle)
    start = axle.seat_radius - axle.taper_height
    mouth = wheel.bore_radius + wheel.chamfer_height
    resting = scene.displacements[0] > 0.0
    _need(
        resting or start <= mouth,
        f"wheel.chamfer_height: the bore's mouth, {mouth}, is narrower than the axle where it enters, {start}; "
        f"give a taper or a chamfer, or motion.start > 0 for a shrink fit",
    )
    tail = axle.seat_radius if axle.tail_radius is None else axle.tail_radius
    far = max(scene.displacements)
    _need(
        tail <= wheel.bore_radius or far <= axle.seat_length,
        f"motion.travel: {far} runs the wheel past the end of the seat, {axle.seat_length}, onto a tail wider than the "
        f"bore, where no contact is looked for; lengthen axle.seat_length",
    )


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


def _blend_reach(radius: float, length: float, height: float) -> float:
    """Tangent length of an arc blending a slope of height/length into a cylinder: R tan(alpha / 2)."""
    return radius * math.tan(0.5 * math.atan2(height, length)) if length > 0.0 else 0.0
