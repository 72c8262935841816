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
import math
import warnings
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, TypeAlias

import msgspec
import numpy as np

from macrofit.base.arrays import HeightArray
from macrofit.base.keys import KeyMistake, decode_tables
from macrofit.friction import (
    BuildContext,
    FloatArray,
    FrictionProvider,
    IntArray,
    ProviderError,
    TilePairs,
    answered,
    build,
    load,
)
from meso.errors import MesoError, SettingsError
from meso.presets import DEFAULT, PRESETS, on_preset
from meso.settings import FaceKeys, decode
from meso.surfaces.measured import doubts_of
from meso.surfaces.surface import Body, tile_seed

from .data.plates import Plates
from .errors import SurrogateError
from .levels import HALVED, distinct_pairs
from .network.shipped import SHIPPED, NetworkName

if TYPE_CHECKING:
    from .tiles import Tiles

Fallback: TypeAlias = Literal["error", "dem", "warning"]

LOOKED_AT = 9
"""Tiles of each body whose measured faces are compared with those that the network has seen."""
UNKNOWN = 0.2
"""Share by which the coefficient of a pair is taken to be wrong that is unlike all that were learned from [-]."""
LARGEST_FRICTION = math.nextafter(2.0, 0.0)
"""Largest coefficient that the contract accepts [-]."""


UNLIKE = (
    "unknown faces: are unlike all that the network has learned from, by their heights and their load together; take "
    "lower or smoother friction.options.surface, or friction.options.fallback = 'dem' (slow)"
)
UNSEEN = (
    "unknown inputs: are asked for what the network has not seen ({}); take inputs within, or fallback = 'dem' (slow)"
)
BEYOND_PRESSURE = (
    "unknown pressures: are pressed beyond the {:.3g} to {:.3g} MPa that the network has learned from and are answered "
    "for the nearer end; take friction.options.fallback = 'dem' (slow), which asks the plates for their own pressure"
)
"""Why the network should not have been asked, as `KnowsItsRange` wants it."""


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
            from .levels import PressureLevels
            from .network.checkpoint import outside_training
            from .pair import other_faces
            from .tiles import load_predictor, shared_tiles

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
        from .pair import outside_heights

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


class _Answer(NamedTuple):
    """Coefficients of m distinct pairs: arrays of shape (m,)."""

    pairs: tuple[IntArray, IntArray, IntArray]
    """Seat tile, bore tile and level of the pressure of each, sorted."""
    mean: FloatArray
    """mu [-], 0 <= mu < 2."""
    spread: FloatArray
    """Standard deviation of mu [-]."""


class TileNetwork:
    """The predicted meso coefficient of each pair of tiles.

    What comes out below 0 counts as 0. A batch is predicted in one call, each of its distinct pairs once; the answers
    to the last batch are kept.

    Args:
        tiles: tiles of both bodies, with the network.
        options: micro coefficient; seed and surfaces are those of `tiles`.
        unseen: inputs that the network has not seen, in words.
        fallback: gives the provider to ask about pairs that are predicted to lose contact, are like none learned from,
            or are pressed beyond what was, for a pressure [MPa], or None for its own; None: the network answers.
        youngs_modulus: of the axle, that the pressures press on [MPa]; left out, that of the network's plates.
    """

    depends_on: frozenset[str]
    """With the pressure, where the network knows many; a pair is asked anew where it leaves a level."""

    clipped: int
    """Pairs predicted out of the bounds of the contract, and answered with the nearest bound."""
    out_of_range: int
    """Pairs predicted for inputs the network has not seen, by keys or by what it sees of the faces."""
    clamped: int
    """Pairs pressed beyond what the network has learned from, and asked for at the nearer end of that."""
    losing_contact: int
    """Pairs that are predicted to lose contact somewhere along the slide."""
    asked_anew: int
    """Pairs whose pressure has left the level at which they were asked before."""

    def __init__(
        self,
        tiles: Tiles,
        options: Surrogate,
        *,
        unseen: Sequence[str] = (),
        fallback: Callable[[float | None], FrictionProvider] | None = None,
        youngs_modulus: float | None = None,
    ) -> None:
        self.tiles, self.options, self.unseen = tiles, options, tuple(unseen)
        several = tiles.pressures is not None and tiles.pressures.count > 1
        self.depends_on = frozenset({"tiles", "pressure"} if several else {"tiles"})
        about = tiles.predictor.provenance
        self._on_steel = 1.0 if youngs_modulus is None else about.at_modulus(1.0, youngs_modulus)
        self.clipped = self.out_of_range = self.clamped = self.losing_contact = self.asked_anew = 0
        self._level = np.full(tiles.counts, -1, dtype=np.int16) if several else None  # of each pair, when last asked
        self._fallback = fallback
        self._last: _Answer | None = None
        self._asked: tuple[FloatArray, IntArray] | None = None  # pairs of the last batch, and their numbers in `_last`

    @property
    def trusted(self) -> bool:
        """Whether the network has seen such inputs."""
        return not self.unseen

    @property
    def counters(self) -> dict[str, int]:
        """Counts for the report of a run."""
        counts = {"clipped": self.clipped, "out_of_range": self.out_of_range, "unheld": self.losing_contact}
        own = {"clamped": self.clamped, "asked_anew": self.asked_anew}
        return counts | (own if self._level is not None else {})

    @property
    def origin(self) -> dict[str, Any]:
        """What measured faces are made of, for the record of a run."""
        from meso.surfaces.origin import measured_origin

        counts: dict[Body, int] = {"axle": self.tiles.counts[0], "wheel": self.tiles.counts[1]}
        width = self.tiles.predictor.provenance.plates.edge
        return measured_origin(self.tiles.surface, self.tiles.seed, counts, width)

    def coefficients(self, pairs: TilePairs) -> FloatArray:
        """mu of each pair [-], shape (n,).

        Raises:
            ProviderError: a tile without a surface, or surfaces that the network refuses.
        """
        answer, which = self._answered(pairs)
        return answer.mean[which]

    def uncertainty(self, pairs: TilePairs) -> FloatArray:
        """Standard deviation of mu of each pair, over packings and from the network together [-], shape (n,).

        Where another provider answered it is what that one states, NaN if nothing.

        Raises:
            ProviderError: as `coefficients`.
        """
        answer, which = self._answered(pairs)
        return answer.spread[which]

    def announced(self, pairs: TilePairs) -> None:
        """Have the pairs prepared with those that others on the same tiles will be asked for."""
        self.tiles.expect(pairs.seat, pairs.bore, self._known(self._levels(pairs)))

    def heights(self, body: Body, tile: int) -> HeightArray:
        """The rough face of a tile as the network takes it [mm], read-only.

        Shape (n, n) for the wheel, (2 n - 1, n) for the axle, with n the points of the network's training.

        Raises:
            ProviderError: there is no such tile.
        """
        try:
            return self.tiles.heights(body, tile)
        except SurrogateError as error:
            raise ProviderError(f"friction provider 'surrogate': {error}") from error

    def outside(self, pairs: TilePairs) -> dict[str, FloatArray]:
        """By how much coefficients may be wrong for what the network has not seen, by reason; see `KnowsItsRange`.

        Beyond its pressures that is `HALVED` for each factor of two, else `UNKNOWN`; nothing where another provider
        answers for such pairs.

        Raises:
            ProviderError: as `coefficients`.
        """
        if self._fallback is not None:
            return {}
        count, level = len(pairs.seat), self._known(self._levels(pairs))
        try:
            seen = self.tiles.predict(pairs.seat, pairs.bore, self.options.micro_friction, level).seen
        except SurrogateError as error:
            raise ProviderError(f"friction provider 'surrogate': {error}") from error
        found = {UNLIKE: np.where(seen, 0.0, UNKNOWN)}
        if self.unseen:
            found[UNSEEN.format("; ".join(self.unseen))] = np.full(count, UNKNOWN)
        levels = self.tiles.pressures
        if self._level is not None and levels is not None:
            ends = [end / self._on_steel for end in (levels.low, levels.high)]
            found[BEYOND_PRESSURE.format(*ends)] = HALVED * levels.octaves(self._on_steel * pairs.pressure)
        return found

    def _levels(self, pairs: TilePairs) -> IntArray:
        """The level of each pair's pressure; beyond those that there are where the pressure is."""
        pressure, levels = self._on_steel * pairs.pressure, self.tiles.pressures
        return self.tiles.levels(pressure) if self._level is None or levels is None else levels.beyond(pressure)

    def _known(self, level: IntArray) -> IntArray:
        """The nearest of the levels that the network is asked at."""
        count = 1 if self.tiles.pressures is None else self.tiles.pressures.count
        return np.clip(level, 0, count - 1)

    def _answered(self, pairs: TilePairs) -> tuple[_Answer, IntArray]:
        """The distinct pairs with their answers, and the number of each pair among them, (n,)."""
        asked = np.stack([pairs.seat, pairs.bore, pairs.pressure])
        if self._asked is None or not np.array_equal(self._asked[0], asked):
            distinct, which = distinct_pairs(pairs.seat, pairs.bore, self._levels(pairs))
            if self._last is None or not all(map(np.array_equal, self._last.pairs, distinct)):
                self._last = self._predicted(*distinct)
            self._asked = asked, which
        assert self._last is not None
        return self._last, self._asked[1]

    def _predicted(self, seat: IntArray, bore: IntArray, level: IntArray) -> _Answer:
        """The answers to distinct pairs."""
        if not seat.size:
            return _Answer((seat, bore, level), np.empty(0), np.empty(0))
        known = self._known(level)
        try:
            prediction = self.tiles.predict(seat, bore, self.options.micro_friction, known)
        except SurrogateError as error:
            raise ProviderError(f"friction provider 'surrogate': {error}") from error
        answer = _Answer((seat, bore, level), np.array(prediction.mean), np.array(prediction.spread))
        clamped = known != level
        self._replace(answer, np.flatnonzero(~(prediction.in_contact & prediction.seen) | clamped))
        self._bound(answer)
        if self._level is not None:
            before = self._level[seat, bore]
            self.asked_anew += int(((before >= 0) & (before != known)).sum())
            self._level[seat, bore] = known
        self.clamped += int(clamped.sum())
        self.losing_contact += int((~prediction.in_contact).sum())
        self.out_of_range += seat.size if self.unseen else int((~prediction.seen).sum())
        return answer

    def _replace(self, answer: _Answer, doubted: IntArray) -> None:
        """Have the pairs numbered `doubted` answered by the other provider at their pressures, if there is one."""
        if not doubted.size or self._fallback is None:
            return
        seat, bore, level = (column[doubted] for column in answer.pairs)
        for one in np.unique(level).tolist():
            some = level == one
            unused, which = np.zeros(int(some.sum())), doubted[some]
            other = self._fallback(self._pressure(one))
            told = answered(other, TilePairs(seat[some], bore[some], unused, unused), "dem")
            answer.mean[which], answer.spread[which] = told

    def _pressure(self, level: int) -> float | None:
        """The pressure of a level on the axle's material [MPa]; None where all pairs have that of the plates."""
        if self._level is None or self.tiles.pressures is None:
            return None
        return float(self.tiles.pressures.pressure(np.array(level))) / self._on_steel

    def _bound(self, answer: _Answer) -> None:
        """Bring the coefficients within the contract."""
        wrong = np.flatnonzero((answer.mean < 0.0) | (answer.mean > LARGEST_FRICTION))
        if wrong.size and not self.clipped:
            seat, bore, mean, spread = (column[wrong[0]] for column in (*answer.pairs[:2], answer.mean, answer.spread))
            warnings.warn(
                f"friction provider 'surrogate': the coefficient of seat tile {seat} and bore tile {bore} comes out as "
                f"{mean:.4f} +- {spread:.4f} and is taken as {min(2, max(0, round(mean)))}, and so will others be",
                stacklevel=2,
            )
        self.clipped += wrong.size
        answer.mean[wrong] = np.clip(answer.mean[wrong], 0.0, LARGEST_FRICTION)
