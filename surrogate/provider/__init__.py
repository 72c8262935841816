"""The friction provider `surrogate`: a trained network in place of the friction test of each pair of tiles.

    [friction]
    provider = "surrogate"

    [friction.options]
    micro_friction = 0.07
    seed = 1
    surface = { levels = 3, max_height = 0.02 }
    fallback = "dem"

`surface = { axle = "a.sur", bore = "b.sur" }` takes measured faces instead (`meso.measured.keys`).
`plates = "as-published"` asks for other plates, and thereby for another network. `Surrogate` has the options,
`TileNetwork` answers. The same seed gives the same surfaces as the provider `dem`.
"""

from __future__ import annotations

import functools
import hashlib
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

import msgspec
import numpy as np

from macrofit.base.keys import KeyMistake, decode_tables
from macrofit.friction import BuildContext, FrictionProvider, ProviderError, build, load
from meso.errors import MesoError, SettingsError
from meso.presets import DEFAULT, PRESETS, on_preset
from meso.settings import FaceKeys, decode
from meso.surfaces.measured import doubts_of
from meso.surfaces.surface import Body, tile_seed

from ..data.plates import Plates
from ..errors import SurrogateError
from ..network.shipped import SHIPPED, NetworkName
from .answers import TileNetwork

if TYPE_CHECKING:
    from ..tiles import Tiles

__all__ = ["Surrogate", "TileNetwork"]

Fallback: TypeAlias = Literal["error", "dem", "warning"]

LOOKED_AT = 9
"""Tiles of each body whose measured faces are compared with those that the network has seen."""


class _Faces(msgspec.Struct, frozen=True):
    """The one table of keys among the options."""

    surface: FaceKeys


class Surrogate(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Coefficients of friction that a network predicts from the two rough surfaces of a pair of tiles.

    The network answers for the inputs it has seen: heights, levels, exponents and micro coefficients as its provenance
    tells, its lay, tiles of 1 mm, steel. It sees the two faces of a pair, whatever they were cut from: one that learned
    from tiles by themselves is asked about those of strips too, and the other way round.

    `fallback` says what happens outside of these: "error" refuses the run; "dem" makes the provider `dem` answer in
    its place, with the same surfaces; "warning" predicts anyway. Single pairs may be unlike all that were learned from
    although their keys are not, be pressed beyond its pressures, or are predicted to lose contact along the slide: with
    "dem" they go to that provider, at their own pressure, else they are counted. Where pairs that the network does not
    know may make the force wrong by more than 1 %, the run is doubtful.

    A network that has learned from many pressures is asked about the pair's own: as p/E, for the axle's modulus E. A
    pair is asked anew when its pressure has left the `TOLERANCE` of `surrogate.levels`, not for every MPa. Pairs beyond
    its pressures are answered for the nearer end; what is not pressed yet is answered for the lowest.

    Raises:
        ProviderError: an option that is unknown or refused, by its key.
    """

    micro_friction: float = 0.07
    """Coefficient of sphere on sphere [-]."""
    seed: int = 1
    """Chooses all the surfaces of both bodies, 0 to 65535; see `meso.surfaces.surface.tile_seed`."""
    surface: dict[str, Any] = {}
    """Roughness of both bodies: keys and defaults of the provider `dem` (`meso.settings.FaceKeys`), or the preset's."""
    model: str | None = None
    """Path of a checkpoint; None: the network that comes with the package."""
    fallback: Fallback = "error"
    """What happens outside of the inputs the network has seen."""
    dem: dict[str, Any] = {}
    """More options of the provider `dem`, with fallback = "dem"."""
    plates: dict[str, Any] | str | None = None
    """The plates whose friction is asked for, as in the provider `dem`: the name of a preset, or keys of the plates.
    The preset chooses the network, and with fallback = "dem" these are the plates that answer. None: those of the
    model that is given, or else of the default preset."""
    network: NetworkName = "energy"
    """The network that comes with the package: shaped like the physics, or the paper's convolutional one, "cnn"."""

    pressure: float | Literal["own"] | None = None
    """Pressure of all pairs [MPa], or "own": that of each pair at the last increment. None: "own" where the network has
    learned from many pressures, else that of its plates."""
    control: Literal["displacement", "force"] | None = None
    """What a pair holds while it slides: the height of the plates, or their force, at which contact is never lost.
    None: the force with the pair's own pressure, else what the plates that are asked for hold."""

    def __post_init__(self) -> None:
        if isinstance(self.pressure, float) and not 0.0 < self.pressure <= 5000.0:
            raise ProviderError(f"friction.options.pressure = {self.pressure:g}: take a pressure in MPa, or 'own'")
        preset, keys = self._preset()
        if preset not in list(PRESETS):
            raise ProviderError(f"friction.options.plates = {preset!r}: take {' or '.join(PRESETS)}, or keys of plates")
        if "edge" in keys:
            raise ProviderError("friction.options.plates.edge: leave it out, it is the length of a tile")
        packings = sorted(keys.keys() & {"packing_seed", "axle_packing_seed"})
        if packings and self.fallback != "dem":
            raise ProviderError(
                f"friction.options.plates.{packings[0]}: leave it out, the network gives the mean over packings (it is "
                f"for friction.options.fallback = 'dem' and for the provider 'dem')"
            )
        if self.model is not None and self.network != "energy":
            raise ProviderError("friction.options.network: leave it out, it is friction.options.model")
        try:
            tile_seed(self.seed, 0)
            self._asked_plates(1.0)
        except SettingsError as error:
            raise ProviderError(f"friction.options.{error}") from None
        if not 0.0 <= self.micro_friction <= 2.0:
            raise ProviderError(
                f"friction.options.micro_friction = {self.micro_friction} is out of bounds: take 0 ... 2"
            )
        self.faces(1.0)
        self._check_dem()

    @property
    def file(self) -> Path:
        """The network's file, given or of the package."""
        shipped = SHIPPED[self._preset()[0]].network(self.network)
        return shipped if self.model is None else Path(self.model).expanduser()

    @property
    def digest(self) -> str:
        """SHA-256 of the network's file, for the record of a run; "" where there is none."""
        return hashlib.sha256(self.file.read_bytes()).hexdigest() if self.file.is_file() else ""

    def faces(self, tile_size: float) -> FaceKeys:
        """How the faces of tiles of this length [mm] are made.

        Raises:
            ProviderError: a key that is unknown or out of bounds.
        """
        try:
            tables = on_preset(self._preset()[0], {"surface": self.surface})
            keys = decode_tables({"surface": tables["surface"]}, _Faces, "options").surface
            keys.check(tile_size)
            keys = keys.found()
        except (KeyMistake, SettingsError) as error:
            raise ProviderError(f"friction.options.{error}") from None
        return keys

    def build(self, context: BuildContext) -> FrictionProvider:
        """The provider for this material and tile.

        Raises:
            ProviderError: torch or safetensors are missing, there is no such model, or the network has not seen such
                inputs and `fallback` is "error"; or it is "dem", and that provider cannot be built.
        """
        tiles, unseen = self._tiles(context)
        if unseen:
            message = f"the network has not seen such inputs: {'; '.join(unseen)}"
            if self.fallback == "error":
                raise ProviderError(
                    f"{message}. Take inputs within, another friction.options.model, "
                    "or fallback = 'dem' (slow) or 'warning' (predict anyway)"
                )
            if self.fallback == "dem":
                warnings.warn(f"friction provider 'surrogate': {message}; 'dem' answers for all pairs", stacklevel=2)
                return self._dem(context)
            warnings.warn(f"friction provider 'surrogate': {message}; it is asked nevertheless", stacklevel=2)
        if self.fallback != "dem":
            return TileNetwork(tiles, self, unseen=unseen, youngs_modulus=context.youngs_modulus)
        others = tiles.predictor.provenance.unlike(self._answering_plates(context))
        if others:
            warnings.warn(
                f"friction provider 'surrogate': pairs that lose contact are answered by other plates than the network "
                f"has learned from: {'; '.join(others)}. Take these keys out of friction.options.dem",
                stacklevel=2,
            )
        dem = functools.cache(lambda pressure: self._dem(context, pressure))
        return TileNetwork(tiles, self, fallback=dem, youngs_modulus=context.youngs_modulus)

    def _preset(self) -> tuple[str, dict[str, Any]]:
        """The preset that `plates` names, and its other keys."""
        keys = {"preset": self.plates} if isinstance(self.plates, str) else {"preset": DEFAULT, **(self.plates or {})}
        return keys.pop("preset"), keys

    def _asked_plates(self, tile_size: float, more: Mapping[str, Any] | None = None) -> Plates:
        """What the settings of the plates that are asked for come to, with `more` tables over them.

        Raises:
            SettingsError: a key of the plates that is unknown or refused.
        """
        preset, keys = self._preset()
        tables: dict[str, Any] = {name: table for name, table in (more or {}).items() if isinstance(table, Mapping)}
        tables["plates"] = {**keys, **tables.get("plates", {}), "edge": tile_size}
        tables["load"] = {**self._own_load(), **tables.get("load", {}), "slide": tile_size}
        return Plates.of_settings(msgspec.to_builtins(decode(on_preset(preset, tables))))

    def _in_solid(self, plates: Plates, context: BuildContext) -> Plates:
        """The plates, of the axle's material."""
        return msgspec.structs.replace(
            plates, youngs_modulus=context.youngs_modulus, poisson_ratio=context.poisson_ratio
        )

    def _answering_plates(self, context: BuildContext) -> Plates:
        """The plates of the provider `dem`."""
        return self._in_solid(self._asked_plates(context.tile_size, self.dem), context)

    def _tiles(self, context: BuildContext) -> tuple[Tiles, list[str]]:
        """The tiles with the network, and which of the inputs it has not seen, in words."""
        try:
            from ..levels import PressureLevels
            from ..network.checkpoint import outside_training
            from ..pair import other_faces
            from ..tiles import load_predictor, shared_tiles

            network = load_predictor(self.file)
        except ImportError as error:
            raise ProviderError(
                f"it needs torch and safetensors ({error}): pip install 'macrofit[surrogate]', "
                "or take friction.provider = 'dem'"
            ) from error
        except SurrogateError as error:
            raise ProviderError(f"friction.options.model: {error}") from error
        if network.provenance.faces != "generated":
            raise ProviderError(
                f"friction.options.model: {self.model} was trained on envelopes of spheres, which tiles do not have; "
                "take one trained on the surfaces as generated"
            )
        surface = self.faces(context.tile_size)
        unseen = outside_training(network.provenance, micro_friction=self.micro_friction)
        unseen += other_faces(network.provenance, surface)
        about = network.provenance
        asked = self._in_solid(self._asked_or_learned(about.plates, context.tile_size), context)
        if about.wide and self._own_pressure and self.control is None:
            asked = msgspec.structs.replace(asked, control="force")
        unseen += about.unlike(asked)
        counts = context.seat_tiles, context.bore_tiles
        if not about.wide or about.architecture == "paper":  # that one sees the faces alone
            if self.pressure == "own":
                unseen.append(f"pressure = 'own' asks for others than {about.plates.pressure:g} MPa")
            tiles = shared_tiles(network, self.seed, surface, counts)
            return tiles, unseen + self._measured(tiles, context)
        held = next((known for known in about.pressures if known == asked.control), next(iter(about.pressures)))
        one = about.at_modulus(asked.pressure, asked.youngs_modulus)
        low, high = about.pressures[held] if self._own_pressure else (one, one)
        tiles = shared_tiles(network, self.seed, surface, counts, PressureLevels(low, high), held)
        return tiles, unseen + self._measured(tiles, context)

    @property
    def _own_pressure(self) -> bool:
        """Whether a network of many pressures is asked about the pair's own."""
        return self.pressure in (None, "own")

    def _asked_or_learned(self, learned: Plates, tile_size: float) -> Plates:
        """The plates that are asked for; those of a model that is given, where none are."""
        if self.model is None or self.plates is not None:
            return self._asked_plates(tile_size)
        return msgspec.structs.replace(learned, edge=tile_size, **self._own_load())

    def _measured(self, tiles: Tiles, context: BuildContext) -> list[str]:
        """What the network has not seen of measured faces, in words; what may be wrong with them is told.

        Raises:
            ProviderError: a file that cannot be used, does not serve all tiles, or is of another unit.
        """
        counts: dict[Body, int] = {"axle": context.seat_tiles, "wheel": context.bore_tiles}
        if tiles.surface.axle is None and tiles.surface.bore is None:
            return []
        from ..pair import outside_heights

        unseen: list[str] = []
        try:
            for doubt in doubts_of(tiles.surface, counts, context.tile_size):
                warnings.warn(f"friction provider 'surrogate': {doubt}", stacklevel=4)
            for body, count in counts.items():
                scan = tiles.surface.measured(body)
                places = np.unique(np.linspace(0, count - 1, LOOKED_AT).astype(int)).tolist()
                if scan is not None:
                    learned = tiles.predictor.provenance.max_height
                    told = [outside_heights(tiles.heights(body, k), body, scan.files[0], learned) for k in places]
                    odd = [lines[0] for lines in told if lines]
                    unseen += odd[:1] if 2 * len(odd) > len(places) else []
        except (MesoError, SurrogateError) as error:
            raise ProviderError(f"friction.options.surface: {error}") from None
        return unseen

    def _dem(self, context: BuildContext, pressure: float | None = None) -> FrictionProvider:
        """The provider `dem` on the same surfaces; at a pressure of its own [MPa], where one is given."""
        return build("dem", self._dem_options(pressure), context)

    def _dem_options(self, pressure: float | None = None) -> dict[str, Any]:
        """Options of the provider `dem` on the same surfaces, asked for what the network is asked for."""
        own = {"micro_friction": self.micro_friction, "seed": self.seed}
        preset, keys = self._preset()
        plates = {"preset": preset, **keys, **self.dem.get("plates", {})}
        held = {} if pressure is None else {"pressure": pressure, "control": "force"}
        load = {**held, **self._own_load(), **self.dem.get("load", {})}
        tables = {"load": load} if load else {}
        return {**self.dem, **own, **tables, "plates": plates, "surface": self.surface}

    def _own_load(self) -> dict[str, Any]:
        """Keys of the plates' load that are options of this provider."""
        own = {"pressure": self.pressure, "control": self.control}
        return {key: value for key, value in own.items() if value is not None and value != "own"}

    def _check_dem(self) -> None:
        """A scene is refused when it is read, not when it runs."""
        if self.fallback != "dem":
            if self.dem:
                raise ProviderError("friction.options.dem: goes with fallback = 'dem'; set that, or leave it out")
            return
        for key in ("micro_friction", "seed", "surface"):
            if key in self.dem:
                raise ProviderError(f"friction.options.dem.{key}: leave it out, it is friction.options.{key}")
        if isinstance(self.dem.get("plates"), str) or "preset" in self.dem.get("plates", {}):
            raise ProviderError("friction.options.dem.plates: a preset of plates is friction.options.plates")
        try:
            load("dem", self._dem_options())
        except ProviderError as error:
            raise ProviderError(str(error).replace("friction.options.", "friction.options.dem.")) from None
