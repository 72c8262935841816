"""The scenes that are compared: coarser, as given, finer, in shorter steps, and as each preset has it."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import pairwise

import msgspec

from ..errors import SceneError
from ..scene import Scene, load_scene
from ..scene.keys import Motion

RATIO = 2.0
"""From one mesh to the next, and from one step length to the next."""
PRESET_WORD = "preset="


def given_scene(source: str, overrides: Sequence[str]) -> Scene:
    """The scene whose convergence is asked for.

    Raises:
        SceneError: it is none, or its meshes come from files, which cannot be refined.
    """
    scene = load_scene(source, overrides)
    files = [f"mesh.{body}" for body in ("axle", "wheel") if getattr(scene.mesh, body) is not None]
    if files:
        raise SceneError(
            f"{', '.join(files)}: converge cannot refine meshes from files; make finer ones, run a scene with each, "
            f"and compare their curves with `macrofit plot`"
        )
    return without_fields(scene)


def without_fields(scene: Scene) -> Scene:
    """The scene with its largest stresses, and without fields that nobody will look at."""
    output = msgspec.structs.replace(scene.output, stress=True, fields=(), frames=0)
    return msgspec.structs.replace(scene, output=output)


def remeshed(scene: Scene, factor: float) -> Scene:
    """The scene with every size of its mesh, and the growth between them, ``factor`` times as large."""
    mesh = scene.mesh
    sizes = {key: getattr(mesh, key) for key in ("seat_facet", "bore_facet", "corner_facet", "coarse", "growth")}
    changed = {key: factor * value for key, value in sizes.items() if value is not None}
    return msgspec.structs.replace(scene, mesh=msgspec.structs.replace(mesh, **changed))


def in_half_steps(scene: Scene) -> Scene:
    """The scene with one more displacement in the middle between each two."""
    places = scene.displacements
    halves = [each for a, b in pairwise(places) for each in (a, 0.5 * (a + b))]
    motion = Motion(displacements=(*halves, places[-1]), max_cutbacks=scene.motion.max_cutbacks)
    return msgspec.structs.replace(scene, motion=motion)


def preset_scene(source: str, overrides: Iterable[str], name: str) -> Scene:
    """The scene as `--preset name` has it, with the other overrides as given."""
    others = [each for each in overrides if not each.startswith(PRESET_WORD)]
    return without_fields(load_scene(source, others, name))
