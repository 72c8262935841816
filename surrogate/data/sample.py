"""One sample: a friction test of a pair of rough plates. The only module of the package that runs the plates."""

from __future__ import annotations

import json
import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any

import msgspec
import numpy as np

from macrofit.base.provenance import version
from meso.coefficient_cache import code
from meso.errors import MesoError
from meso.friction_test import run
from meso.presets import DEFAULT, preset_tables
from meso.settings import Settings, dump
from meso.settings import load as load_settings

from ..errors import DesignError
from .design import DESIGNS, Design
from .faces import sampled_heights
from .samples import Header

KEYS_OF_DESIGN = {
    "surface.generator": "surfaces are of Diamond-Square",
    "surface.rms_height": "surfaces are of Diamond-Square",
    "surface.wheel_seed": "it follows from --first-surface and the number of the pair",
    "surface.axle_seed": "it follows from --first-surface and the number of the pair",
    "surface.levels": "it is --levels",
    "surface.max_height": "it is --max-height",
    "surface.hurst_exponent": "it is --hurst",
    "plates.packing_seed": "it follows from --first-packing",
    "plates.axle_packing_seed": "it follows from --first-packing",
    "contact.micro_friction": "it is --micro-friction",
}
"""Keys of the plates' settings that belong to the design, and what sets them."""
KEYS_OF_WIDE = {"load.pressure": "pressure", "surface.form": "forms", "surface.lay": "with_lay"}
"""Keys that belong to a design which varies them, and the field by which it does."""


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


def design_tasks(design: Design, settings: Settings, pairs: int, header: Header) -> Iterator[Task]:
    """All samples of the first pairs of a design, by id."""
    for pair, point in enumerate(design.points(pairs)):
        seed = design.surface_seed(pair, str(point.face.get("form", settings.surface.form)))
        shape = {"levels": point.levels, "max_height": point.max_height, "hurst_exponent": point.hurst_exponent}
        surface = msgspec.structs.replace(settings.surface, wheel_seed=seed, axle_seed=seed, **shape, **point.face)
        load = settings.load
        if point.pressure is not None:
            load = msgspec.structs.replace(load, pressure=point.pressure)
        contact = msgspec.structs.replace(settings.contact, micro_friction=point.micro_friction)
        for packing in range(design.packings):
            packed = msgspec.structs.replace(settings.plates, packing_seed=design.packing_seed(pair, packing))
            changed = msgspec.structs.replace(settings, surface=surface, plates=packed, contact=contact, load=load)
            yield Task(design.packings * pair + packing, changed, header)


def plate_settings(overrides: Iterable[str] = (), preset: str = DEFAULT, design: Design | None = None) -> Settings:
    """Read settings of the plates: a preset's, changed by `key=value` with dotted keys that are not the design's.

    Args:
        overrides: the changes.
        preset: name of the plates.
        design: what it varies besides is refused too.

    Raises:
        DesignError: naming the key.
    """
    overrides = tuple(overrides)
    try:
        settings, plain = load_settings(None, overrides, preset), load_settings(None, (), preset)
    except MesoError as error:
        raise DesignError(f"--set {error}") from None
    named = {override.partition("=")[0].strip() for override in overrides}
    varied = {key: f"--design varies it ({field})" for key, field in KEYS_OF_WIDE.items() if getattr(design, field, 0)}
    for key, instead in (KEYS_OF_DESIGN | varied).items():
        table, _, name = key.partition(".")
        if key in named or getattr(getattr(settings, table), name) != getattr(getattr(plain, table), name):
            raise DesignError(f"--set {key}: leave it out, {instead}")
    return settings


def design_on_preset(preset: str, design: str = "narrow", **options: Any) -> Design:
    """The design of these options; ranges that are left out (None) are those of a named design, or a preset's.

    A preset with one roughness has a range of one value.
    """
    surface = preset_tables(preset).get("surface", {})
    ranges: dict[str, Any] = {}
    if surface:
        height, exponent = surface["max_height"], surface["hurst_exponent"]
        ranges = {"max_height": (height,) * 2, "levels": (surface["levels"],), "hurst_exponent": (exponent,) * 2}
    return Design(**ranges | DESIGNS[design] | {key: value for key, value in options.items() if value is not None})


def header_of(design: Design, settings: Settings) -> Header:
    """Compile what all samples of a design share."""
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
        "pressure": settings.load.pressure,
        "form": surface.form.encode(),
        "lay": surface.lay.encode(),
        "feed": surface.feed,
        "groove_depth": surface.groove_depth,
        "anisotropy": surface.anisotropy,
        "wheel": sampled_heights(test.plates.wheel_packing.surface, header.points),
        "axle": sampled_heights(test.plates.axle_packing.surface, header.points),
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
