"""What is shown of a computation, and on which rank."""

from __future__ import annotations

import os
import sys
import termios

import pytest

from macrofit.base.progress import RANKS, ControlEcho, is_first_rank, printable, say


@pytest.mark.parametrize(
    ("text", "shown"),
    [("µ = 0.11 ± 0.01", "µ = 0.11 ± 0.01"), ("a\x1b[31mb\n\x00", "a\\x1b[31mb\\n\\x00"), ("", "")],
)
def test_characters_of_control_are_shown(text: str, shown: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert printable(text) == shown
    say(text)
    assert capsys.readouterr().out == shown + "\n"


@pytest.mark.parametrize("name", RANKS)
def test_the_launcher_tells_the_rank(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    for other in RANKS:
        monkeypatch.delenv(other, raising=False)
    assert is_first_rank()
    for rank, first in (("0", True), ("1", False), ("12", False)):
        monkeypatch.setenv(name, rank)
        assert is_first_rank() == first


@pytest.mark.parametrize("meanwhile", [False, True])
def test_a_terminal_shows_control_characters_again(meanwhile: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """Also where somebody else had turned them on meanwhile: the shell does, while a run is suspended."""
    leader, terminal = os.openpty()
    monkeypatch.setattr(os, "tcgetpgrp", lambda _: os.getpgrp())
    echo = ControlEcho()
    with os.fdopen(terminal, "w") as shown:
        as_before = termios.tcgetattr(terminal)
        assert as_before[3] & termios.ECHOCTL
        monkeypatch.setattr(sys, "stdout", shown)
        echo.hide()
        assert not termios.tcgetattr(terminal)[3] & termios.ECHOCTL
        if meanwhile:
            termios.tcsetattr(terminal, termios.TCSANOW, as_before)
        echo.show()
        assert termios.tcgetattr(terminal) == as_before
    os.close(leader)


def test_the_terminal_of_another_job_is_left_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    leader, terminal = os.openpty()
    monkeypatch.setattr(os, "tcgetpgrp", lambda _: os.getpgrp() + 1)
    with os.fdopen(terminal, "w") as shown:
        as_before = termios.tcgetattr(terminal)
        monkeypatch.setattr(sys, "stdout", shown)
        echo = ControlEcho()
        echo.hide()
        assert termios.tcgetattr(terminal) == as_before
        echo.show()
        assert termios.tcgetattr(terminal) == as_before
    os.close(leader)
