"""Keys of a scene that are given and do nothing, so that nobody believes that they did."""

from __future__ import annotations

from .keys import Hub, Scene, Shaft

WEB = ("web_offset", "web_blend", "rim_inner_radius", "rim_outer_radius", "rim_width")
"""Keys of web and rim, which a plain ring has not."""

FILES = "where no body comes from a file"


def idle_keys(scene: Scene) -> list[str]:
    """A line for each key that has another value than its default and changes nothing: which, and why."""
    return [
        *_of_contact(scene), *_of_axle(scene), *_of_wheel(scene), *_of_heat(scene), *_of_mesh(scene),
        *_of_output(scene),
    ]  # fmt: skip


def _of_contact(scene: Scene) -> list[str]:
    keys = scene.contact
    if keys.formulation == "nitsche":
        unused = [("penalty_stiffness", keys.penalty_stiffness)]
    else:
        unused = [("gamma0", keys.gamma0), ("theta", keys.theta or None)]
    why = f"under contact.formulation = '{keys.formulation}'"
    drawn = scene.mesh.axle is None and scene.mesh.wheel is None
    lenient = [_idle("contact.allow_no_contact", True, FILES)] if keys.allow_no_contact and drawn else []
    return lenient + [_idle(f"contact.{name}", value, why) for name, value in unused if value is not None]


def _of_axle(scene: Scene) -> list[str]:
    axle = scene.axle
    if not isinstance(axle, Shaft):
        return []
    idle = axle.taper_blend and not (axle.taper_height or axle.taper)
    return [_idle("axle.taper_blend", axle.taper_blend, "without axle.taper_height")] if idle else []


def _of_wheel(scene: Scene) -> list[str]:
    wheel = scene.wheel
    if not isinstance(wheel, Hub):
        return []
    lines = []
    if wheel.chamfer_blend and not (wheel.chamfer_height or wheel.bore_taper):
        lines.append(_idle("wheel.chamfer_blend", wheel.chamfer_blend, "without wheel.chamfer_height"))
    if not wheel.web_thickness:
        given = [(key, getattr(wheel, key)) for key in WEB if getattr(wheel, key)]
        lines += [_idle(f"wheel.{key}", value, "without wheel.web_thickness") for key, value in given]
    return lines


def _of_heat(scene: Scene) -> list[str]:
    given = {"wheel": scene.wheel.material.expansion if scene.thermal_strain == 0.0 else None}
    given["axle"] = scene.axle.material.expansion
    why = {"wheel": "without wheel.temperature", "axle": "for the axle is not heated"}
    return [_idle(f"{body}.material.expansion", value, why[body]) for body, value in given.items() if value]


def _of_mesh(scene: Scene) -> list[str]:
    mesh = scene.mesh
    if mesh.axle is None and mesh.wheel is None and mesh.unit is not None:
        return [_idle("mesh.unit", mesh.unit, FILES)]
    if mesh.axle is not None and mesh.wheel is not None:
        default, why = type(mesh)(), "where both bodies come from files, which have their own elements"
        sizes = ("seat_facet", "bore_facet", "corner_facet", "coarse", "growth")
        given = [(key, getattr(mesh, key)) for key in sizes if getattr(mesh, key) != getattr(default, key)]
        return [_idle(f"mesh.{key}", value, why) for key, value in given]
    return []


def _of_output(scene: Scene) -> list[str]:
    output = scene.output
    if output.fields:
        return []
    given = [("frames", output.frames), ("fields_at", output.fields_at)]
    return [_idle(f"output.{key}", value, "without output.fields") for key, value in given if value]


def _idle(key: str, value: object, why: str) -> str:
    return f"{key} = {value} does nothing {why}"
