"""Files that are whole at any moment, and the folder of caches."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from macrofit.base.errors import OutputError
from macrofit.base.files import alone_in, cache_folder, replacing, write_text


def test_a_file_is_replaced_whole_or_not_at_all(tmp_path: Path) -> None:
    path = tmp_path / "new" / "a.txt"
    write_text(path, "first")
    plain = path.with_name("b.txt")
    plain.touch()
    assert path.stat().st_mode == plain.stat().st_mode
    plain.unlink()

    def interrupted() -> None:
        with replacing(path) as draft:
            draft.write_text("sec")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert path.read_text() == "first"
    assert os.listdir(path.parent) == ["a.txt"]


def test_two_writers_at_once_each_have_a_draft_of_their_own(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    with replacing(path) as one, replacing(path) as other:
        one.write_text("one")
        other.write_text("other")
    assert path.read_text() == "one"


def test_what_cannot_be_written_names_the_file_and_a_remedy(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match=r"file/a\.txt: cannot be written: .* \(choose another place with -o\)"):
        write_text(tmp_path / "file" / "a.txt", "")


@pytest.mark.parametrize(
    ("own", "base", "folder"),
    [("/own", "/base", "/own"), (None, "/base", "/base/macrofit"), (None, None, "/home/me/.cache/macrofit")],
)
def test_folder_of_caches(own: str | None, base: str | None, folder: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HOME", "/home/me")
    for name, value in (("MACROFIT_CACHE", own), ("XDG_CACHE_HOME", base)):
        if value is None:
            monkeypatch.delenv(name, raising=False)
        else:
            monkeypatch.setenv(name, value)
    assert cache_folder() == Path(folder)


def test_a_folder_is_for_one_process_at_a_time(tmp_path: Path) -> None:
    taken = pytest.raises(OutputError, match="run: another process is writing into it")
    with alone_in(tmp_path / "run"), taken, alone_in(tmp_path / "run"):
        pass
    with alone_in(tmp_path / "run"):
        pass
