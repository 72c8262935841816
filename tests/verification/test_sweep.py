"""Every built-in scene converges whatever the friction and gamma0: coarse meshes here, the full ones in
``tests/benchmarks/sweep.py``.
"""

from __future__ import annotations

import pytest
from benchmarks.sweep import FRICTION, GAMMA0, run
from found import Found

from macrofit.scene import load_scene, scene_names

COARSER = 4.0
TRAVEL = 60.0  # mm, at most
INCREMENTS = 30  # at most


def coarse(name: str) -> list[str]:
    """Overrides that make a scene four times coarser, and its travel shorter."""
    scene = load_scene(name)
    overrides = [f"mesh.seat_facet={COARSER * scene.mesh.seat_facet}"]
    if scene.mesh.bore_facet is not None:
        overrides.append(f"mesh.bore_facet={COARSER * scene.mesh.bore_facet}")
    motion = scene.motion
    if motion.displacements is None and motion.travel > motion.start:
        travel = min(motion.travel, motion.start + TRAVEL)
        increment = max(motion.increment, (travel - motion.start) / INCREMENTS)
        overrides += [f"motion.travel={travel}", f"motion.increment={increment}"]
    return overrides


@pytest.mark.parametrize("gamma0", GAMMA0)
@pytest.mark.parametrize("scene", scene_names())
def test_every_increment_converges(scene: str, gamma0: float, found: Found) -> None:
    """No tolerance: an increment converges or it does not."""
    cases = [run(scene, friction, gamma0, coarse(scene)) for friction in FRICTION]
    troubled = [case for case in cases if case.trouble]
    assert found("every scene, friction 0 to 0.6, gamma0 1 to 1000: runs in trouble", len(troubled), 0), troubled
