"""Fill a database with friction tests of rough plates: the design of the samples, one sample, and the task farm.

The only module of the package that runs the plates.

    design = Design(max_height=(0.005, 0.04))
    generate(Path("train.h5"), design, plates(["plates.spheres=3000"]), pairs=1000, farm=Pool(2))

Sample `id` = packings x pair + packing. A sample depends on its place in the design alone, so whatever is killed goes
on with the same call, by any number of workers.
"""

from __future__ import annotations

import json
import multiprocessing
import os
import signal
import threading
import time
import warnings
from collections.abc import Generator, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any, Protocol

import msgspec
import numpy as np
import numpy.typing as npt
from scipy.stats import qmc

from macrofit.base.provenance import version
from meso.coefficient_cache import code
from meso.errors import MesoError
from meso.friction_test import run
from meso.settings import Settings, dump
from meso.settings import load as load_settings

from ..errors import DesignError, SurrogateError
from .database import Header, open_database
from .faces import heights
from .monitor import FarmMonitor, Silent

FRICTION_RANGE = (0.01, 0.09)
"""Of the micro coefficients of a design [-]; each pair takes one of every equal part of it."""
FINEST = 5
"""Levels; the 33 points of a matrix along an edge leave out nothing of 2^n + 1 up to here."""
DESIGNED = {
    "surface.generator": "surfaces are of Diamond-Square",
    "surface.rms_height": "surfaces are of Diamond-Square",
    "surface.wheel_seed": "it is --first-surface plus the number of the pair",
    "surface.axle_seed": "it is --first-surface plus the number of the pair",
    "surface.levels": "it is --levels",
    "surface.max_height": "it is --max-height",
    "surface.hurst_exponent": "it is --hurst",
    "plates.packing_seed": "it follows from --first-packing",
    "contact.micro_friction": "it is --micro-friction",
}
"""Keys of the plates that belong to the design, and what sets them."""


class Design(msgspec.Struct, frozen=True, kw_only=True):
    """Where samples lie: a scrambled Sobol sequence over log R, level, exponent and micro coefficients.

    Pair i has surfaces of its own, wheel_seed = axle_seed = first_surface + i (the streams of the two bodies are
    independent), and the point of the sequence with that number: a split by pair is a split by seed, and databases
    of disjoint seeds continue one design.
    """

    seed: int = 0
    """Of the scrambling."""
    first_surface: int = 0
    first_packing: int = 0
    """Packings have the seeds from here on; see `packing_seed`."""
    packings: int = 1
    """Of the same pair of surfaces."""
    packing_seeds: int = 256
    """Flat packings, of two plates each, that share the pairs. With 16 of them a network of envelopes learns these very
    spheres: its error on others was 0.86 % where cross-validation among them had promised 0.62 %."""
    max_height: tuple[float, float] = (0.005, 0.04)
    """R, log-uniform [mm]."""
    levels: tuple[int, ...] = (3, 4)
    hurst_exponent: tuple[float, float] = (0.5, 1.0)
    micro_friction: int | tuple[float, ...] = 2
    """How many, one in each part of FRICTION_RANGE; or the coefficients themselves, the same for all pairs."""

    def __post_init__(self) -> None:
        limits = {
            "--seed": (self.seed, 0, 2**32 - 1),
            "--first-surface": (self.first_surface, 0, 2**30 - 1),
            "--first-packing": (self.first_packing, 0, 2**30 - 1),
            "--packings": (self.packings, 1, 10_000),
            "packing_seeds": (self.packing_seeds, 1, 10_000),
            "--micro-friction": (self.count, 1, 100),
        }
        for option, (value, low, high) in limits.items():
            if not low <= value <= high:
                raise DesignError(f"{option} = {value} is out of bounds: take {low} ... {high}")
        if not 0.0 < self.max_height[0] <= self.max_height[1]:
            raise DesignError(f"--max-height = {self.max_height}: take two heights in mm, 0 < the lower <= the upper")
        if not 0.0 <= self.hurst_exponent[0] <= self.hurst_exponent[1] <= 1.0:
            raise DesignError(f"--hurst = {self.hurst_exponent}: take two exponents, 0 <= the lower <= the upper <= 1")
        if not self.levels or not all(1 <= level <= FINEST for level in self.levels):
            raise DesignError(f"--levels = {self.levels}: take one or more of 1 ... {FINEST}")
        given = self.micro_friction
        if isinstance(given, tuple) and (list(given) != sorted(set(given)) or not all(0 <= mu <= 2 for mu in given)):
            raise DesignError(f"--micro-friction = {given}: take rising numbers from 0 to 2")

    @property
    def count(self) -> int:
        """k, micro coefficients per sample."""
        return self.micro_friction if isinstance(self.micro_friction, int) else len(self.micro_friction)

    def points(self, pairs: int) -> list[Point]:
        """The first pairs of the design; more pairs have the same beginning."""
        if not 1 <= pairs <= 2**30 - self.first_surface:
            raise DesignError(f"--pairs = {pairs}: take 1 ... {2**30 - self.first_surface}")
        sequence = qmc.Sobol(3 + self.count, scramble=True, seed=self.seed)
        if self.first_surface:  # by 0 it fails
            sequence.fast_forward(self.first_surface)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # that their number is no power of two
            return [self._point(u) for u in sequence.random(pairs)]

    def _point(self, u: npt.NDArray[np.float64]) -> Point:
        low, high = self.max_height
        given = self.micro_friction
        if isinstance(given, int):
            start, end = FRICTION_RANGE
            given = tuple((start + (end - start) * (np.arange(self.count) + u[3:]) / self.count).tolist())
        return Point(
            max_height=float(low * (high / low) ** u[0]),
            levels=self.levels[int(u[1] * len(self.levels))],
            hurst_exponent=float(self.hurst_exponent[0] + (self.hurst_exponent[1] - self.hurst_exponent[0]) * u[2]),
            micro_friction=given,
        )

    def packing_seed(self, pair: int, packing: int) -> int:
        """A block of `packings` seeds for each pair in turn, so that pairs share all their packings or none."""
        blocks = max(1, self.packing_seeds // self.packings)
        return self.first_packing + (pair % blocks) * self.packings + packing

    def tasks(self, plates: Settings, pairs: int, header: Header) -> Iterator[Task]:
        """All samples of the first pairs, by id."""
        for pair, point in enumerate(self.points(pairs)):
            seed = self.first_surface + pair
            surface = msgspec.structs.replace(
                plates.surface,
                wheel_seed=seed,
                axle_seed=seed,
                levels=point.levels,
                max_height=point.max_height,
                hurst_exponent=point.hurst_exponent,
            )
            contact = msgspec.structs.replace(plates.contact, micro_friction=point.micro_friction)
            for packing in range(self.packings):
                packed = msgspec.structs.replace(plates.plates, packing_seed=self.packing_seed(pair, packing))
                settings = msgspec.structs.replace(plates, surface=surface, plates=packed, contact=contact)
                yield Task(self.packings * pair + packing, settings, header)


class Point(msgspec.Struct, frozen=True, kw_only=True):
    """What the design chooses for a pair."""

    max_height: float
    levels: int
    hurst_exponent: float
    micro_friction: tuple[float, ...]


@dataclass(frozen=True)
class Task:
    """One sample to be computed."""

    id: int
    settings: Settings
    header: Header


@dataclass(frozen=True)
class Result:
    """One sample: its row, or why there is none."""

    id: int
    row: bytes = b""
    reason: str = ""


def plates(overrides: Iterable[str] = ()) -> Settings:
    """Settings of the plates, changed by `key=value` with dotted keys that are not the design's.

    Raises:
        DesignError: naming the key.
    """
    overrides = tuple(overrides)
    try:
        settings = load_settings(None, overrides)
    except MesoError as error:
        raise DesignError(f"--set {error}") from None
    named = {override.partition("=")[0].strip() for override in overrides}
    plain = Settings()
    for key, instead in DESIGNED.items():
        table, _, name = key.partition(".")
        if key in named or getattr(getattr(settings, table), name) != getattr(getattr(plain, table), name):
            raise DesignError(f"--set {key}: leave it out, {instead}")
    return settings


def header_of(design: Design, settings: Settings) -> Header:
    """What all samples of a design share."""
    options: dict[str, Any] = msgspec.to_builtins(design)
    options["first_point"] = msgspec.to_builtins(design.points(1)[0])  # another scipy may scramble otherwise
    return Header(
        design=json.dumps(options),
        settings=dump(settings),
        code=code("meso.friction_test"),
        version=version(),
        micro_frictions=design.count,
        squares=round((settings.plates.edge + settings.load.slide) / settings.plates.edge),
    )


def simulate(task: Task) -> Result:
    """Run the friction tests of one sample. What the plates cannot do is a result too; a bug is raised."""
    started = time.process_time()
    settings, header = task.settings, task.header
    try:
        test = run(settings)
    except MesoError as error:
        return Result(task.id, reason=" ".join(str(error).split()))
    curves = [slide.curve for slide in test.slides]
    for slide in test.slides:
        if not slide.curve.mean_normal > 0.0:
            return Result(task.id, reason=f"the plates never touch along the slide with {slide.micro_friction:g}")
    surface, across = settings.surface, 2 * header.points - 1
    along = header.squares * (across - 1) + 1
    row = np.zeros((), header.row())
    values = {
        "id": task.id,
        "wheel_seed": surface.wheel_seed,
        "axle_seed": surface.axle_seed,
        "packing_seed": settings.plates.packing_seed,
        "levels": surface.levels,
        "max_height": surface.max_height,
        "hurst_exponent": surface.hurst_exponent,
        "wheel": heights(test.plates.wheel_packing.surface, header.points),
        "axle": heights(test.plates.axle_packing.surface, header.points),
        "wheel_envelope": test.plates.wheel_packing.envelope((across, across)),
        "axle_envelope": test.plates.axle_packing.envelope((along, across)),
        "micro_friction": [slide.micro_friction for slide in test.slides],
        "meso_friction": [curve.coefficient for curve in curves],
        "meso_friction_mean_of_ratio": [curve.mean_of_ratio for curve in curves],
        "uncertainty": [curve.uncertainty for curve in curves],
        "mean_normal": [curve.mean_normal for curve in curves],
        "mean_tangential": [curve.mean_tangential for curve in curves],
        "minimum_normal": [curve.normal.min() for curve in curves],
        "stored_energy": [slide.work.elastic + slide.work.contact for slide in test.slides],
        "friction_loss": [slide.work.friction for slide in test.slides],
        "approach": [slide.squeeze.displacement[-1] for slide in test.slides],
        "engine": [slide.engine.encode() for slide in test.slides],
        "remark": "; ".join(slide.remark for slide in test.slides if slide.remark).encode(),
        "cpu_s": time.process_time() - started,
    }
    for name in header.row().names or ():
        row[name] = values[name]
    return Result(task.id, row.tobytes())


class Farm(Protocol):
    """Who computes."""

    def results(self, tasks: Iterable[Task]) -> Iterator[Result]:
        """The results of the tasks, in any order."""
        ...


class Here:
    """This process, one task after the other."""

    def results(self, tasks: Iterable[Task]) -> Iterator[Result]:
        """In the order of the tasks."""
        return map(simulate, tasks)


class Ranks:
    """The workers of an executor, such as those of `mpi4py.futures.MPICommExecutor`."""

    def __init__(self, executor: Executor, workers: int) -> None:
        self._executor, self._workers = executor, workers

    def results(self, tasks: Iterable[Task]) -> Iterator[Result]:
        """As they end. The first are under way when this returns; two per worker are, or wait, at any time."""
        ahead = iter(tasks)
        return self._ended({self._executor.submit(simulate, task) for task in islice(ahead, 2 * self._workers)}, ahead)

    def _ended(self, pending: set[Future[Result]], ahead: Iterator[Task]) -> Iterator[Result]:
        while pending:
            ended, pending = wait(pending, return_when=FIRST_COMPLETED)
            pending |= {self._executor.submit(simulate, task) for task in islice(ahead, len(ended))}
            yield from (future.result() for future in ended)


class Pool:
    """Processes of their own on this machine; they end with the one that started them, however it ends."""

    def __init__(self, jobs: int) -> None:
        self._jobs = jobs

    def results(self, tasks: Iterable[Task]) -> Iterator[Result]:
        """As they end.

        Raises:
            SurrogateError: a process was killed, as by a machine that runs out of memory.
        """
        others = set(multiprocessing.active_children())
        pool = ProcessPoolExecutor(self._jobs, multiprocessing.get_context("spawn"), initializer=_end_with_parent)
        try:
            with _ctrl_c_withheld():  # the processes start with the first tasks, and keep this
                running = Ranks(pool, self._jobs).results(tasks)
            yield from running
            pool.shutdown()
        except BrokenProcessPool:
            raise SurrogateError(
                "a process of the farm was killed (out of memory?); what was computed is kept, and the same command "
                "goes on; try fewer --jobs"
            ) from None
        finally:
            pool.shutdown(wait=False, cancel_futures=True)
            for child in set(multiprocessing.active_children()) - others:
                child.terminate()


def generate(
    path: Path, design: Design, settings: Settings, pairs: int, farm: Farm, monitor: FarmMonitor | None = None
) -> None:
    """Add to a database what it lacks of the first pairs of a design.

    A sample that failed before is not tried again.

    Raises:
        DesignError: the design asks for what cannot be.
        DatabaseError: see `open_database`.
        SurrogateError: see `Pool`.
    """
    monitor = monitor or Silent()
    header = header_of(design, settings)
    tasks = list(design.tasks(settings, pairs, header))
    with open_database(path, header) as (writer, done):
        ahead = [task for task in tasks if task.id not in done]
        monitor.started(len(tasks), len(tasks) - len(ahead))
        results = farm.results(ahead)
        try:
            for result in results:
                if result.reason:
                    writer.fail(result.id, result.reason)
                else:
                    writer.append(result.row)
                monitor.advanced(failed=bool(result.reason))
        finally:
            if isinstance(results, Generator):
                results.close()  # ends the processes of a farm that is left early
            monitor.finished()


def _end_with_parent() -> None:
    """A process whose parent was killed would wait for tasks for ever."""

    def watch() -> None:
        parent = multiprocessing.parent_process()
        if parent is not None:
            parent.join()
            os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


@contextmanager
def _ctrl_c_withheld() -> Iterator[None]:
    """Ctrl-C reaches all processes of a terminal; those started here leave it to this one, which gets it afterwards."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
