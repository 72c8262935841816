"""Two single spheres on springs slide over each other: both engines against the equilibrium solved independently."""

from __future__ import annotations

import numpy as np
import pytest
from found import Found
from scipy.optimize import root

from meso.engines.explicit import Explicit
from meso.engines.quasistatic import QuasiStatic
from meso.lattice.lattice import Lattice
from meso.packing.pack import Packing
from meso.plates import Plates
from meso.settings import Settings, load
from meso.surfaces.surface import Surface

R, ALONG, ACROSS = 0.05, 20e3, 30e3  # mm, N/mm, N/mm
MIDDLE, DEPTH = 0.5, 0.004  # the spheres stand above each other at this slide, overlapping by this [mm]


def sphere(x: float, z: float) -> Lattice:
    """One sphere held by springs along z and across, free to turn against a weak spring."""
    return Lattice(
        centres=np.array([[x, 0.0, z]]),
        radii=np.array([R]),
        masses=np.array([4e-12]),
        rows=np.array([0, 0]),
        cols=np.empty(0, dtype=np.int64),
        beams=np.empty((0, 6)),
        anchored=np.array([0]),
        anchors=np.array([[ALONG, ACROSS, 0.0, 5.0, 5.0]]),
        twist=0.0,
    )


def spheres(settings: Settings) -> Plates:
    """Wheel sphere above, axle sphere MIDDLE farther along; the interference is counted from their first touch."""
    nothing = Packing(np.zeros((1, 3)), np.array([R]), Surface.flat((1.0, 1.0)), 1.0)
    plates = Plates(
        settings=settings,
        wheel_packing=nothing,
        axle_packing=nothing,
        beams=None,
        wheel=sphere(0.0, 2.0 * R),
        axle=sphere(MIDDLE, 0.0),
    )  # type: ignore[arg-type]
    object.__setattr__(plates, "first_touch", 0.0)
    return plates


def forces(slide: float, micro_friction: float) -> tuple[float, float]:
    """N and T of the sliding pair [N], from force balance in the plane: a root of five unknowns by scipy."""
    normal_stiffness = 206e3 * R

    def residual(unknown: np.ndarray) -> np.ndarray:
        uw, ua, fn = unknown[:2], unknown[2:4], unknown[4]
        between = np.array([MIDDLE - slide, DEPTH - 2.0 * R]) + ua - uw
        distance = np.hypot(*between)
        n = between / distance
        t = np.array([n[1], -n[0]])  # n points down, so this one points against the slide
        force = -fn * n + micro_friction * fn * t
        spring = np.array([ACROSS, ALONG])
        scale = 1e-3
        return np.array(
            [*(spring * uw - force) * scale, *(spring * ua + force) * scale,
             fn * scale - normal_stiffness * scale * (2.0 * R - distance)]
        )  # fmt: skip

    solved = root(residual, np.array([0.0, 1e-4, 0.0, -1e-4, 10.0]), tol=1e-13)
    assert np.abs(residual(solved.x)).max() < 1e-12  # N and mm over 1000
    uw, fn = solved.x[:2], solved.x[4]
    if fn <= 0.0:
        return 0.0, 0.0
    return ALONG * uw[1], -ACROSS * uw[0]


SETTINGS = [f"load.interference={DEPTH}", "engine.increment=0.0005", "engine.tolerance=1e-9"]


@pytest.mark.parametrize("micro_friction", [0.0, 0.07, 0.4])
def test_quasi_static_forces_are_those_of_the_equilibrium(micro_friction: float, found: Found) -> None:
    curve = QuasiStatic(spheres(load(None, SETTINGS))).slide(micro_friction).curve
    touching = np.flatnonzero(curve.normal > 0.0)
    assert len(touching) > 50
    rows = touching[3:-1:7]  # after the first increments the contact slides all the way
    exact = np.array([forces(float(curve.displacement[k]), micro_friction) for k in rows])
    error = np.abs(np.stack([curve.normal[rows], curve.tangential[rows]], axis=1) - exact)
    # tolerance: that of the increments, 1e-9 of the force
    what = "two spheres against their equilibrium: forces, quasi-static"
    assert found(what, (error / np.maximum(np.abs(exact), 1.0)).max(), 1e-7)


def test_frictionless_slide_does_no_work() -> None:
    curve = QuasiStatic(spheres(load(None, SETTINGS))).slide(0.0).curve
    # apart at the start and at the end: nothing is stored, nothing lost
    assert abs(curve.tangential_work) < 1e-12
    assert np.abs(curve.tangential).max() > 1.0


def test_work_converges_with_the_square_of_the_increment(found: Found) -> None:
    def work(increment: float) -> float:
        overrides = [*SETTINGS, f"engine.increment={increment}", "load.slide=1.0"]
        return QuasiStatic(spheres(load(None, overrides))).slide(0.1).curve.tangential_work

    fine = work(1e-4)
    # the increments fall differently on the touch each time: compare means over nearby sizes
    coarse = np.mean([abs(work(h) - fine) for h in (7.6e-3, 8e-3, 8.4e-3)])
    middle = np.mean([abs(work(h) - fine) for h in (1.9e-3, 2e-3, 2.1e-3)])
    rate = np.log(coarse / middle) / np.log(4.0)
    assert found("two spheres: rate at which the error of the work falls", rate, 1.6, at_least=True)


def test_explicit_forces_approach_those_of_the_equilibrium(found: Found) -> None:
    errors = []
    for speed in (2000.0, 500.0):
        settings = load(
            None, [f"load.interference={DEPTH}", f"engine.speed={speed}", "engine.samples=2000",
                   "engine.safety=0.4", "engine.damping_length=0.001"],
        )  # fmt: skip
        curve = Explicit(spheres(settings)).slide(0.07).curve
        middle = curve.displacement - 0.5 * np.diff(curve.displacement, prepend=0.0)
        rows = np.flatnonzero(curve.normal > 1.0)[20:-20:10]
        exact = np.array([forces(float(middle[k]), 0.07) for k in rows])
        seen = np.stack([curve.normal[rows], curve.tangential[rows]], axis=1)
        errors.append(np.abs(seen - exact).max() / exact.max())
    assert found("two spheres: forces, explicit at 500 mm/s", errors[1], 0.01)
    assert found("two spheres: that error over the one at 2000 mm/s", errors[1] / errors[0], 0.7)
