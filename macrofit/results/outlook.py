"""What a scene will do, in words, before it is computed."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ..base.progress import printable
from ..bodies.approach import sides_of
from ..bodies.outlook import first_touch
from ..scene.deviation import deviation_of
from ..scene.keys import Scene
from ..scene.material import yield_stress
from ..solution import tiles
from .doubts import doubtful_lines
from .foresight import foreseen
from .summary import interference_line


def tiles_outlook(scene: Scene) -> tuple[int, int]:
    """The numbers of friction tiles that seat and bore will have, from the undeformed bodies.

    Raises:
        MeshError: a file cannot be read.
    """
    seat, bore = (tiles(np.array(side.ends)) for side in sides_of(scene))
    return seat, bore


def outlook(scene: Scene) -> Iterator[str]:
    """The lines of `macrofit check`: the fit, its way and friction, and what is doubtful already."""
    touch, places = first_touch(scene), scene.displacements
    if scene.title:
        yield f"Title           {printable(scene.title)}"
    if scene.interference is not None:
        yield interference_line(scene.interference)
    for body in ("axle", "wheel"):
        deviation = deviation_of(scene, body)
        if deviation is not None:
            yield f"{body.capitalize() + ' profile':<15} {deviation.taken}"
    if scene.thermal_strain:
        yield f"Heated wheel    its bore is wider by {scene.thermal_strain:.4%} at the start"
    yield f"Increments      {len(places)}, from {places[0]:g} to {places[-1]:g} mm"
    yield f"First touch     {'none' if touch is None else f'at {touch:g} mm'}"
    yield f"Friction        {scene.friction.provider}"
    yield from _steels(scene)
    yield from doubtful_lines(foreseen(scene))


def _steels(scene: Scene) -> Iterator[str]:
    for name, material in (("axle", scene.axle.material), ("wheel", scene.wheel.material)):
        bears = yield_stress(material)
        if bears is not None:
            beyond = "stays elastic all the same, and says how far beyond it is" if material.elastic else "then flows"
            yield f"{'Steel, ' + name:<15} bears {bears:g} MPa, {beyond}"
