"""The scene: frozen records decoded strictly from TOML, and the checks across their keys.

Lengths in mm, forces in N, moduli in MPa. This is the only reader of TOML in the package.
"""

from __future__ import annotations

import difflib
import math
import re
import tomllib
from collections.abc import Iterable, Mapping
from importlib import resources
from pathlib import Path
from typing import Any, Literal

import msgspec

from .errors import SceneError
from .material import Material


class _Keys(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Base of every table of a scene: frozen, and an unknown key is an error."""


class Shaft(_Keys, tag="shaft", tag_field="shape"):
    """An axle: lead, taper, seat and tail along z; the seat's entrance (end of the taper) is z = 0."""

    seat_radius: float
    seat_length: float
    taper_length: float = 0.0  # before the seat, from seat_radius - taper_height up to seat_radius
    taper_height: float = 0.0
    taper_blend: float = 0.0  # radius of the arc between taper and seat; 0: a sharp corner
    lead_length: float = 0.0  # cylinder before the taper
    lead_radius: float | None = None  # None: where the taper starts
    tail_length: float = 0.0  # cylinder behind the seat; its far end is held axially
    tail_radius: float | None = None  # None: seat_radius, no shoulder
    tail_blend: float = 0.0  # fillet in the corner of the shoulder
    inner_radius: float = 0.0  # 0: a solid axle
    material: Material = Material()


class Hub(_Keys, tag="wheel", tag_field="shape"):
    """A wheel or, with web_thickness = 0, a plain ring; z is measured from its leading face, backwards."""

    bore_radius: float
    hub_length: float
    hub_outer_radius: float
    chamfer_length: float = 0.0  # at the leading edge, from bore_radius + chamfer_height to bore_radius
    chamfer_height: float = 0.0
    chamfer_blend: float = 0.0  # radius of the arc between chamfer and bore; 0: a sharp corner
    rear_edge_blend: float = 0.0  # rounding of the bore's rear edge; 0: a sharp edge
    web_thickness: float = 0.0
    web_offset: float = 0.0  # from the middle of the hub to the middle of web and rim, towards the leading face
    web_blend: float = 0.0  # fillets where the web meets hub and rim
    rim_inner_radius: float = 0.0
    rim_outer_radius: float = 0.0
    rim_width: float = 0.0
    material: Material = Material()


class Disc(_Keys, tag="disc", tag_field="shape"):
    """A disc or spherical cap on the axis, pressed along z; as axle it is held, as wheel it is pushed."""

    radius: float
    thickness: float
    crown_radius: float = 0.0  # sphere radius of the contact face; 0: flat
    contact_radius: float | None = None  # how far from the axis contact is looked for; None: radius
    material: Material = Material()


class Drawn(_Keys, tag="mesh", tag_field="shape"):
    """A body whose shape comes from a mesh file (see ``[mesh]``): only its material is left to say."""

    material: Material = Material()


class MeshKeys(_Keys):
    """Element order and sizes, or the user's own mesh files."""

    order: Literal[1, 2] = 2
    seat_facet: float = 1.0  # length of a facet of the seat [mm]
    bore_facet: float | None = None  # None: 0.97 seat_facet, so that the two lines never repeat their phase
    coarse: float = 20.0  # largest element [mm]
    growth: float = 0.35  # growth of the element size with the distance from the contact line
    axle: str | None = None
    wheel: str | None = None


class ContactKeys(_Keys):
    """How the contact conditions are imposed (see docs of ``macrofit.contact``)."""

    formulation: Literal["nitsche", "penalty"] = "nitsche"
    theta: Literal[-1, 0, 1] = 0
    gamma0: float = 10.0  # gamma = gamma0 E / h
    penalty_stiffness: float | None = None  # MPa/mm; None: 10 E per mm
    direction: Literal["radial", "axial"] | None = None  # of the gap; None: by the shapes


class Motion(_Keys):
    """Displacements of the wheel, 0 where its leading face is at the seat's entrance."""

    start: float = 0.0  # > 0: the interference is resolved in place before anything moves
    travel: float = 0.0  # final displacement
    increment: float = 1.0
    displacements: tuple[float, ...] | None = None  # instead of the three above; may reverse
    max_cutbacks: int = 8


class FrictionKeys(_Keys):
    """The friction provider by its entry-point name, and its options."""

    provider: str = "uniform"
    options: dict[str, Any] = {}


class OutputKeys(_Keys):
    """What is computed and written beyond the fitting curve."""

    stress: bool = True  # maximum von Mises stress of each body over the whole run
    fields_at: tuple[float, ...] | None = None  # displacements; None: the last one
    fields: tuple[Literal["displacement", "von_mises", "stress"], ...] = ("displacement", "von_mises")
    frames: int = 0  # that many more, evenly spaced, for an animation


class Scene(_Keys):
    """Everything that determines a run."""

    axle: Shaft | Disc | Drawn
    wheel: Hub | Disc | Drawn
    motion: Motion
    title: str = ""
    solver: Literal["condensed", "monolithic"] = "condensed"
    mesh: MeshKeys = MeshKeys()
    contact: ContactKeys = ContactKeys()
    friction: FrictionKeys = FrictionKeys()
    output: OutputKeys = OutputKeys()

    @property
    def displacements(self) -> tuple[float, ...]:
        """The displacements of the wheel [mm], the starting one first."""
        motion = self.motion
        if motion.displacements is not None:
            return motion.displacements
        steps = max(0, math.ceil((motion.travel - motion.start) / motion.increment - 1e-9))
        return (*(motion.start + k * motion.increment for k in range(steps)), motion.travel)

    @property
    def direction(self) -> Literal["radial", "axial"]:
        """Direction in which the gap is measured."""
        if self.contact.direction is not None:
            return self.contact.direction
        return "axial" if isinstance(self.axle, Disc) else "radial"

    @property
    def interference(self) -> float | None:
        """Radial interference of the drawn radii [mm]; None where no two radii are drawn."""
        if isinstance(self.axle, Shaft) and isinstance(self.wheel, Hub):
            return self.axle.seat_radius - self.wheel.bore_radius
        return None


def scene_names() -> list[str]:
    """Names of the scenes shipped with the package."""
    folder = resources.files("macrofit") / "scenes"
    return sorted(entry.name[:-5] for entry in folder.iterdir() if entry.name.endswith(".toml"))


def load_scene(source: str | Path, overrides: Iterable[str] = ()) -> Scene:
    """Read a scene: a built-in name or a TOML file, changed by ``key=value`` overrides (dotted keys).

    Raises SceneError with one line that names the key.
    """
    raw, folder = _read(source)
    for override in overrides:
        _override(raw, override)
    return build_scene(raw, folder)


def build_scene(raw: Mapping[str, Any], folder: Path | None = None) -> Scene:
    """Decode and check the tables of a scene; mesh files are looked for beside ``folder``."""
    tables = {key: dict(value) if isinstance(value, Mapping) else value for key, value in raw.items()}
    _name_shapes(tables, folder)
    try:
        scene = msgspec.convert(tables, Scene)
    except msgspec.ValidationError as error:
        raise SceneError(_one_line(error, tables)) from None
    _check_numbers(msgspec.to_builtins(scene), "")
    _check(scene)
    return scene


def dump_scene(scene: Scene) -> str:
    """The scene as TOML, every default written out; ``load_scene`` reads it back to the same scene."""
    tables = msgspec.to_builtins(scene)
    for body in ("axle", "wheel"):
        if tables[body].get("shape") == "mesh":
            tables[body].pop("shape")
    return "\n".join(_toml_lines(tables, ())) + "\n"


def json_schema() -> dict[str, Any]:
    """JSON schema of a scene, for editors."""
    return msgspec.json.schema(Scene)


def _read(source: str | Path) -> tuple[dict[str, Any], Path | None]:
    name = str(source)
    folder: Path | None = None
    if name in scene_names():
        text = (resources.files("macrofit") / "scenes" / f"{name}.toml").read_text()
    else:
        path = Path(source)
        if not path.is_file():
            known = ", ".join(scene_names())
            raise SceneError(f"no scene '{name}': neither a file nor one of the built-in scenes ({known})")
        text, folder = path.read_text(), path.parent
    try:
        return tomllib.loads(text), folder
    except tomllib.TOMLDecodeError as error:
        raise SceneError(f"{name}: not valid TOML: {error}") from None


def _override(raw: dict[str, Any], override: str) -> None:
    key, equals, value = override.partition("=")
    if not equals or not key.strip():
        raise SceneError(f"'{override}': an override is written key=value, for example motion.travel=20")
    try:
        parsed = tomllib.loads(f"value = {value}")["value"]
    except tomllib.TOMLDecodeError:
        parsed = value
    *path, last = key.strip().split(".")
    table = raw
    for part in path:
        table = table.setdefault(part, {})
        if not isinstance(table, dict):
            raise SceneError(f"{key}: '{part}' is not a table")
    table[last] = parsed


def _name_shapes(tables: dict[str, Any], folder: Path | None) -> None:
    """Give each body the tag of its shape, and make the mesh files' paths absolute."""
    mesh = tables.get("mesh")
    for body, default in (("axle", "shaft"), ("wheel", "wheel")):
        file = mesh.get(body) if isinstance(mesh, dict) else None
        if file is not None:
            tables.setdefault(body, {})
            if isinstance(file, str) and folder is not None:
                mesh[body] = str((folder / file).resolve())
        if isinstance(tables.get(body), dict):
            if file is not None and tables[body].get("shape", "mesh") != "mesh":
                raise SceneError(f"{body}.shape: not used where mesh.{body} gives a file; leave one of them out")
            tables[body].setdefault("shape", default if file is None else "mesh")


_FIELDS: dict[str, type[_Keys]] = {
    "": Scene,
    "mesh": MeshKeys,
    "contact": ContactKeys,
    "motion": Motion,
    "friction": FrictionKeys,
    "output": OutputKeys,
}
_SHAPES: dict[str, type[_Keys]] = {"shaft": Shaft, "wheel": Hub, "disc": Disc, "mesh": Drawn}


def _one_line(error: msgspec.ValidationError, tables: Mapping[str, Any]) -> str:
    """Turn msgspec's message into 'table.key: what is wrong (what to try)'."""
    message, _, place = str(error).partition(" - at `$")
    where = place.rstrip("`").lstrip(".").replace("[...]", "")
    unknown = re.search(r"unknown field `(.+)`", message)
    missing = re.search(r"missing required field `(.+)`", message)
    if unknown:
        key = unknown.group(1)
        known = _known_keys(where, tables)
        close = difflib.get_close_matches(key, known, n=1)
        remedy = f"did you mean '{close[0]}'?" if close else f"known keys: {', '.join(known)}"
        return f"{_join(where, key)}: unknown key ({remedy})"
    if missing:
        return f"{_join(where, missing.group(1))}: missing"
    if "Invalid value" in message and where.endswith(".shape"):
        return f"{where}: {message} (try shaft, wheel or disc; a mesh file goes under [mesh])"
    return f"{where or 'scene'}: {message[0].lower()}{message[1:]}"


def _known_keys(where: str, tables: Mapping[str, Any]) -> list[str]:
    struct: type[Any] | None = _FIELDS.get(where)
    if where.endswith(".material"):
        struct = Material
    elif where in ("axle", "wheel"):
        struct = _SHAPES.get(tables[where].get("shape", ""))
    return [] if struct is None else list(struct.__struct_fields__)


def _join(where: str, key: str) -> str:
    return f"{where}.{key}" if where else key


def _check_numbers(value: Any, where: str) -> None:
    """No NaN or infinity anywhere."""
    if isinstance(value, Mapping):
        for key, item in value.items():
            _check_numbers(item, _join(where, key))
    elif isinstance(value, list | tuple):
        for item in value:
            _check_numbers(item, where)
    elif isinstance(value, float) and not math.isfinite(value):
        raise SceneError(f"{where}: {value} is not a finite number")


def _need(condition: bool, message: str) -> None:
    if not condition:
        raise SceneError(message)


def _positive(table: str, struct: Any, *keys: str) -> None:
    for key in keys:
        value = getattr(struct, key)
        _need(value is None or value > 0.0, f"{table}.{key}: {value} must be positive")


def _not_negative(table: str, struct: Any, *keys: str) -> None:
    for key in keys:
        value = getattr(struct, key)
        _need(value is None or value >= 0.0, f"{table}.{key}: {value} must not be negative")


def _check(scene: Scene) -> None:
    for table, body in (("axle", scene.axle), ("wheel", scene.wheel)):
        material = body.material
        _positive(f"{table}.material", material, "youngs_modulus")
        nu = material.poisson_ratio
        _need(-1.0 < nu < 0.5, f"{table}.material.poisson_ratio: {nu} must lie between -1 and 0.5 (exclusive)")
        if isinstance(body, Disc):
            _check_disc(table, body)
    if isinstance(scene.axle, Shaft):
        _check_shaft(scene.axle)
    if isinstance(scene.wheel, Hub):
        _check_hub(scene.wheel)
    _check_pair(scene)
    _positive("mesh", scene.mesh, "seat_facet", "bore_facet", "coarse")
    _not_negative("mesh", scene.mesh, "growth")
    _positive("contact", scene.contact, "gamma0", "penalty_stiffness")
    _check_motion(scene)
    _need(scene.output.frames >= 0, f"output.frames: {scene.output.frames} must not be negative")
    for at in scene.output.fields_at or ():
        low, high = min(scene.displacements), max(scene.displacements)
        _need(low - 1e-9 <= at <= high + 1e-9,
              f"output.fields_at: {at} is outside the motion, {low} to {high} mm")


def _check_shaft(axle: Shaft) -> None:
    _positive("axle", axle, "seat_radius", "seat_length", "lead_radius", "tail_radius")
    _not_negative("axle", axle, "taper_length", "taper_height", "taper_blend", "lead_length", "tail_length",
                  "tail_blend", "inner_radius")
    start = axle.seat_radius - axle.taper_height
    _need(start > axle.inner_radius,
          f"axle.inner_radius: {axle.inner_radius} must be below the radius where the taper starts, {start}")
    for key in ("lead_radius", "tail_radius"):
        value = getattr(axle, key)
        _need(value is None or value > axle.inner_radius,
              f"axle.{key}: {value} must be above axle.inner_radius, {axle.inner_radius}")
    _need(axle.taper_length > 0.0 or axle.taper_height == 0.0,
          "axle.taper_length: must be positive where taper_height is given")
    _need(axle.lead_radius is None or axle.lead_radius <= start,
          f"axle.lead_radius: {axle.lead_radius} must not exceed the radius where the taper starts, {start}")
    reach = _blend_reach(axle.taper_blend, axle.taper_length, axle.taper_height)
    _need(reach <= min(axle.taper_length, axle.seat_length) + 1e-12,
          f"axle.taper_blend: an arc of radius {axle.taper_blend} reaches {reach:.3g} mm along taper and seat, "
          f"more than there is; try a smaller radius")
    tail = axle.seat_radius if axle.tail_radius is None else axle.tail_radius
    _need(axle.tail_blend <= min(abs(axle.seat_radius - tail), axle.tail_length) + 1e-12,
          f"axle.tail_blend: {axle.tail_blend} does not fit the shoulder or the tail")


def _check_hub(wheel: Hub) -> None:
    _positive("wheel", wheel, "bore_radius", "hub_length", "hub_outer_radius")
    _not_negative("wheel", wheel, "chamfer_length", "chamfer_height", "chamfer_blend", "rear_edge_blend",
                  "web_thickness", "web_blend", "rim_inner_radius", "rim_outer_radius", "rim_width")
    _need(wheel.hub_outer_radius > wheel.bore_radius + max(wheel.chamfer_height, wheel.rear_edge_blend),
          f"wheel.hub_outer_radius: {wheel.hub_outer_radius} must be above the bore with its chamfer, "
          f"{wheel.bore_radius + wheel.chamfer_height}")
    _need(wheel.chamfer_length > 0.0 or wheel.chamfer_height == 0.0,
          "wheel.chamfer_length: must be positive where chamfer_height is given")
    reach = _blend_reach(wheel.chamfer_blend, wheel.chamfer_length, wheel.chamfer_height)
    _need(reach <= wheel.chamfer_length + 1e-12,
          f"wheel.chamfer_blend: an arc of radius {wheel.chamfer_blend} reaches {reach:.3g} mm along the chamfer, "
          f"more than there is; try a smaller radius")
    _need(wheel.chamfer_length + reach + wheel.rear_edge_blend < wheel.hub_length,
          f"wheel.hub_length: {wheel.hub_length} leaves no bore between chamfer and rear edge")
    if wheel.web_thickness > 0.0:
        _check_web(wheel)


def _check_web(wheel: Hub) -> None:
    gap = wheel.rim_inner_radius - wheel.hub_outer_radius
    _need(gap > 2.0 * wheel.web_blend,
          f"wheel.rim_inner_radius: {wheel.rim_inner_radius} must be above hub_outer_radius with both fillets, "
          f"{wheel.hub_outer_radius + 2.0 * wheel.web_blend}")
    _need(wheel.rim_outer_radius > wheel.rim_inner_radius,
          f"wheel.rim_outer_radius: {wheel.rim_outer_radius} must be above rim_inner_radius, "
          f"{wheel.rim_inner_radius}")
    _need(wheel.rim_width > wheel.web_thickness + 2.0 * wheel.web_blend,
          f"wheel.rim_width: {wheel.rim_width} must be above web_thickness with both fillets")
    room = 0.5 * wheel.hub_length - 0.5 * wheel.web_thickness - wheel.web_blend
    _need(abs(wheel.web_offset) < room, f"wheel.web_offset: {wheel.web_offset} puts the web beside the hub")


def _check_disc(table: str, disc: Disc) -> None:
    _positive(table, disc, "radius", "thickness", "contact_radius")
    _not_negative(table, disc, "crown_radius")
    _need(disc.contact_radius is None or disc.contact_radius <= disc.radius,
          f"{table}.contact_radius: {disc.contact_radius} must not exceed radius, {disc.radius}")
    if disc.crown_radius > 0.0:
        _need(disc.radius < disc.crown_radius,
              f"{table}.radius: {disc.radius} must be below crown_radius, {disc.crown_radius}")
        depth = disc.crown_radius - math.sqrt(disc.crown_radius**2 - disc.radius**2)
        _need(depth < disc.thickness, f"{table}.thickness: {disc.thickness} is less than the cap is deep, {depth:.4g}")


def _check_pair(scene: Scene) -> None:
    axle, wheel = scene.axle, scene.wheel
    shapes = {type(axle), type(wheel)}
    _need(Disc not in shapes or shapes <= {Disc, Drawn}, "wheel.shape: a disc is pressed against a disc only")
    if Drawn in shapes and len(shapes) > 1:
        _need(scene.contact.direction is not None or Disc not in shapes,
              "contact.direction: say 'axial' or 'radial' where one body is drawn and the other comes from a file")
    if not (isinstance(axle, Shaft) and isinstance(wheel, Hub)):
        return
    interference = axle.seat_radius - wheel.bore_radius
    _need(interference < 0.02 * axle.seat_radius,
          f"wheel.bore_radius: {wheel.bore_radius} under a seat_radius of {axle.seat_radius} is an interference of "
          f"{interference:.4g} mm, beyond small strain (at most {0.02 * axle.seat_radius:.3g} mm); "
          f"check whether a diameter was meant")
    start = axle.seat_radius - axle.taper_height
    mouth = wheel.bore_radius + wheel.chamfer_height
    resting = scene.displacements[0] > 0.0
    _need(resting or start <= mouth,
          f"wheel.chamfer_height: the bore's mouth, {mouth}, is narrower than the axle where it enters, {start}; "
          f"give a taper or a chamfer, or motion.start > 0 for a shrink fit")
    tail = axle.seat_radius if axle.tail_radius is None else axle.tail_radius
    far = max(scene.displacements)
    _need(tail <= max(axle.seat_radius, wheel.bore_radius) or far <= axle.seat_length,
          f"motion.travel: {far} runs the wheel into the shoulder behind the seat, at {axle.seat_length}")


def _check_motion(scene: Scene) -> None:
    motion = scene.motion
    _positive("motion", motion, "increment")
    _need(motion.max_cutbacks >= 0, f"motion.max_cutbacks: {motion.max_cutbacks} must not be negative")
    if motion.displacements is not None:
        _need(len(motion.displacements) > 0, "motion.displacements: is empty")
        _need(motion.start == 0.0 and motion.travel == 0.0,
              "motion.displacements: leave out start and travel where a list is given")
        steps = zip(motion.displacements, motion.displacements[1:], strict=False)
        _need(all(a != b for a, b in steps), "motion.displacements: two equal displacements follow each other")
    else:
        _need(motion.travel >= motion.start,
              f"motion.travel: {motion.travel} lies before motion.start, {motion.start}; "
              f"for a reversal list motion.displacements")
        count = (motion.travel - motion.start) / motion.increment
        _need(count <= 1e6, f"motion.increment: {motion.increment} makes {count:.3g} increments; at most a million")


def _blend_reach(radius: float, length: float, height: float) -> float:
    """Tangent length of an arc blending a slope of height/length into a cylinder: R tan(alpha / 2)."""
    return radius * math.tan(0.5 * math.atan2(height, length)) if length > 0.0 else 0.0


def _toml_lines(table: Mapping[str, Any], path: tuple[str, ...]) -> list[str]:
    lines = [f"{key} = {_toml_value(value)}" for key, value in table.items()
             if value is not None and not isinstance(value, Mapping)]
    for key, value in table.items():
        if isinstance(value, Mapping):
            lines += ["", f"[{'.'.join((*path, key))}]", *_toml_lines(value, (*path, key))]
    return lines


def _toml_value(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, list | tuple):
        return f"[{', '.join(_toml_value(item) for item in value)}]"
    if isinstance(value, str):
        return msgspec.json.encode(value).decode()
    return repr(value)
