"""The script of docs/python.md: the same alone and under mpirun."""

from mpi4py import MPI

from macrofit.scene import load_scene
from macrofit.solve import solve

solution = solve(load_scene("wheelset", ["motion.travel=40", "friction.options.coefficient=0.13"]))
if MPI.COMM_WORLD.rank == 0:
    for increment in solution.increments[-3:]:
        print(f"{increment.displacement:5.1f} mm {increment.force / 1e3:8.1f} kN")
    print(solution.max_von_mises["axle"])
