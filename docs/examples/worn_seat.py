"""Prototype: a seat that wears where it slips, its roughness with it, and the profile that is left pressed anew.

    python worn_seat.py [FOLDER]

Archard's law in jumps over revolutions (`macrofit.service.wear`). What is left out stands there: take it for a trend.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from macrofit.scene import load_scene
from macrofit.service.journal import Kept
from macrofit.service.run import Course, serve
from macrofit.service.wear import Smoothing, wear_away, write_worn_profile

SCENE = (
    "mesh.seat_facet=6", "mesh.coarse=40", "motion.start=90", "motion.increment=30", "wheel.bore_radius=94.85",
    "friction.options.coefficient=0.2", "service.steps=14", "service.revolutions=1",
)  # fmt: skip
COEFFICIENT = 1e-8  # of wear, steel on steel in fretting [1/MPa]
JUMPS = (1e4, 3e4, 6e4, 1.0)  # revolutions; the last one shows what is left
ROUGHNESS = Smoothing(flat_coefficient=0.15, work=2e5)  # as the options of the provider `evolving` [N/mm]


def main(folder: Path) -> None:
    """Wear the seat of a small wheelset, write its profile, press a wheel on it and let it turn."""
    course = Course(load_scene("wheelset", SCENE), lambda _: None, Kept())
    new = course.carry_out()
    rotation = course.rotation
    assert rotation is not None
    fit = rotation.kernel.fit
    turned = 0.0
    for worn in wear_away(rotation, new.moments[-1], JUMPS, COEFFICIENT, ROUGHNESS):
        deepest = int(np.argmax(worn.depth))
        print(
            f"{turned:9.0f} revolutions: friction work {1e-3 * worn.last.friction_work:.2f} J; "
            f"then up to {1e3 * worn.depth[deepest]:.3f} um lost at z = {fit.z[deepest]:.1f} mm, "
            f"friction from {worn.friction.min():.3f} up"
        )
        turned = worn.revolutions
    folder.mkdir(parents=True, exist_ok=True)
    write_worn_profile(folder / "worn.csv", fit, worn.depth, share=1.0)
    again = serve(load_scene("wheelset", [*SCENE, f"axle.profile={folder / 'worn.csv'}"]))
    assert again.turned is not None
    work = again.turned.revolutions[-1].friction_work
    print(f"a wheel pressed onto the worn seat: friction work {1e-3 * work:.2f} J")


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "worn"))
