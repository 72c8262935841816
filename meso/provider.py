"""The friction provider `dem`: each pair of facing tiles is a friction test of two rough plates of its own.

    [friction]
    provider = "dem"

    [friction.options]
    micro_friction = 0.07
    seed = 1
    surface = { levels = 3, max_height = 0.02 }
    plates = { spheres = 3000 }

`surface = { axle = "a.sur", bore = "b.sur" }` takes measured faces instead (`meso.measured.keys`).
`DirectDem` has the options, `TileFriction` answers.
"""

from __future__ import annotations

import functools
import warnings
from pathlib import Path
from typing import Any, ClassVar

import msgspec
import numpy as np

from macrofit.base.provenance import version
from macrofit.friction import BuildContext, FloatArray, ProviderError, TilePairs

from .coefficient_cache import CoefficientCache, Entry, code
from .errors import MesoError, SettingsError, SurfaceError
from .friction_test import engine_name, prepared, slid
from .lattice.lattice import Lattice
from .material import Material
from .packing.deal import packing_of
from .packing.pack import Packing
from .plates import beams_of, face_to_face, make_plate
from .presets import DEFAULT, PRESETS, on_preset
from .records import UNBALANCED, Slide
from .settings import Settings, decode
from .surfaces.measured import doubts_of
from .surfaces.origin import measured_origin
from .surfaces.surface import Body, tile_seed

HELD_SPHERES = 600_000
"""Spheres of the plates kept in memory, 0.3 kB each. An increment asks about all tiles in contact, once or twice:
either all their plates are kept or none is found again. 200 tiles of each body, of 3000 spheres a pair, fit in."""

LONG_S = 1800.0
"""CPU time of all friction tests of a run above which it is told before they begin [s]."""

TABLES = ("surface", "plates", "beams", "contact", "load", "engine")
"""The tables of a friction test that are options."""

TAKEN = {
    ("surface", "wheel_seed"): "it follows from friction.options.seed and the tile",
    ("surface", "axle_seed"): "it follows from friction.options.seed and the tile",
    ("contact", "micro_friction"): "it is friction.options.micro_friction",
    ("plates", "axle_packing_seed"): "packings are dealt to the tiles by friction.options.packings",
    ("plates", "edge"): "it is the length of a tile",
    ("load", "slide"): "it is the length of a tile",
}
"""Keys of these tables that are set otherwise."""


class DirectDem(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Coefficients of friction from the discrete model of two rough plates, run for each pair when it is asked for.

    The tables `surface`, `plates`, `beams`, `contact`, `load`, `engine` are those of a friction test (`meso.settings`)
    with their defaults, but for the keys in `TAKEN`. `plates` may be the name of a preset (`meso.presets`) instead, or
    have its name as the key `preset`: what no table says is then the preset's. Both plates are of the axle's material,
    as large as a tile and slid by its length. The pair's own pressure is not used: it is `load.pressure` everywhere.

    Raises:
        ProviderError: an option that is unknown or refused, by its key.
    """

    micro_friction: float = 0.07
    """Coefficient of friction of sphere on sphere [-]."""
    seed: int = 1
    """Chooses all the surfaces of both bodies, 0 to 65535; see `tile_seed`."""
    packings: int | None = None
    """Packings dealt to the tiles of each body, 1 to 65536, by `meso.packing.deal`; left out: one for each tile."""
    cache: bool = True
    """Keep coefficients in the context's cache folder, and take them from there."""
    surface: dict[str, Any] = {}
    plates: dict[str, Any] | str = {}
    beams: dict[str, Any] = {}
    contact: dict[str, Any] = {}
    load: dict[str, Any] = {}
    engine: dict[str, Any] = {}

    def __post_init__(self) -> None:
        try:
            tile_seed(self.seed, 0)
            packing_of(self.seed, 0, packings=self.packings)
        except SettingsError as error:
            raise ProviderError(f"friction.options.{error}") from None
        self.settings(1.0)  # a scene is refused when it is read, not when it runs

    def settings(self, tile_size: float) -> Settings:
        """The settings that all pairs share, for tiles of this length [mm]."""
        preset, plates = named_plates(self.plates)
        tables = {name: dict(getattr(self, name)) for name in TABLES if name != "plates"} | {"plates": plates}
        if not self.beams:
            del tables["beams"]
        for (table, key), instead in TAKEN.items():
            if key in tables[table]:
                raise ProviderError(f"friction.options.{table}.{key}: leave it out, {instead}")
        tables["contact"]["micro_friction"] = self.micro_friction
        tables["plates"]["edge"] = tables["load"]["slide"] = tile_size
        try:
            return decode(on_preset(preset, tables))
        except SettingsError as error:
            told = str(error).replace("contact.micro_friction", "micro_friction")
            raise ProviderError(f"friction.options.{told}") from None

    def build(self, context: BuildContext) -> TileFriction:
        """The provider for this material and tile.

        Raises:
            SettingsError: there are no beams for the material.
            ProviderError: a measured face that cannot be used.
        """
        material = Material(youngs_modulus=context.youngs_modulus, poisson_ratio=context.poisson_ratio)
        settings = msgspec.structs.replace(self.settings(context.tile_size), material=material)
        beams_of(settings)
        _look_at_files(settings, {"axle": context.seat_tiles, "wheel": context.bore_tiles})
        _warn_of_cost(settings, context.seat_tiles * context.bore_tiles // 2)
        keeps = self.cache and context.cache_dir is not None
        return TileFriction(
            settings,
            self.seed,
            CoefficientCache(Path(context.cache_dir or ""), settings) if keeps else None,
            self.packings,
            (context.seat_tiles, context.bore_tiles),
        )


class TileFriction:
    """The meso coefficient of each pair of tiles: mean T over mean N along the slide of the seat's tile on the bore's.

    Where the micro coefficient is small this may come out a little below 0, for the plates do not end as they began
    and what they give back is counted. Such a pair gets 0; the cache keeps the number itself.

    Args:
        settings: of the friction test; the two seeds in them do not matter.
        seed: of all the surfaces.
        cache: where coefficients are kept, if anywhere.
        packings: number dealt to the tiles of each body; None: one for each.
        tiles: number of tiles of the seat and of the bore, for the record.
    """

    depends_on: ClassVar[frozenset[str]] = frozenset({"tiles"})

    runs: int
    """Friction tests made, not taken from the cache."""
    clipped: int
    """Answers of 0 in place of a negative number."""
    doubtful: int
    """Answers with a share of the work above `UNBALANCED` unaccounted for, or with a remark."""

    def __init__(
        self,
        settings: Settings,
        seed: int,
        cache: CoefficientCache | None = None,
        packings: int | None = None,
        tiles: tuple[int, int] = (0, 0),
    ) -> None:
        self.tiles = tiles
        self.shared, self.seed, self.cache, self.packings = settings, seed, cache, packings
        self.runs = self.clipped = self.doubtful = 0
        self._last: dict[tuple[int, int], Entry] = {}
        self._plate = functools.lru_cache(2 * HELD_SPHERES // settings.plates.spheres)(self._made)

    @property
    def counters(self) -> dict[str, int]:
        """For the report of a run."""
        return {"runs": self.runs, "clipped": self.clipped, "doubtful": self.doubtful}

    @property
    def origin(self) -> dict[str, Any]:
        """What measured faces are made of, for the record of a run."""
        counts: dict[Body, int] = {"axle": self.tiles[0], "wheel": self.tiles[1]}
        return measured_origin(self.shared.surface, self.seed, counts, self.shared.plates.edge)

    def coefficients(self, pairs: TilePairs) -> FloatArray:
        """mu of each pair [-], shape (n,).

        Raises:
            ProviderError: a pair that cannot be computed: which, and why.
        """
        asked = list(zip(pairs.seat.tolist(), pairs.bore.tolist(), strict=True))
        self._last = {pair: self.entry(*pair) for pair in sorted(set(asked))}
        known = {pair: self._bounded(*pair, entry) for pair, entry in self._last.items()}
        return np.array([known[pair] for pair in asked], dtype=np.float64)

    def uncertainty(self, pairs: TilePairs) -> FloatArray:
        """Standard error of mu of each pair along the slide [-], shape (n,).

        What `coefficients` was asked last is not computed again.

        Raises:
            ProviderError: as `coefficients`.
        """
        asked = zip(pairs.seat.tolist(), pairs.bore.tolist(), strict=True)
        entries = [self._last.get(pair) or self.entry(*pair) for pair in asked]
        return np.array([entry.uncertainty for entry in entries], dtype=np.float64)

    def settings(self, seat: int, bore: int) -> Settings:
        """The friction test of a pair: `meso.friction_test.run` with these gives its coefficient to the bit."""
        try:
            seeds = {"axle_seed": tile_seed(self.seed, seat), "wheel_seed": tile_seed(self.seed, bore)}
        except SettingsError as error:
            raise ProviderError(f"friction provider 'dem': {error}") from None
        plates = msgspec.structs.replace(
            self.shared.plates, packing_seed=self._packing(bore), axle_packing_seed=self._packing(seat)
        )
        surface = msgspec.structs.replace(self.shared.surface, **seeds)
        return msgspec.structs.replace(self.shared, surface=surface, plates=plates)

    def _packing(self, tile: int) -> int:
        return packing_of(self.seed, tile, packings=self.packings, packing_seed=self.shared.plates.packing_seed)

    def entry(self, seat: int, bore: int) -> Entry:
        """What the friction test of a pair comes to, from the cache or made now.

        Raises:
            ProviderError: it cannot be computed.
        """
        settings = self.settings(seat, bore)
        stored = self.cache.find(settings) if self.cache else None
        if stored is not None:
            return stored
        try:
            entry = _entry(settings, self._slide(settings))
        except Exception as error:
            reason = str(error) if isinstance(error, MesoError) else f"{type(error).__name__}: {error}"
            raise ProviderError(
                f"friction provider 'dem', seat tile {seat} (axle_seed = {settings.surface.axle_seed}) and "
                f"bore tile {bore} (wheel_seed = {settings.surface.wheel_seed}): {reason}"
            ) from error
        if self.cache:
            self.cache.keep(entry)
        return entry

    def _bounded(self, seat: int, bore: int, entry: Entry) -> float:
        unbalanced = abs(entry.imbalance) > UNBALANCED
        if unbalanced or entry.remark:
            if not self.doubtful:
                left = f"{abs(entry.imbalance):.0%} of the work is unaccounted for" if unbalanced else ""
                warnings.warn(
                    f"friction provider 'dem': the coefficient of seat tile {seat} and bore tile {bore}, "
                    f"{entry.coefficient:.4f}, is doubtful, and so may others be: "
                    + "; ".join(filter(None, (left, entry.remark))),
                    stacklevel=3,
                )
            self.doubtful += 1
        if entry.coefficient < 0.0:
            if not self.clipped:
                warnings.warn(
                    f"friction provider 'dem': the coefficient of seat tile {seat} and bore tile {bore} comes out as "
                    f"{entry.coefficient:.4f} +- {entry.uncertainty:.4f} and is taken as 0, and so will others be",
                    stacklevel=2,
                )
            self.clipped += 1
        return max(0.0, entry.coefficient)

    def _slide(self, settings: Settings) -> Slide:
        self.runs += 1
        axle_packing = settings.plates.axle_packing_seed
        assert axle_packing is not None
        wheel = self._plate("wheel", settings.surface.wheel_seed, settings.plates.packing_seed)
        axle = self._plate("axle", settings.surface.axle_seed, axle_packing)
        plates = face_to_face(settings, wheel, axle)
        return next(slid(plates, prepared(plates), settings.contact.coefficients))

    def _made(self, body: Body, seed: int, packing: int) -> tuple[Packing, Lattice]:
        surface = msgspec.structs.replace(self.shared.surface, axle_seed=seed, wheel_seed=seed)
        plates = msgspec.structs.replace(self.shared.plates, packing_seed=packing)
        return make_plate(msgspec.structs.replace(self.shared, surface=surface, plates=plates), body)


def named_plates(plates: dict[str, Any] | str) -> tuple[str, dict[str, Any]]:
    """The preset that the option `plates` names, and its other keys.

    Raises:
        ProviderError: `plates.preset` is no text.
    """
    keys: dict[str, Any] = {"preset": plates} if isinstance(plates, str) else {"preset": DEFAULT, **plates}
    preset = keys.pop("preset")
    if not isinstance(preset, str):
        raise ProviderError(f"friction.options.plates.preset = {preset}: take {' or '.join(PRESETS)}")
    return preset, keys


def slide_cpu_s(settings: Settings) -> float:
    """About how long the friction test of a pair takes [CPU s], its plates made; measured on one machine.

    The explicit engine's time step falls with the size of the spheres.
    """
    thousands = 1e-3 * settings.plates.spheres
    if engine_name(settings) == "quasi-static":
        return float(0.1 * thousands**1.6)
    speed = settings.engine.speed if settings.engine.resonance is None else 13.4e3 * settings.engine.resonance
    return float(0.25 * thousands ** (4.0 / 3.0) * (0.6 + settings.load.slide * 1e4 / speed))


def _look_at_files(settings: Settings, counts: dict[Body, int]) -> None:
    """Refuse measured faces that do not serve all tiles, before a run begins, and tell what may be wrong with them."""
    try:
        doubts = doubts_of(settings.surface, counts, settings.plates.edge)
    except SurfaceError as error:
        raise ProviderError(f"friction.options.surface: {error}") from None
    for doubt in doubts:
        warnings.warn(f"friction provider 'dem': {doubt}", stacklevel=3)


def _warn_of_cost(settings: Settings, pairs: int) -> None:
    """Tell before a run begins that it will take long."""
    each = slide_cpu_s(settings)
    if pairs * each > LONG_S:
        warnings.warn(
            f"friction provider 'dem': {pairs} pairs of tiles may meet, and one that is not in the cache takes about "
            f"{each:.1f} CPU s: {pairs * each / 3600.0:.1g} CPU hours, which the ranks share; friction.provider = "
            "'surrogate', with the same options set again, answers at once",
            stacklevel=2,
        )


def _entry(settings: Settings, slide: Slide) -> Entry:
    curve = slide.curve
    if not curve.mean_normal > 0.0:
        raise MesoError(
            "the plates do not touch anywhere along the slide: take a larger load.pressure (or load.interference), "
            "or load.control = 'force'"
        )
    return Entry(
        coefficient=curve.coefficient,
        uncertainty=curve.uncertainty,
        mean_normal=curve.mean_normal,
        mean_tangential=curve.mean_tangential,
        engine=slide.engine,
        remark=slide.remark,
        imbalance=slide.work.imbalance,
        unconverged_increments=slide.unconverged_increments,
        largest_residual=slide.largest_residual,
        settings=settings,
        code=code(),
        version=version(),
    )
