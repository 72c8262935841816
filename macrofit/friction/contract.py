"""The friction contract: what the solver asks of a source of friction, and what it gives it to answer with.

The seat of the axle and the bore of the wheel are cut into tiles of one length. A provider gives the
coefficient of friction of a pair of tiles, one of each body. Where the coefficient comes from (a number, a
table, a discrete model of two rough surfaces, a network) is the provider's own affair.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple, Protocol, TypeAlias, runtime_checkable

import msgspec
import numpy as np
import numpy.typing as npt

IntArray: TypeAlias = npt.NDArray[np.int64]
FloatArray: TypeAlias = npt.NDArray[np.float64]

QUANTITIES = frozenset({"tiles", "pressure", "sliding"})
"""What a coefficient may depend on."""

LIMIT = 2.0
"""A coefficient of friction mu is accepted when 0 <= mu < LIMIT [-]."""


class TilePairs(NamedTuple):
    """A batch of n pairs of facing tiles: four arrays of shape (n,)."""

    seat: IntArray
    """Tile number on the axle's seat, counted from its entrance."""
    bore: IntArray
    """Tile number on the wheel's bore, counted from its leading edge."""
    pressure: FloatArray
    """Mean contact pressure of the pair at the last accepted increment [MPa]."""
    sliding: FloatArray
    """Distance the seat tile has already slid [mm]."""

    def take(self, index: IntArray) -> TilePairs:
        """A new batch of the pairs numbered `index`, in that order."""
        return TilePairs(self.seat[index], self.bore[index], self.pressure[index], self.sliding[index])

    def copy(self) -> TilePairs:
        """The same batch in arrays of its own."""
        return TilePairs(self.seat.copy(), self.bore.copy(), self.pressure.copy(), self.sliding.copy())


class FrictionProvider(Protocol):
    """A source of coefficients of friction.

    A provider is pure: the same pairs always get the same coefficients, whatever else stands in the batch and
    in whatever order. It prints nothing, knows nothing of MPI, and leaves the arrays it is given as they are.
    It may also say how sure it is, see `StatesUncertainty`, and have `counters`, a dict of names and whole numbers that
    the summary of a run shows; `calls` is the solver's own. A dict `origin`, of what JSON knows, is kept with the
    provenance of a run. It may say where its answers may be wrong, see `KnowsItsRange`. Where several runs go in
    lockstep it may hear of their questions together, see `HearsAhead`.
    """

    @property
    def depends_on(self) -> frozenset[str]:
        """A subset of {"tiles", "pressure", "sliding"}; a plain or class attribute will do.

        Empty: asked once for the whole run. Only "tiles": asked once for each pair. Otherwise: asked for all
        the pairs in contact at each increment.
        """
        ...

    def coefficients(self, pairs: TilePairs) -> FloatArray:
        """The coefficient of friction mu of each pair [-], shape (n,), finite, 0 <= mu < 2; n may be 0."""
        ...


@runtime_checkable
class StatesUncertainty(Protocol):
    """What a provider may have besides: how sure it is of its coefficients."""

    def uncertainty(self, pairs: TilePairs) -> FloatArray:
        """The standard deviation of the coefficient of each pair [-], shape (n,), >= 0; NaN where it states none.

        Asked right after `coefficients`, about the same pairs, and as pure; it may depend on no more than they do.
        """
        ...


@runtime_checkable
class KnowsItsRange(Protocol):
    """What a provider may have besides: it says for which pairs its answers may be wrong."""

    def outside(self, pairs: TilePairs) -> Mapping[str, FloatArray]:
        """By what share each coefficient may be wrong for lying outside of what it knows [-], (n,), for each reason.

        0 within, never NaN; n may be 0. Asked when a run is over, about pairs that were in contact with the pressures
        that they had then. The reasons are the same whatever pairs are asked about. Where they may make the force wrong
        by more than a per cent the run is doubtful, in their words: "two words: are so and so; what to try".
        """
        ...


@runtime_checkable
class HearsAhead(Protocol):
    """What a provider may have besides: it hears what it will be asked, before any of several runs in lockstep asks."""

    def announced(self, pairs: TilePairs) -> None:
        """Pairs that `coefficients` will be asked about next, so that providers that share what is costly get it once.

        It changes no answer, and questions may come that were not announced.
        """
        ...


class BuildContext(msgspec.Struct, frozen=True, kw_only=True):
    """What a provider may know of the run before it starts."""

    seat_tiles: int
    """Number of tiles on the seat."""
    bore_tiles: int
    """Number of tiles on the bore."""
    tile_size: float = 1.0
    """Axial length of a tile [mm]."""
    seat_origin: float = 0.0
    """Where seat tile 0 starts [mm], on the coordinate that is 0 at the entrance of the seat; below 0 on a taper."""
    youngs_modulus: float
    """Young's modulus of the axle [MPa]."""
    poisson_ratio: float
    """Poisson ratio of the axle [-]."""
    cache_dir: str | None = None
    """Folder where a provider may keep what was costly to compute; None: keep nothing."""


class ProviderOptions(Protocol):
    """What an entry point of the group "macrofit.friction" names: a frozen `msgspec.Struct` with `build`.

    Its fields are the keys of `[friction.options]`, decoded strictly. A Struct nested in it should be
    declared with `forbid_unknown_fields=True`, for only the keys of the outer one are checked for it.
    """

    def build(self, context: BuildContext) -> FrictionProvider:
        """The provider with these options, ready to be asked; it may be the same object."""
        ...
