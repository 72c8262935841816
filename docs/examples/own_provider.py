"""A friction law of your own as a provider for scenes: options, conformance test, entry point, a run.

    python own_provider.py

A package that is installed names its provider in pyproject.toml:

    [project.entry-points."macrofit.friction"]
    pressed = "own_provider:Pressed"

Then `friction.provider = "pressed"` works in every scene. Here the script hands the same class to the solver itself.
"""

from __future__ import annotations

import msgspec
import numpy as np

from macrofit.friction import BuildContext, FloatArray, TilePairs
from macrofit.friction.conformance import check
from macrofit.scene import load_scene
from macrofit.solve import solve


class Pressed(msgspec.Struct, frozen=True):
    """Friction that falls with the pressure; the fields are the keys of [friction.options]."""

    low: float = 0.10  # coefficient under high pressure [-]
    high: float = 0.14  # coefficient without pressure [-]
    pressure: float = 100.0  # over which it falls [MPa]

    def build(self, context: BuildContext) -> PressedTiles:
        """The provider for the tiles of a scene."""
        return PressedTiles(self)


class PressedTiles:
    """mu(p) = low + (high - low) exp(-p / pressure), p in MPa."""

    depends_on = frozenset({"tiles", "pressure"})  # asked again in each increment, for the pressure changes

    def __init__(self, options: Pressed) -> None:
        self.options = options

    def coefficients(self, pairs: TilePairs) -> FloatArray:
        """One coefficient for each pair of tiles."""
        share = np.exp(-pairs.pressure / self.options.pressure)
        return self.options.low + (self.options.high - self.options.low) * share


def main() -> None:
    """Check the contract, then press a wheel with it and with the uniform coefficient `low`."""
    context = BuildContext(seat_tiles=9, bore_tiles=9, youngs_modulus=206e3, poisson_ratio=0.3)
    check(Pressed().build(context))

    scene = load_scene("wheelset", ["motion.travel=60", "friction.options.coefficient=0.10"])
    for name, solution in (("uniform", solve(scene)), ("pressed", solve(scene, friction=PressedTiles(Pressed())))):
        last = solution.increments[-1]
        print(f"{name}: {last.force / 1e3:.1f} kN, mean coefficient {last.mean_friction:.4f}")


if __name__ == "__main__":
    main()
