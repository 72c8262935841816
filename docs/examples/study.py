"""A study from Python: how the final force depends on the coefficient of friction and on the interference.

    python study.py FOLDER

Bodies that several runs share are factored once. Under mpirun the runs are dealt to the ranks.
"""

from __future__ import annotations

import csv
import sys
from pathlib import Path

from mpi4py import MPI

from macrofit.study.plan import plan_study
from macrofit.study.run import carry_out_study


def main(folder: Path) -> None:
    """Run every combination, then print a line for each."""
    plan = plan_study(
        "wheelset",
        vary=["friction.options.coefficient=0.10,0.12", "wheel.bore_radius=94.85,94.80"],
        overrides=["motion.travel=60", "motion.increment=2", "preset=fast"],
    )
    carry_out_study(plan, MPI.COMM_WORLD, folder, resume=False, keep=False, quiet=True)
    if MPI.COMM_WORLD.rank == 0:
        with (folder / "study.csv").open() as file:
            for row in csv.DictReader(file):
                coefficient, bore = row["friction.options.coefficient"], float(row["wheel.bore_radius"])
                interference = 2.0 * (95.0 - bore)  # mm, on the diameter
                print(f"mu = {coefficient}, {interference:.2f} mm: {float(row['final_force_N']) / 1e3:.0f} kN")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
