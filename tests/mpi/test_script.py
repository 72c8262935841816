"""The script of the README runs alone and under mpirun, and prints the same."""

from __future__ import annotations

import subprocess
import sys
import tomllib
from pathlib import Path

from conftest import Mpirun

from macrofit.scene import build_scene

SCRIPT = Path(__file__).with_name("press.py")
README = (Path(__file__).parents[2] / "README.md").read_text()


def block(language: str) -> str:
    """The first code block of a language in the README."""
    return README.split(f"```{language}\n")[1].split("```")[0]


def test_readme_shows_the_script() -> None:
    assert block("python").strip() == SCRIPT.read_text().split('"""\n', 1)[1].strip()


def test_readme_scene_is_a_scene() -> None:
    scene = build_scene(tomllib.loads(block("toml")))
    assert len(scene.displacements) == 111


def test_script_alone_and_on_two_ranks(mpirun: Mpirun) -> None:
    alone = subprocess.run(
        [sys.executable, SCRIPT], stdin=subprocess.DEVNULL, capture_output=True, text=True, check=True, timeout=100
    )
    together = mpirun(2, SCRIPT, timeout=100.0)
    assert together.returncode == 0, together.stderr
    assert together.stdout == alone.stdout
    assert alone.stdout.splitlines()[2].startswith(" 40.0 mm")
