"""Compute the scenes of a ladder one after the other, and hold the scene and its presets against the limit."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from mpi4py import MPI

from ..base.ranks import made_by_first, raise_together
from ..errors import SceneError
from ..monitor import lines_of_first
from ..presets import PRESETS
from ..results.folder import prepare_for_all
from ..results.foresight import sharp_corners
from ..scene import Scene
from ..solve import solve
from .estimate import QUANTITIES, Estimate, Figures, distance, estimate, figures
from .ladder import RATIO, given_scene, in_half_steps, preset_scene, remeshed
from .output import NUMBERS, sentences, write_convergence

Say = Callable[[str], None]


@dataclass(frozen=True, kw_only=True)
class Convergence:
    """How far a scene is from converged, and its presets."""

    scene: Scene
    tolerance: float
    estimates: list[Estimate]
    runs: dict[str, Figures]  # name of the run -> its figures
    presets: dict[str, dict[str, float]]  # preset -> quantity -> relative difference from the limit
    meeting: str | None  # the first preset within the tolerance


def carry_out_convergence(
    source: str, comm: MPI.Comm, folder: Path, *, overrides: tuple[str, ...], tolerance: float, quiet: bool
) -> list[str]:
    """Compute, write convergence.json into ``folder``, and give the lines of the table (rank 0). Collective.

    Raises:
        MacrofitError: on all ranks together.
    """
    scene = made_by_first(comm, lambda: given_scene(source, overrides))
    prepare_for_all(comm, folder, NUMBERS)

    def preset(name: str) -> Scene:
        return made_by_first(comm, lambda: preset_scene(source, overrides, name))

    found = converge(scene, preset, comm, tolerance, lines_of_first(comm, quiet=quiet))
    lines: list[str] = []
    with raise_together(comm):
        if comm.rank == 0:
            write_convergence(folder, found)
            lines = [*sentences(found), f"Files           {folder}"]
    return lines


def converge(
    scene: Scene, preset: Callable[[str], Scene], comm: MPI.Comm, tolerance: float, say: Say = lambda line: None
) -> Convergence:
    """Run a scene on three meshes and in half steps, then its presets until one is within the tolerance. Collective.

    Args:
        scene: as `ladder.given_scene` gives it.
        preset: gives the scene as a preset has it.
        comm: the ranks that share each run.
        tolerance: largest relative error of force, pressure and largest stress.
        say: is told what is being computed.

    Raises:
        MacrofitError: a run fails; SceneError where the bodies never touch.
    """
    places = np.array(scene.displacements)
    runs: dict[str, Figures] = {}
    computed: list[tuple[Scene, Figures]] = []

    def run(name: str, tried: Scene) -> Figures:
        same = next((known for other, known in computed if other == tried), None)  # a preset may be the scene itself
        runs[name] = figures(solve(tried, comm), places) if same is None else same
        if same is None:
            computed.append((tried, runs[name]))
            say(f"Computed        {name}: {runs[name].dofs} unknowns, {runs[name].cpu_s:.2g} s")
        return runs[name]

    coarse = run("meshes twice as coarse", remeshed(scene, RATIO))
    if coarse.least_force == 0.0:
        raise SceneError("motion: seat and bore never touch, so there is nothing to compare; see `macrofit check`")
    meshes = (coarse, run("the scene", scene), run("meshes twice as fine", remeshed(scene, 1.0 / RATIO)))
    halved = run("half steps", in_half_steps(scene)) if len(places) > 1 else meshes[1]
    sharp = any(True for _ in sharp_corners(scene))
    found = [estimate(each, meshes, halved, scene.mesh.order, sharp=sharp) for each in QUANTITIES]
    presets: dict[str, dict[str, float]] = {}
    meeting = None
    for name in PRESETS:
        tried = run(f"preset {name}", preset(name))
        presets[name] = {
            each.quantity.key: distance(each.quantity.key, tried, each.limit) + each.step_error
            for each in found
            if each.mesh_error is not None
        }
        if max(presets[name].values()) <= tolerance:
            meeting = name
            break
    return Convergence(scene=scene, tolerance=tolerance, estimates=found, runs=runs, presets=presets, meeting=meeting)
