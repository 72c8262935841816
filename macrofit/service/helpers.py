"""Ranks share the harmonics: while the first one presses, the others condense its bodies, harmonic by harmonic.

They do with the same bodies what the first would do itself, so that it ends with the same bits on any number of ranks.
"""

from __future__ import annotations

from types import TracebackType

from mpi4py import MPI

from ..assembly import discretise_bodies
from ..bodies.body import Body
from ..errors import MacrofitError
from ..scene import Scene
from .harmonics import Condensed, HarmonicBody
from .wheelset import in_harmonics, loads_of, service_keys

Both = dict[str, Condensed]
"""A harmonic of axle and wheel, each by its name."""


class Helpers:
    """The ranks but the first, as the first one sees them; leaving the `with` block hears what is still to come."""

    def __init__(self, comm: MPI.Comm, scene: Scene) -> None:
        self._comm, self._harmonics = comm, service_keys(scene).harmonics
        self._found: dict[int, Both | None] | None = None

    def __enter__(self) -> Helpers:
        return self

    def __exit__(self, kind: type | None, error: BaseException | None, trace: TracebackType | None) -> None:
        if error is None or isinstance(error, MacrofitError):  # other errors end all ranks
            self._all()

    def revolved(self, body: Body, name: str) -> HarmonicBody:
        """The axle or the wheel in harmonics, condensed by the others."""
        out = in_harmonics(body, name)
        for n, found in self._all().items():
            if found is not None:
                out.take(n, found[name])
        return out

    def _all(self) -> dict[int, Both | None]:
        if self._found is None:
            self._found = {n: self._comm.recv(source=_rank_of(n, self._comm), tag=n) for n in _all_of(self._harmonics)}
        return self._found


def help_first(comm: MPI.Comm, scene: Scene) -> None:
    """Condense what falls to this rank and send it to the first; None where it fails, for the first will fail alike."""
    mine = [n for n in _all_of(service_keys(scene).harmonics) if _rank_of(n, comm) == comm.rank]
    made: list[HarmonicBody] = []
    sent = [comm.isend(_condensed(scene, n, made), 0, tag=n) for n in mine]
    MPI.Request.waitall(sent)


def _all_of(harmonics: int) -> range:
    return range(harmonics + 1)


def _rank_of(n: int, comm: MPI.Comm) -> int:
    return 1 + n % (comm.size - 1)


def _condensed(scene: Scene, n: int, made: list[HarmonicBody]) -> Both | None:
    try:
        if not made:
            bodies = discretise_bodies(scene, MPI.COMM_SELF)
            made += [in_harmonics(bodies[name], name) for name in ("axle", "wheel")]
        loads = loads_of(service_keys(scene), made[0], made[1], 0.0)
        return {
            "axle": made[0].condensed(n, loads.of_axle(n)),
            "wheel": made[1].condensed(n, loads.of_wheel(n)),
        }
    except MacrofitError:
        return None
