"""What a scene will do, in words, before it is computed."""

from __future__ import annotations

from collections.abc import Iterator

from ..base.progress import printable
from ..bodies.outlook import first_touch
from ..scene.deviation import deviation_of
from ..scene.keys import Scene
from .doubts import doubtful_lines
from .foresight import foreseen
from .summary import interference_line


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
    yield from doubtful_lines(foreseen(scene))
