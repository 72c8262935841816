"""The surface of the seat in space, for ParaView: what stands on it while the loads stand at the angle 0.

In the steady state all turns with the loads: what the place at the angle 0 sees as they turn stands around the axle at
one instant, at the angle theta what that place saw when they were at -theta. So there is a cell around the axle for
each step of a revolution, and nothing is interpolated. x points to where the wheel stands on the rail, z is the axle.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ...base.arrays import FloatArray
from ..seat_stress import MM, MT, TT, by_facet
from ..wheelset import Wheelset

if TYPE_CHECKING:
    from ..run import Turned


def surface_mesh(whole: Wheelset, turned: Turned) -> Any:
    """The surface as a mesh of quadrilaterals with values on them, units in their names."""
    import meshio

    values = surface_values(whole, turned)
    steps = len(turned.revolutions[-1].moments) - 1
    points, cells = _cylinder(whole, steps)
    data = {name: [value.ravel()] for name, value in values.items()}
    return meshio.Mesh(points, [("quad", cells)], cell_data=data)


def surface_values(whole: Wheelset, turned: Turned) -> dict[str, FloatArray]:
    """Values (steps, facets) at the angles 2 pi j / steps: those of an instant, and those of a whole revolution."""
    moments = turned.revolutions[-1].moments[:0:-1]  # the last one stands at the angle 0, that before at 2 pi / steps
    traction = np.stack([_of_facets(whole, each.traction[0]) for each in moments])
    slip = np.stack([_of_facets(whole, each.slip[0]) for each in moments])
    stress = turned.endurance.stress[:, ::-1].transpose(1, 0, 2)
    moving = slip[:, 1] - slip[:, 1].mean(axis=0)
    at_once = {
        "pressure_MPa": np.maximum(-traction[:, 0], 0.0),
        "shear_along_MPa": traction[:, 1],
        "shear_around_MPa": traction[:, 2],
        "slip_along_from_mean_mm": moving,
        "opening_mm": np.maximum(-slip[:, 0], 0.0),
        "axial_stress_MPa": stress[:, :, MM],
        "hoop_stress_MPa": stress[:, :, TT],
        "surface_shear_stress_MPa": stress[:, :, MT],
    }
    over_all = {name: np.broadcast_to(value, moving.shape) for name, value in _of_revolution(whole, turned).items()}
    return {name: np.ascontiguousarray(value) for name, value in (at_once | over_all).items()}


def _of_revolution(whole: Wheelset, turned: Turned) -> dict[str, FloatArray]:
    """What a revolution says of each facet (facets,), the same all around."""
    wear, found = turned.fretting, turned.endurance
    ranges = np.stack([wear.axial_range, wear.around_range, wear.work, turned.friction])
    along, around, work, friction = _of_facets(whole, ranges)
    return {
        "slip_range_along_mm": along,
        "slip_range_around_mm": around,
        "friction_work_N_per_mm": work,
        "friction": friction,
        "crossland": found.criteria.crossland,
        "dang_van": found.criteria.dang_van,
        "findley": found.criteria.findley,
        "swt_MPa": found.criteria.swt,
        "ruiz_MPa2_mm": found.ruiz,
    }


def _of_facets(whole: Wheelset, values: FloatArray) -> FloatArray:
    """Means over the facets (k, facets) of values at the moments (k, m); 0 outside the fit."""
    line = whole.fit.lines[0]
    return by_facet(line.facets, whole.fit.facet, values.T.astype(np.complex128)).real.T


def _cylinder(whole: Wheelset, steps: int) -> tuple[FloatArray, Any]:
    """Points (steps facets ends, 3) [mm] and cells (steps facets, 4); cells lie around the angles 2 pi j / steps."""
    line = whole.fit.lines[0]
    angle = 2.0 * np.pi * (np.arange(steps) - 0.5) / steps
    around = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    across = around[:, None] * line.radius[None, :, None]
    along = np.broadcast_to(line.coordinate, across.shape[:2])[..., None]
    points = np.concatenate([across, along], axis=2)
    number = np.arange(points[..., 0].size).reshape(steps, -1)
    after = np.roll(number, -1, axis=0)
    cells = np.stack([number[:, :-1], after[:, :-1], after[:, 1:], number[:, 1:]], axis=2)
    return points.reshape(-1, 3), cells.reshape(-1, 4)
