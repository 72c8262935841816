"""The friction test: two rough plates are squeezed, slid over each other, and give the meso coefficient.

    plates = make_plates(settings)                   # surfaces, packings, lattices
    engine = QuasiStatic(plates) or Explicit(plates)
    slide  = engine.slide(micro_friction)            # squeeze, slide: N, T along the way; as often as asked

`run` does the three and picks the engine by the settings. Where `auto` finds no equilibrium, the explicit engine
answers, and the answer says that it is doubtful.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Protocol

from .plates import Plates, make_plates
from .records import Slide
from .settings import Settings

LARGEST_CONDENSED = 14_000
"""Spheres of both plates together above which `auto` takes the explicit engine for a single micro coefficient."""


class Engine(Protocol):
    """Plates prepared for any number of slides."""

    name: str

    def slide(self, micro_friction: float) -> Slide:
        """Squeeze and slide with this micro coefficient of friction."""
        ...


@dataclass(frozen=True, kw_only=True)
class FrictionTest:
    """The outcome of a friction test."""

    settings: Settings
    plates: Plates
    slides: list[Slide]
    """One for each micro coefficient, in the order asked for."""
    packing_cpu_s: float
    """CPU time of surfaces, packings and lattices [s]."""
    setup_cpu_s: float
    """CPU time of preparing the engine [s]."""


def run(settings: Settings, watch: Callable[[str], None] = lambda stage: None) -> FrictionTest:
    """Compute the meso coefficient for every micro coefficient of the settings; `watch` hears of each stage.

    Raises:
        MesoError: what cannot be computed, and what to try.
    """
    started = time.process_time()
    watch("plates")
    plates = make_plates(settings)
    packed = time.process_time()
    engine = prepared(plates)
    ready = time.process_time()
    slides = []
    for slide in slid(plates, engine, settings.contact.coefficients, watch):
        slides.append(slide)
    return FrictionTest(
        settings=settings,
        plates=plates,
        slides=slides,
        packing_cpu_s=packed - started,
        setup_cpu_s=ready - packed,
    )


def slid(
    plates: Plates, engine: Engine, coefficients: tuple[float, ...], watch: Callable[[str], None] = lambda stage: None
) -> Iterator[Slide]:
    """One slide after the other.

    Where `auto` finds no equilibrium the explicit engine steps in, at `engine.speed`, and the slide says that it is
    doubtful: on external faces as stiff as the solid, the only ones `auto` is for, it differs by the speed alone.

    Raises:
        Unsettled: the quasi-static engine was asked for by name and finds no equilibrium.
    """
    from .engines.quasistatic import Unsettled

    for micro_friction in coefficients:
        watch(f"micro_friction = {micro_friction:g}")
        try:
            yield engine.slide(micro_friction)
        except Unsettled as unsettled:
            if plates.settings.engine.name != "auto":
                raise Unsettled(
                    f"{unsettled}: take a smaller engine.increment, or engine.name = 'explicit' for all pairs"
                ) from unsettled
            from dataclasses import replace

            from .engines.explicit import Explicit

            watch(f"{unsettled}; the explicit engine takes over")
            slide = Explicit(plates).slide(micro_friction)
            yield replace(slide, remark=f"doubtful, slid at {1e-3 * plates.speed:g} m/s instead: {unsettled}")


def engine_name(settings: Settings) -> str:
    """The engine that `auto` stands for here.

    Explicit where a time step or a resonance is given, where beams may break, and where the condensed plates grow too
    large. The settings alone decide, never the surfaces.
    """
    keys = settings.engine
    if keys.name != "auto":
        return keys.name
    return "explicit" if keys.dynamic or settings.plates.spheres > LARGEST_CONDENSED else "quasi-static"


def prepared(plates: Plates) -> Engine:
    """The engine that the settings ask for, ready to slide."""
    name = engine_name(plates.settings)
    if name == "explicit":
        from .engines.explicit import Explicit

        return Explicit(plates)
    from .engines.quasistatic import QuasiStatic

    return QuasiStatic(plates)
