"""What a friction test needs to know: every key with its default, meaning, unit and bounds.

Lengths in mm, forces in N, moduli and pressures in MPa, speeds in mm/s.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Annotated, Any, Literal, Self, TypeAlias

import msgspec

from macrofit.base.errors import OutputError
from macrofit.base.files import placed_names
from macrofit.base.keys import KeyMistake, Keys, Positive, decode_tables, told
from macrofit.base.toml import dump_toml, errors_as, read_toml, set_key, split_override

from .errors import SettingsError
from .material import Beams, ExternalFace, ExternalModulus, Material, PlateModulus
from .measured.keys import Measured, ScanKeys, scan_keys
from .presets import DEFAULT, PRESETS, on_preset

EngineName = Literal["auto", "quasi-static", "explicit"]
SPEED = 20_000.0
"""Speed of the slide in the explicit engine, where none is given [mm/s]."""
FASTEST = 3e6
"""Largest speed [mm/s], about that of shear waves in steel: beyond it a plate is gone before it has felt the other."""
DYNAMIC = ("time_step", "breakage", "resonance")
"""Keys of the engine that ask for the explicit one."""


Speed: TypeAlias = Annotated[float, msgspec.Meta(gt=0.0, le=FASTEST)]
Resonance: TypeAlias = Annotated[float, msgspec.Meta(gt=0.0, le=100.0)]
Seed: TypeAlias = Annotated[int, msgspec.Meta(ge=0, le=2**32 - 1)]
Height: TypeAlias = Annotated[float, msgspec.Meta(ge=0.0, le=1.0)]
Coefficient: TypeAlias = Annotated[float, msgspec.Meta(ge=0.0, le=2.0)]


POINTS_OF_A_GROOVE = 4
"""Least number of spacings in a groove [-]."""
MOST_POINTS_OF_A_ROLL_OFF = 2048
"""Largest number of spacings in a roll-off wavelength: the transforms of longer ones fill the memory [-]."""


GENERATED = (
    "generator", "levels", "max_height", "rms_height", "hurst_exponent", "roll_off", "lay", "feed", "groove_depth",
    "anisotropy",
)  # fmt: skip
"""Keys of generated faces."""
SHARED = "is the face of the axle and of the bore, which are then no independent faces"
"""What is said of a file that is both."""


class FaceKeys(Keys, frozen=True):
    """How a rough face is made, whatever its seed."""

    form: Annotated[
        Literal["strip", "tiles", "levelled"],
        told(
            "A piece of one continuous roughness along the body; each tile by itself; or so, without its mean plane. "
            "On a strip a seed is 65536 times its number, plus the place in tiles."
        ),
    ] = "strip"
    generator: Annotated[
        Literal["diamond_square", "self_affine"], told("How the heights are made: Diamond-Square, or from a spectrum.")
    ] = "diamond_square"
    levels: Annotated[int, told("Subdivisions n: 2^n + 1 points along 1 mm [-]."), msgspec.Meta(ge=1, le=10)] = 3
    max_height: Annotated[Height, told("Range R: corners and noise of Diamond-Square lie in [-R/2, R/2] [mm].")] = 0.02
    rms_height: Annotated[Height, told("Root mean square height Sq of the self-affine generator [mm].")] = 0.0016
    hurst_exponent: Annotated[
        float, told("Hurst exponent, from 0 (rough) to 1 (smooth) [-]."), msgspec.Meta(ge=0.0, le=1.0)
    ] = 0.8
    roll_off: Annotated[
        float, told("Self-affine strip: wavelength above which the spectrum is flat [mm]."),
        msgspec.Meta(ge=0.01, le=4.0),
    ] = 0.8  # fmt: skip
    lay: Annotated[
        Literal["isotropic", "turned", "ground"],
        told("None; grooves around the body, across the slide; or scratches drawn out so."),
    ] = "isotropic"
    feed: Annotated[Positive, told("Turned: distance of the grooves along the slide [mm].")] = 0.25
    groove_depth: Annotated[
        Height, told("Turned: depth of the grooves [mm], feed^2 / (8 nose radius); the rest is random.")
    ] = 0.008
    anisotropy: Annotated[
        float, told("Ground: wavelengths around the body over those along it [-]."), msgspec.Meta(ge=1.0, le=1000.0)
    ] = 8.0

    axle: Annotated[
        Measured | None, told("Measured face of the axle: a file, a list of patches, or a table; left out: generated.")
    ] = None
    bore: Annotated[Measured | None, told("Measured face of the wheel's bore, as the axle's.")] = None

    def measured(self, body: Literal["wheel", "axle"]) -> ScanKeys | None:
        """The keys of the measured face of a body; None where it is generated."""
        given = self.axle if body == "axle" else self.bore
        return None if given is None else scan_keys(given)

    def shared_files(self) -> list[str]:
        """Names of files that are both faces; `SHARED` says so."""
        axle, bore = self.measured("axle"), self.measured("wheel")
        if axle is None or bore is None:
            return []
        there = {*bore.sha256, *(Path(name).resolve() for name in bore.files)}
        digests = axle.sha256 or axle.files  # no name is a digest
        known = zip(axle.files, digests, strict=True)
        return [name for name, sha256 in known if sha256 in there or Path(name).resolve() in there]

    def found(self) -> Self:
        """The same with the digests of the files of measured faces.

        Raises:
            SettingsError: a file that cannot be read, by its key; or whose content is not that of its digest.
        """
        if self.axle is None and self.bore is None:
            return self
        keys: dict[str, ScanKeys] = {}
        for name, given in (("axle", self.axle), ("bore", self.bore)):
            if given is not None:
                keys[name] = _digested(f"surface.{name}", scan_keys(given))
        return msgspec.structs.replace(self, **keys)

    def check(self, width: float) -> None:
        """Check that the grid of a face of this width [mm] holds what is asked for.

        Raises:
            SettingsError: grooves too narrow for it, or a roll-off too long; a key of generated faces where none is.
        """
        if self.axle is not None and self.bore is not None:
            self._check_idle()
            return
        whole = self.generator == "diamond_square"
        cells = 2**self.levels if whole else max(2, round(width * 2**self.levels))  # across the width
        if self.lay == "turned" and self.feed * cells < POINTS_OF_A_GROOVE * width * (1.0 - 1e-9):
            raise SettingsError(
                f"surface.feed = {self.feed:g} mm is less than {POINTS_OF_A_GROOVE} spacings of {width / cells:g} mm: "
                "take a larger feed or more surface.levels"
            )
        if not whole and self.form == "strip" and self.roll_off * cells > MOST_POINTS_OF_A_ROLL_OFF * width:
            raise SettingsError(
                f"surface.roll_off = {self.roll_off:g} mm is more than {MOST_POINTS_OF_A_ROLL_OFF} spacings of "
                f"{width / cells:g} mm: take a shorter one or fewer surface.levels"
            )

    def _check_idle(self) -> None:
        """Refuse keys of generated faces where both come from files; those of a preset are nobody's."""
        for key in GENERATED:
            value = getattr(self, key)
            presets = [preset.tables.get("surface", {}).get(key) for preset in PRESETS.values()]
            if value not in (getattr(FaceKeys(), key), *presets):
                raise SettingsError(
                    f"surface.{key} = {value!r} is for generated faces, and both come from files: leave it out"
                )


def _digested(key: str, keys: ScanKeys) -> ScanKeys:
    """The keys of a measured face with the digests of its files; digests that are there already must be theirs."""
    try:
        found = keys.found()
    except OutputError as error:
        raise SettingsError(f"{key}: {error}") from None
    if keys.sha256 not in ((), found.sha256):
        raise SettingsError(
            f"{key}.sha256: the content of {', '.join(keys.files)} is another: put the files back, or take the key out "
            "and begin anew"
        )
    return found


class SurfaceKeys(FaceKeys, frozen=True):
    """Both rough faces; the two differ by their seeds."""

    wheel_seed: Annotated[Seed, told("Seed of the random heights of the wheel's face.")] = 1
    axle_seed: Annotated[Seed, told("Seed of the random heights of the axle's face.")] = 2


class PlateKeys(Keys, frozen=True):
    """The wheel's plate is edge x edge x thickness, the axle's longer by the slide."""

    spheres: Annotated[int, told("Spheres of both plates together [-]."), msgspec.Meta(ge=1, le=1_000_000)] = 3000
    thickness: Annotated[Positive, told("Thickness H of a plate [mm].")] = 0.3
    edge: Annotated[Positive, told("Edge of the apparent area of contact [mm].")] = 1.0
    cube: Annotated[Positive, told("Height L of the solid that plate and external face together stand for [mm].")] = 1.0
    packing_seed: Annotated[Seed, told("Seed of the packings of both plates.")] = 0
    axle_packing_seed: Annotated[
        Seed | None, told("Seed of the packing of the axle's plate, where it is not packing_seed.")
    ] = None
    external_face: Annotated[ExternalFace, told("How the bars behind a plate resist shear.")] = "solid"
    external_modulus: Annotated[ExternalModulus, told("Modulus of the bars behind a plate.")] = "series"
    modulus: Annotated[
        PlateModulus, told("Beams scaled so that each plate has the material's modulus, or taken as they are.")
    ] = "material"

    def check(self) -> None:
        """Check what one key alone cannot say.

        Raises:
            SettingsError: the plate is thicker than the solid it is a part of.
        """
        if self.cube <= self.thickness:
            raise SettingsError(
                f"plates.cube = {self.cube:g} mm must be larger than plates.thickness = {self.thickness:g} mm"
            )


class ContactKeys(Keys, frozen=True):
    """Sphere on sphere, between the plates: k_n = normal_stiffness E_M (r_i + r_j)/2, k_t = tangential_ratio k_n."""

    micro_friction: Annotated[
        Coefficient | Annotated[tuple[Coefficient, ...], msgspec.Meta(min_length=1)],
        told("Coefficient of friction of sphere on sphere, or several [-]."),
    ] = 0.07
    normal_stiffness: Annotated[
        float, told("Normal stiffness of a contact over E_M (r_i + r_j)/2 [-]."), msgspec.Meta(ge=0.02, le=100.0)
    ] = 1.0
    tangential_ratio: Annotated[
        float, told("Tangential over normal stiffness of a contact [-]."), msgspec.Meta(ge=0.01, le=100.0)
    ] = 0.8

    @property
    def coefficients(self) -> tuple[float, ...]:
        """The micro coefficients asked for."""
        return self.micro_friction if isinstance(self.micro_friction, tuple) else (self.micro_friction,)


class LoadKeys(Keys, frozen=True):
    """Squeeze to a nominal pressure or by an interference, then slide."""

    pressure: Annotated[
        float, told("Normal force over the apparent area at the end of the squeeze [MPa]."),
        msgspec.Meta(ge=1e-3, le=5000.0),
    ] = 170.0  # fmt: skip
    interference: Annotated[Positive | None, told("Approach after the first touch, instead of the pressure [mm].")] = (
        None
    )
    slide: Annotated[float, told("Length of the slide [mm]."), msgspec.Meta(ge=1e-3, le=100.0)] = 1.0
    control: Annotated[Literal["displacement", "force"], told("What is held while sliding.")] = "displacement"

    def check(self) -> None:
        """Check what one key alone cannot say.

        Raises:
            SettingsError: an interference where the force is held.
        """
        if self.interference is not None and self.control == "force":
            raise SettingsError("load.interference is not used where load.control = 'force': leave it out")


class EngineKeys(Keys, frozen=True):
    """How the slide is computed."""

    name: Annotated[EngineName, told("Quasi-static increments, explicit time steps, or what suits the keys.")] = "auto"
    samples: Annotated[int, told("Rows of the curve [-]."), msgspec.Meta(ge=10, le=1_000_000)] = 250
    increment: Annotated[
        float, told("Quasi-static: largest slide per increment [mm]."), msgspec.Meta(ge=1e-5, le=0.1)
    ] = 0.004
    tolerance: Annotated[
        float, told("Quasi-static: residual over the largest contact force [-]."), msgspec.Meta(ge=1e-9, le=0.05)
    ] = 1e-3
    speed: Annotated[Speed, told("Explicit: speed of the slide [mm/s].")] = SPEED
    resonance: Annotated[
        Resonance | None, told("Explicit, and asks for it: speed over the plates' f d, in place of engine.speed [-].")
    ] = None
    approach_speed: Annotated[Speed, told("Explicit: speed of the squeeze [mm/s].")] = 2_000.0
    damping_length: Annotated[
        Positive, told("Explicit: the slide's rate of damping is the speed over this length [mm].")
    ] = 0.08
    squeeze_damping: Annotated[Positive, told("Explicit: rate of damping during the squeeze [1/s].")] = 6e6
    safety: Annotated[float, told("Explicit: time step over the critical one [-]."), msgspec.Meta(ge=1e-3, le=1.0)] = (
        0.9
    )
    time_step: Annotated[
        Positive | None, told("Explicit, and asks for it: time step instead of safety [s]; refused above the limit.")
    ] = None
    breakage: Annotated[Breakage | None, told("Strengths of the beams; left out: no beam breaks.")] = None

    def check(self) -> None:
        """Check what one key alone cannot say.

        Raises:
            SettingsError: a key of the explicit engine where the quasi-static one is asked for; two speeds.
        """
        if self.name == "quasi-static":
            for key in DYNAMIC:
                if getattr(self, key) is not None:
                    raise SettingsError(f"engine.{key} asks for engine.name = 'explicit' (or 'auto')")
        if self.resonance is not None and self.speed != SPEED:
            raise SettingsError("engine.speed and engine.resonance both say how fast to slide: leave one out")

    @property
    def dynamic(self) -> bool:
        """Whether a key is given that only the explicit engine knows."""
        return any(getattr(self, key) is not None for key in DYNAMIC)


class Breakage(Keys, frozen=True):
    """Beams break where their largest stress passes a strength; both are microscopic."""

    tensile_strength: Annotated[Positive, told("Tensile strength of a beam [MPa].")]
    shear_strength: Annotated[Positive, told("Shear strength of a beam [MPa].")]


class Settings(Keys, frozen=True):
    """Everything a friction test depends on."""

    title: Annotated[str, told("Title, for summary and figures.")] = "Two rough plates"
    surface: Annotated[SurfaceKeys, told("Both rough faces.")] = SurfaceKeys()
    plates: Annotated[PlateKeys, told("Size and packing of the plates.")] = PlateKeys()
    material: Annotated[Material, told("Elastic solid that the plates stand for.")] = Material()
    beams: Annotated[Beams | None, told("Beams between the spheres; left out: of the stored calibration.")] = None
    contact: Annotated[ContactKeys, told("Contact of sphere on sphere.")] = ContactKeys()
    load: Annotated[LoadKeys, told("Squeeze and slide.")] = LoadKeys()
    engine: Annotated[EngineKeys, told("How the slide is computed.")] = EngineKeys()

    def check(self) -> Settings:
        """Itself, when all its values and their combinations can be computed.

        Raises:
            SettingsError: naming the key, its value and what to take.
        """
        self.surface.check(self.plates.edge)
        for table in (self.plates, self.load, self.engine):
            table.check()
        if self.load.interference is not None and self.load.interference > 0.3 * self.plates.thickness:
            raise SettingsError(
                f"load.interference = {self.load.interference:g} mm is too much: take less than 0.3 of "
                f"plates.thickness = {self.plates.thickness:g} mm"
            )
        if self.plates.external_face == "beams" and self.engine.name == "auto" and not self.engine.dynamic:
            raise SettingsError(
                "plates.external_face = 'beams' sways, and each engine answers otherwise (for micro_friction = 0.07 "
                "about 0.08 in equilibrium, 0.11 near the resonance): set engine.resonance = 0.75, or engine.name = "
                "'explicit' and engine.speed, or engine.name = 'quasi-static'"
            )
        squares = (self.plates.edge + self.load.slide) / self.plates.edge
        generated = self.surface.axle is None or self.surface.bore is None
        if generated and self.surface.generator == "diamond_square" and abs(squares - round(squares)) > 1e-9:
            raise SettingsError(
                f"load.slide = {self.load.slide:g} mm must be a whole number of plates.edge = {self.plates.edge:g} mm "
                "for Diamond-Square surfaces; take surface.generator = 'self_affine' for others"
            )
        return self

    @property
    def fingerprint(self) -> str:
        """Hash of all keys but the title, for the names of caches."""
        text = msgspec.json.encode(msgspec.structs.replace(self, title=""))
        return hashlib.sha256(text).hexdigest()[:20]


def load(source: str | Path | None = None, overrides: Iterable[str] = (), preset: str = DEFAULT) -> Settings:
    """Settings from a TOML file (None: all defaults), changed by ``key=value`` overrides with dotted keys.

    Keys that neither has are those of a preset, see `meso.presets`.

    Raises:
        SettingsError: one line that names the file, the key or the preset.
    """
    with errors_as(SettingsError):
        tables: dict[str, Any] = {} if source is None else placed_files(read_toml(Path(source)), Path(source).parent)
        for override in overrides:
            set_key(tables, *split_override(override, "load.pressure=100"))
    return decode(on_preset(preset, tables))


def placed_files(tables: dict[str, Any], folder: Path) -> dict[str, Any]:
    """The tables with the files of measured faces looked for in a folder."""
    surface = tables.get("surface")
    if not isinstance(surface, Mapping):
        return tables
    placed = {key: placed_names(value, folder) if key in ("axle", "bore") else value for key, value in surface.items()}
    return {**tables, "surface": placed}


def decode(tables: Mapping[str, Any]) -> Settings:
    """Decode and check plain tables.

    Raises:
        SettingsError: one line that names the key.
    """
    try:
        settings = decode_tables(tables, Settings, "settings")
    except KeyMistake as error:
        raise SettingsError(str(error)) from None
    checked = settings.check()
    return msgspec.structs.replace(checked, surface=checked.surface.found())


def dump(settings: Settings) -> str:
    """The settings as TOML, every default written out."""
    return dump_toml(msgspec.to_builtins(settings))
