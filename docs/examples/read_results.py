"""Read the files of a run: the curve (CSV), the summary (JSON), the seat (HDF5) and the fields (VTU).

    macrofit run wheelset
    python read_results.py wheelset

Lengths are in mm, forces in N, stresses in MPa.
"""

from __future__ import annotations

import csv
import json
import sys
from pathlib import Path

import h5py
import meshio
import numpy as np


def main(folder: Path) -> None:
    """Print what each file says."""
    with (folder / "fitting_curve.csv").open() as file:
        rows = list(csv.DictReader(file))
    force = np.array([float(row["force_N"]) for row in rows])
    print(f"curve: {len(rows)} increments, largest force {force.max() / 1e3:.1f} kN")

    summary = json.loads((folder / "summary.json").read_text())
    for body, at in summary["max_von_mises_MPa"].items():
        print(f"summary: {at['value']:.0f} MPa in the {body} at r = {at['r_mm']:.1f} mm, z = {at['z_mm']:.1f} mm")

    with h5py.File(folder / "interface.h5") as file:
        length = file["facet_end"][:] - file["facet_start"][:]  # mm, of each facet
        last = file["pressure"][-1]  # MPa, at the last increment
        slipping = int(np.sum(file["status"][-1] == 2))
    mean = float(np.sum(last * length) / np.sum(length[last > 0.0]))
    print(f"seat: {mean:.1f} MPa in the mean, {slipping} facets slip")

    for place in sorted((folder / "fields").glob("*.vtu")):
        largest = meshio.read(place).point_data["von_mises"].max()
        print(f"{place.name}: {largest:.0f} MPa at most")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
