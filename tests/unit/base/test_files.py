"""Files that are whole at any moment, and the folder of caches."""

from __future__ import annotations

import os
import resource
from pathlib import Path

import pytest

from macrofit.base.errors import OutputError
from macrofit.base.files import (
    alone_in,
    cache_folder,
    check_regular,
    read_regular,
    remove_drafts,
    replacing,
    write_text,
)


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


def odd_files(folder: Path) -> dict[str, Path]:
    """Names that no reader should wait for or fill the memory from, by what should be said of them."""
    odd = {
        what: folder / what.replace(" ", "-")
        for what in ("is a pipe", "is a folder", "Too many levels", "is larger than 1 GB")
    }
    os.mkfifo(odd["is a pipe"])
    odd["is a folder"].mkdir()
    odd["Too many levels"].symlink_to(odd["Too many levels"])
    with odd["is larger than 1 GB"].open("wb") as sparse:
        sparse.truncate(10 * 10**9)
    odd["is a device"] = Path("/dev/zero")
    odd["No such file"] = folder / "none"
    odd["File name too long"] = folder / ("x" * 300)
    return odd


def test_only_regular_files_of_bounded_size_are_read(tmp_path: Path) -> None:
    for told, path in odd_files(tmp_path).items():
        for opened in (check_regular, read_regular):
            with pytest.raises(OutputError, match=told) as caught:
                opened(path, 10**9)
            assert "\n" not in str(caught.value)
    plain = tmp_path / "plain"
    plain.write_bytes(b"12345")
    assert read_regular(plain, 5) == b"12345"
    assert check_regular(plain, 5) == 5
    with pytest.raises(OutputError, match=r"is larger than 4 bytes, the most for a file of its kind \(5 bytes\)"):
        read_regular(plain, 4)


def test_a_file_of_no_stated_size_is_not_read_without_end(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Files of the system's memory state a size of 0 and go on for longer."""
    plain = Path("/proc/self/status")
    assert plain.stat().st_size == 0
    assert read_regular(plain, 100_000)
    with pytest.raises(OutputError, match=r"is larger than 10 bytes, the most for a file of its kind \(more\)"):
        read_regular(plain, 10)


def test_a_bound_takes_no_memory(tmp_path: Path) -> None:
    """A journal may have 20 GB, and that much was asked for to read one of a few bytes."""
    (tmp_path / "small").write_bytes(b"12345")
    before = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, (2 * 10**10, before[1]))
    try:
        assert read_regular(tmp_path / "small", 2 * 10**12) == b"12345"
    finally:
        resource.setrlimit(resource.RLIMIT_AS, before)


def test_drafts_of_a_killed_process_are_removed_and_nothing_else(tmp_path: Path) -> None:
    with replacing(tmp_path / "axle_0000.vtu") as draft:
        left = tmp_path / draft.name
        kept = [tmp_path / name for name in (".hidden", ".notes.csv", "summary.json", ".a.b.json")]
        for path in kept:
            path.write_text("mine")
        remove_drafts(tmp_path, tmp_path / "nothing")
        assert not left.exists()
        draft.write_text("")
    assert all(path.exists() for path in kept)
