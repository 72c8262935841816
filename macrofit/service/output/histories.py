"""Histories of a service computation: tractions, slips and stresses at all times of its last revolution."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ...results.folder import dataset, h5_file

if TYPE_CHECKING:
    from ..run import Service


def write_histories(target: Path, found: Service) -> None:
    """Write the moments of the last revolution, or what there is of the first, as HDF5.

    `traction` and `slip` have the axes (times, angles, 3, places): normal, along the seat, around it. `stress`
    (times, facets, 6) is that at the angle 0: nn, mm, tt, nm, nt, mt (n outward, m along, t around); it has no time
    before the first step, and is not there where no revolution is whole.

    Raises:
        OutputError: it cannot be written.
    """
    fit, line = found.whole.fit, found.whole.fit.lines[0]
    with h5_file(target) as file:
        file.attrs["title"] = found.whole.scene.title
        dataset(file, "time", np.array([each.time for each in found.moments]), "revolutions")
        dataset(file, "angle", 2.0 * np.pi * np.arange(len(found.moments[0].slip)) / len(found.moments[0].slip), "rad")
        dataset(file, "z", fit.z, "mm")
        dataset(file, "area", fit.weight, "mm2")
        dataset(file, "traction", np.stack([each.traction for each in found.moments]), "MPa")
        dataset(file, "slip", np.stack([each.slip for each in found.moments]), "mm")
        for name in ("traction", "slip"):
            file[name].attrs["axes"] = "time, angle, (normal, along the seat, around it), place"
        dataset(file, "facet_end", line.coordinate, "mm")
        if found.turned is not None:
            dataset(file, "friction", found.turned.friction, "1")
            dataset(file, "stress", found.turned.endurance.stress.transpose(1, 0, 2), "MPa")
            file["stress"].attrs["axes"] = (
                "time after the first, facet, (nn, mm, tt, nm, nt, mt) with n outward, m along the seat, t around it"
            )
