"""What is shown of a computation, and on which rank."""

from __future__ import annotations

import pytest

from macrofit.base.progress import RANKS, is_first_rank, printable, say


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
