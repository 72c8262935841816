"""What a friction test needs to know: every key with its default and unit; the only reader of TOML in the package.

Lengths in mm, forces in N, moduli and pressures in MPa, speeds in mm/s.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, Literal

import msgspec

from macrofit.base.toml import dump_toml, errors_as, read_toml, set_key, split_override, unknown_key

from .errors import SettingsError
from .material import Beams, ExternalFace, ExternalModulus, Material

EngineName = Literal["auto", "quasi-static", "explicit"]


class Keys(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Base of every table: frozen, and an unknown key is an error."""


class SurfaceKeys(Keys, frozen=True):
    """Both rough faces; the two differ by their seeds."""

    wheel_seed: int = 1
    axle_seed: int = 2
    generator: Literal["diamond_square", "self_affine"] = "diamond_square"
    levels: int = 3  # n: 2^n + 1 points along 1 mm
    max_height: float = 0.02  # R: corners and noise of Diamond-Square lie in [-R/2, R/2]
    rms_height: float = 0.0016  # of the self-affine generator
    hurst_exponent: float = 0.8

    def check(self) -> None:
        """Raise SettingsError for a value out of bounds."""
        _between("surface.levels", self.levels, 1, 10)
        _between("surface.max_height", self.max_height, 0.0, 1.0)
        _between("surface.rms_height", self.rms_height, 0.0, 1.0)
        _between("surface.hurst_exponent", self.hurst_exponent, 0.0, 1.0)
        for name in ("wheel_seed", "axle_seed"):
            _between(f"surface.{name}", getattr(self, name), 0, 2**32 - 1)


class PlateKeys(Keys, frozen=True):
    """The wheel's plate is edge x edge x thickness, the axle's longer by the slide."""

    spheres: int = 3000  # of both plates together
    thickness: float = 0.3  # H
    edge: float = 1.0  # of the apparent area of contact
    cube: float = 1.0  # L: plate and external face together stand for a solid of this height
    packing_seed: int = 0
    external_face: ExternalFace = "solid"
    external_modulus: ExternalModulus = "series"

    def check(self) -> None:
        """Raise SettingsError for a value out of bounds."""
        _between("plates.spheres", self.spheres, 1, 1_000_000)
        _between("plates.packing_seed", self.packing_seed, 0, 2**32 - 1)
        for name in ("thickness", "edge", "cube"):
            _positive(f"plates.{name}", getattr(self, name))
        if self.cube <= self.thickness:
            raise SettingsError(
                f"plates.cube = {self.cube:g} mm must be larger than plates.thickness = {self.thickness:g} mm"
            )


class ContactKeys(Keys, frozen=True):
    """Sphere on sphere, between the plates: k_n = normal_stiffness E_M (r_i + r_j)/2, k_t = tangential_ratio k_n."""

    micro_friction: float | tuple[float, ...] = 0.07
    normal_stiffness: float = 1.0
    tangential_ratio: float = 0.8

    @property
    def coefficients(self) -> tuple[float, ...]:
        """The micro coefficients asked for."""
        return self.micro_friction if isinstance(self.micro_friction, tuple) else (self.micro_friction,)

    def check(self) -> None:
        """Raise SettingsError for a value out of bounds."""
        if not self.coefficients:
            raise SettingsError("contact.micro_friction is empty: give one number, or a list")
        for mu in self.coefficients:
            _between("contact.micro_friction", mu, 0.0, 2.0)
        _between("contact.normal_stiffness", self.normal_stiffness, 0.02, 100.0)
        _between("contact.tangential_ratio", self.tangential_ratio, 0.01, 100.0)


class LoadKeys(Keys, frozen=True):
    """Squeeze to a nominal pressure or by an interference, then slide."""

    pressure: float = 170.0  # N over the apparent area at the end of the squeeze
    interference: float | None = None  # approach after the first touch, instead of the pressure
    slide: float = 1.0
    control: Literal["displacement", "force"] = "displacement"  # what is held while sliding

    def check(self) -> None:
        """Raise SettingsError for a value out of bounds."""
        _between("load.pressure", self.pressure, 1e-3, 5000.0)
        _between("load.slide", self.slide, 1e-3, 100.0)
        if self.interference is not None:
            _positive("load.interference", self.interference)
            if self.control == "force":
                raise SettingsError("load.interference is not used where load.control = 'force': leave it out")


class EngineKeys(Keys, frozen=True):
    """How the slide is computed."""

    name: EngineName = "auto"
    samples: int = 250  # rows of the curve
    increment: float = 0.004  # quasi-static: largest slide per increment
    tolerance: float = 1e-3  # quasi-static: residual over the largest contact force
    speed: float = 20_000.0  # explicit: of the slide
    approach_speed: float = 2_000.0  # explicit: of the squeeze
    damping_length: float = 0.08  # explicit: the slide's rate of damping is speed over this length
    squeeze_damping: float = 6e6  # explicit: rate during the squeeze [1/s]
    safety: float = 0.9  # explicit: time step over the critical one
    time_step: float | None = None  # explicit, and asks for it: instead of safety [s]; above the limit it is refused
    breakage: Breakage | None = None

    def check(self) -> None:
        """Raise SettingsError for a value out of bounds."""
        _between("engine.samples", self.samples, 10, 1_000_000)
        _between("engine.increment", self.increment, 1e-5, 0.1)
        _between("engine.tolerance", self.tolerance, 1e-9, 0.05)
        for name in ("speed", "approach_speed", "damping_length", "squeeze_damping"):
            _positive(f"engine.{name}", getattr(self, name))
        _between("engine.safety", self.safety, 1e-3, 1.0)
        if self.time_step is not None:
            _positive("engine.time_step", self.time_step)
            if self.name == "quasi-static":
                raise SettingsError("engine.time_step asks for engine.name = 'explicit' (or 'auto')")
        if self.breakage is not None:
            _positive("engine.breakage.tensile_strength", self.breakage.tensile_strength)
            _positive("engine.breakage.shear_strength", self.breakage.shear_strength)
            if self.name == "quasi-static":
                raise SettingsError("engine.breakage asks for engine.name = 'explicit' (or 'auto')")


class Breakage(Keys, frozen=True):
    """Beams break where their largest stress passes a strength; both are microscopic [MPa]."""

    tensile_strength: float
    shear_strength: float


class Settings(Keys, frozen=True):
    """Everything a friction test depends on."""

    title: str = "Two rough plates"
    surface: SurfaceKeys = SurfaceKeys()
    plates: PlateKeys = PlateKeys()
    material: Material = Material()
    beams: Beams | None = None  # None: those of the stored calibration
    contact: ContactKeys = ContactKeys()
    load: LoadKeys = LoadKeys()
    engine: EngineKeys = EngineKeys()

    def check(self) -> Settings:
        """Itself, when all its values and their combinations can be computed.

        Raises:
            SettingsError: naming the key, its value and what to take.
        """
        for table in (self.surface, self.plates, self.contact, self.load, self.engine):
            table.check()
        if self.load.interference is not None and self.load.interference > 0.3 * self.plates.thickness:
            raise SettingsError(
                f"load.interference = {self.load.interference:g} mm is too much: take less than 0.3 of "
                f"plates.thickness = {self.plates.thickness:g} mm"
            )
        squares = (self.plates.edge + self.load.slide) / self.plates.edge
        if self.surface.generator == "diamond_square" and abs(squares - round(squares)) > 1e-9:
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


def load(source: str | Path | None = None, overrides: Iterable[str] = ()) -> Settings:
    """Settings from a TOML file (None: all defaults), changed by ``key=value`` overrides with dotted keys.

    Raises:
        SettingsError: one line that names the file or the key.
    """
    with errors_as(SettingsError):
        tables: dict[str, Any] = {} if source is None else read_toml(Path(source))
        for override in overrides:
            set_key(tables, *split_override(override, "load.pressure=100"))
    return decode(tables)


def decode(tables: Mapping[str, Any]) -> Settings:
    """Decode and check plain tables.

    Raises:
        SettingsError: one line that names the key.
    """
    try:
        settings = msgspec.convert(tables, Settings)
    except msgspec.ValidationError as error:
        raise SettingsError(_one_line(str(error))) from None
    return settings.check()


def dump(settings: Settings) -> str:
    """The settings as TOML, every default written out."""
    return dump_toml(msgspec.to_builtins(settings))


_TABLES: dict[str, type[msgspec.Struct]] = {
    "": Settings,
    "surface": SurfaceKeys,
    "plates": PlateKeys,
    "material": Material,
    "beams": Beams,
    "contact": ContactKeys,
    "load": LoadKeys,
    "engine": EngineKeys,
    "engine.breakage": Breakage,
}


def _one_line(message: str) -> str:
    """A decoding error as `table.key: what is wrong`, with the nearest key there is."""
    text, _, path = message.partition(" - at `$")
    table = path.rstrip("`").lstrip(".")
    if "unknown field" in text:
        unknown = text.split("`")[1]
        known = list(_TABLES[table].__struct_fields__) if table in _TABLES else []
        return unknown_key(".".join(filter(None, [table, unknown])), known)
    return f"{table or 'settings'}: {text}"


def _between(key: str, value: float, low: float, high: float) -> None:
    if not low <= value <= high:
        raise SettingsError(f"{key} = {value} is out of bounds: take {low:g} ... {high:g}")


def _positive(key: str, value: float) -> None:
    if not 0.0 < value < float("inf"):
        raise SettingsError(f"{key} = {value} must be a number > 0")
