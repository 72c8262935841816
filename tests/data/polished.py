"""A seat that earlier fits have polished at its entrance: friction.provider = "polished"."""

import msgspec
import numpy as np


class Polished(msgspec.Struct, frozen=True):  # its fields are the keys of [friction.options]
    worn: float = 0.08  # coefficient of friction at the entrance [-]
    fresh: float = 0.12  # and far from it [-]
    length: float = 40.0  # over which it changes [mm]

    def build(self, context):  # the context has the number of tiles, their size and place, Young's modulus, ...
        return PolishedTiles(self, context)


class PolishedTiles:
    depends_on = frozenset({"tiles"})  # of "tiles", "pressure", "sliding"; each pair of tiles is then asked about once

    def __init__(self, options, context):
        self.options, self.context = options, context

    def coefficients(self, pairs):  # arrays of tile numbers, pairs.seat and pairs.bore; pairs.pressure, pairs.sliding
        z = self.context.seat_origin + (pairs.seat + 0.5) * self.context.tile_size
        share = np.exp(-np.maximum(z, 0.0) / self.options.length)
        return self.options.fresh + (self.options.worn - self.options.fresh) * share

    def uncertainty(self, pairs):  # may be left out
        return np.full(len(pairs.seat), 0.01)

    def outside(self, pairs):  # may be left out: by what share each coefficient may be wrong, for each reason
        z = self.context.seat_origin + pairs.seat * self.context.tile_size
        return {"unknown tiles: lie beyond what was measured; press less far": np.where(z > 150.0, 0.2, 0.0)}
