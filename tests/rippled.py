"""A friction provider for tests of studies: rough in its own way, cheap, and able to fail or to kill on request."""

from __future__ import annotations

import os
import signal
import sys
from typing import ClassVar

import msgspec
import numpy as np

from macrofit.friction import BuildContext, FloatArray, TilePairs, registry

ENTRY = "rippled:Rippled"


class Rippled(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """mu = 0.02 + micro_friction (1 + ripple noise(seed, pair)); noise uniform in -1 ... 1."""

    micro_friction: float = 0.07
    seed: int = 1
    ripple: float = 0.3
    fail_at: int = -1  # the seed whose run fails half way, unless there is a file "repaired" in the current folder
    kill_at: int = -1  # the seed whose run kills its process

    depends_on: ClassVar[frozenset[str]] = frozenset({"tiles"})

    def build(self, context: BuildContext) -> Rippled:
        return self

    def coefficients(self, pairs: TilePairs) -> FloatArray:
        late = int(pairs.seat.max()) > 20
        if late and self.seed == self.fail_at and not os.path.exists("repaired"):
            raise RuntimeError("no such surface")
        if late and self.seed == self.kill_at:
            os.kill(os.getpid(), signal.SIGKILL)
        noise = np.modf(np.sin(pairs.seat * 12.9898 + pairs.bore * 78.233 + self.seed * 37.719) * 43758.5453)[0]
        return np.asarray(0.02 + self.micro_friction * (1.0 + self.ripple * noise))


if __name__ == "__main__":  # the command line with this provider
    from macrofit.cli import main

    registry.BUILT_IN["rippled"] = ENTRY
    main(sys.argv[1:], prog_name="macrofit")
