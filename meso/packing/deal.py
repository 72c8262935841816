"""Which packing lies behind which tile: dealt by seeds, so that what a packing does to the friction cancels.

One packing behind all tiles of a body is one draw for the whole press-fit: about 1 % of its force. With a packing of
its own behind each tile it is one draw a tile, and the mean over a seat of a hundred tiles does not feel it.
"""

from __future__ import annotations

import numpy as np

from ..errors import SettingsError

MOST = 65536
"""Packings that may be dealt."""


def packing_of(seed: int, tile: int, *, packings: int | None = None, packing_seed: int = 0) -> int:
    """The packing seed of a tile (or of the pair of a database of this number), 0 to 2^31 - 1.

    With `packings` = k tiles share k packings, the same ones for every seed, so that they are soon in the cache: each
    block of k tiles gets every packing once, in an order of its own. One packing is `packing_seed` itself.

    Args:
        seed: of all surfaces.
        tile: 0, 1, ...; wheel and axle of one number get packings of their own, for they differ by their stream.
        packings: number to be dealt; None: one for each tile and seed.
        packing_seed: chooses other packings.

    Raises:
        SettingsError: a number of packings outside 1 ... 65536.
    """
    if packings is None:
        return _drawn(packing_seed, seed, tile)
    if not 1 <= packings <= MOST:
        raise SettingsError(f"packings = {packings} is out of bounds: take 1 ... {MOST}, or leave it out: one a tile")
    if packings == 1:
        return packing_seed
    block, place = divmod(tile, packings)
    dealt = np.random.default_rng([seed, block]).permutation(packings)[place]
    return _drawn(packing_seed, MOST, int(dealt))


def _drawn(*numbers: int) -> int:
    return (
        int(np.random.SeedSequence(numbers).generate_state(1)[0]) >> 1
    )  # the two plates of a pair make two seeds of one
