"""A wheelset in service is the same to the bit on any number of ranks, which share its harmonics."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from subprocess import CompletedProcess

import pytest
from mpi4py import MPI
from serving import SHORT

from macrofit.scene import load_scene
from macrofit.service import harmonics
from macrofit.service.run import carry_out_service

PROGRAM = """
import sys
from macrofit.cli import main
main(sys.argv[1:])
"""
Launched = Callable[..., CompletedProcess[str]]


def words(*more: str) -> list[str]:
    changes = (*SHORT, "service.harmonics=2", "service.revolutions=1", *more)
    return ["service", "wheelset", "--quiet", *(word for change in changes for word in ("--set", change))]


@pytest.mark.parametrize("ranks", [2, 3])
def test_same_steps_on_any_number_of_ranks(ranks: int, tmp_path: Path, mpirun: Launched) -> None:
    program, alone, together = tmp_path / "program.py", tmp_path / "alone", tmp_path / "together"
    program.write_text(PROGRAM)
    scene = load_scene("wheelset", [*SHORT, "service.harmonics=2", "service.revolutions=1"])
    carry_out_service(scene, MPI.COMM_SELF, alone, bonded=False, quiet=True)
    finished = mpirun(ranks, program, *words(), "-o", together, timeout=100.0)
    assert finished.returncode == 0, finished.stderr
    for name in ("rotation.bin", "fretting.csv", "seat.csv"):
        assert (alone / name).read_bytes() == (together / name).read_bytes()


def test_a_mistake_ends_all_ranks_in_one_line(tmp_path: Path, mpirun: Launched) -> None:
    program = tmp_path / "program.py"
    program.write_text(PROGRAM)
    finished = mpirun(2, program, *words("motion.start=-90", "motion.travel=-90"), "-o", tmp_path / "out",
                      timeout=100.0)  # fmt: skip
    assert finished.returncode == 2
    assert finished.stderr.count("macrofit: ") == 1
    assert "nothing presses the wheel" in finished.stderr


def test_a_body_that_is_taken_factors_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    from macrofit.assembly import discretise_bodies
    from macrofit.service.wheelset import in_harmonics, loads_of, service_keys

    scene = load_scene("wheelset", SHORT)
    bodies = discretise_bodies(scene, MPI.COMM_SELF)
    axle, wheel = (in_harmonics(bodies[name], name) for name in ("axle", "wheel"))
    loads = loads_of(service_keys(scene), axle, wheel, 0.0).of_axle(1)
    found = axle.condensed(1, loads)
    again = in_harmonics(bodies["axle"], "axle")
    again.take(1, found)
    monkeypatch.setattr(harmonics, "factor", None)
    assert (again.compliance(1) == axle.compliance(1)).all()
    assert (again.solve(1, loads.reshape(-1, 1)) == found.moved).all()
