"""What a terminal shows of a run: a first line before anything is loaded, one bar, and ^C that does not double it."""

from __future__ import annotations

from pathlib import Path

import pytest
from terminal import Terminal, shown
from unit.test_imports import HEAVY, loaded_by

EARLY = """
from {module}.cli import main
from macrofit.base import progress
def stop(text, stream=None):
    print(text)
    raise KeyboardInterrupt
progress.say = stop
try:
    main({words!r})
except SystemExit:
    pass
"""


SLIPPERY = "friction.options.coefficient=9"  # found out when the bodies are ready


def test_a_screen_wraps_overwrites_and_erases() -> None:
    assert shown("abcde\r\x1b[2Kxy\r\nz", 4) == ["abcd", "xy", "z"]
    assert shown("abc\rX\x1b[K\n\r\x1b[1Ay", 9) == ["y", ""]
    assert shown("\x1b[31mred\x1b[0m", 9) == ["red"]


@pytest.mark.usefixtures("ctrl_c")
def test_ctrl_c_leaves_one_bar_and_the_terminal_as_it_was(tmp_path: Path) -> None:
    terminal = Terminal("macrofit", "run", "wheelset", "-o", str(tmp_path / "run"))
    terminal.wait_for(" mm ")
    assert not terminal.echoes_control()
    terminal.press("\x03")
    assert terminal.ended() == 130
    first, bar, *last = terminal.lines()
    assert first == "Scene           wheelset; loading the solver"
    assert "dofs" in bar
    assert "/181" in bar
    assert "".join(last).startswith("macrofit: interrupted; what was computed is in ")


def test_a_mistake_on_the_way_takes_the_bar_away(tmp_path: Path) -> None:
    """The bar is there while the bodies are made; a body that cannot be made ends it."""
    terminal = Terminal("macrofit", "run", "wheelset", "-o", str(tmp_path / "run"), "--set", SLIPPERY)
    terminal.wait_for("meshing and factoring")
    assert terminal.ended() == 2
    assert "coefficient" in terminal.lines()[-1]
    assert not [line for line in terminal.lines() if "181" in line]


@pytest.mark.parametrize(("module", "words"), [
    ("macrofit", ["run", "wheelset"]),
    ("macrofit", ["study", "wheelset", "--vary", "motion.increment=1"]),
    ("macrofit", ["identify", "wheelset", "--curve", "none.csv"]),
    ("macrofit", ["converge", "wheelset"]),
    ("macrofit", ["service", "wheelset"]),
    ("meso", ["run"]),
    ("meso", ["sample"]),
    ("meso", ["calibrate"]),
    ("surrogate", ["generate", "-o", "a.h5", "--pairs", "1"]),
    ("surrogate", ["train", "a.h5", "-o", "a.safetensors"]),
    ("surrogate", ["evaluate"]),
    ("surrogate", ["predict"]),
])  # fmt: skip
def test_the_first_line_comes_before_anything_heavy(module: str, words: list[str]) -> None:
    """Interrupted at its first line, a command has loaded neither arrays nor libraries."""
    run = EARLY.format(module=module, words=words).strip().replace("\n", "\n    ")
    assert not loaded_by(run) & (HEAVY | {"numpy"})
