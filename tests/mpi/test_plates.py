"""A friction test is not divided: under mpirun the first rank makes it, and the others leave at once."""

from __future__ import annotations

from pathlib import Path

from launcher import Mpirun

ROOT = Path(__file__).parents[2]
SMALL = ["--no-figures", "--set", "plates.spheres=900", "--set", "engine.increment=0.05"]


def test_one_rank_makes_a_friction_test(tmp_path: Path, mpirun: Mpirun) -> None:
    done = mpirun(2, "-m", "meso", "run", "-o", tmp_path / "run", *SMALL, cwd=ROOT)
    assert done.returncode == 0, done.stderr
    assert done.stdout.count("Files           ") == 1
    assert (tmp_path / "run" / "summary.json").exists()


def test_a_mistake_is_said_once(mpirun: Mpirun) -> None:
    done = mpirun(2, "-m", "meso", "run", "--set", "plates.spheers=3", cwd=ROOT)
    assert done.returncode == 2
    assert done.stderr.count("unknown key (did you mean 'spheres'?)") == 1
