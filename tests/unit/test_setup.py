"""The set-up on a machine that lacks something: one line that ends in the remedy. The system's commands are played."""

from __future__ import annotations

import os
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
BOOKWORM = 'ID=debian\nVERSION_ID="12"\n'
TRIXIE = 'ID=debian\nVERSION_ID="13"\n'
UBUNTU = 'ID=ubuntu\nVERSION_ID="26.04"\n'

Make = Callable[..., subprocess.CompletedProcess[str]]


@pytest.fixture
def make(tmp_path: Path) -> Make:
    """`make(release, target, **commands)` in a path with a space: the commands are shell scripts, ahead of others."""
    tree, played = tmp_path / "a tree", tmp_path / "played"
    tree.mkdir()
    played.mkdir()
    for name in ("Makefile", "pyproject.toml", "constraints.txt"):
        shutil.copy(ROOT / name, tree)
    (played / "dpkg-query").write_text("#!/bin/sh\nexit 1\n")  # nothing is installed

    def run(release: str, *arguments: str, **commands: str) -> subprocess.CompletedProcess[str]:
        for name, script in commands.items():
            (played / name.replace("_", "-")).write_text(f"#!/bin/sh\n{script}\n")
        for command in played.iterdir():
            command.chmod(0o755)
        (tmp_path / "release").write_text(release)
        environment = {name: value for name, value in os.environ.items() if not name.startswith(("MAKE", "MFLAGS"))}
        environment["PATH"] = f"{played}:{environment['PATH']}"
        return subprocess.run(
            ["make", f"OS_RELEASE={tmp_path / 'release'}", f"PYTHON={played / 'python3'}", *arguments],
            cwd=tree, env=environment, stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=60,
        )  # fmt: skip

    return run


def only_line(done: subprocess.CompletedProcess[str]) -> str:
    """What a set-up that failed has said, without make's own last line."""
    assert done.returncode != 0
    line, last = done.stderr.splitlines()
    assert last.startswith("make: ***")
    return line


@pytest.mark.parametrize(
    ("release", "named", "not_named"),
    [
        (BOOKWORM, ["libcholmod3"], ["libcholmod5", "python3-torch", "python3-h5py "]),
        (TRIXIE, ["libcholmod5", "python3-torch", "python3-safetensors", "python3-h5py "], ["libcholmod3"]),
    ],
)
def test_without_sudo_the_line_to_type_is_said(
    make: Make, release: str, named: list[str], not_named: list[str]
) -> None:
    line = only_line(make(release, "system-torch", id="echo 1000", sudo="exit 1"))
    _, _, command = line.partition("apt-get update && apt-get install -y --no-install-recommends ")
    assert "python3-dolfinx-real" in command
    assert all(name in f"{command} " for name in named)
    assert not any(name in f"{command} " for name in not_named)


def test_a_set_up_without_torch_asks_for_none(make: Make) -> None:
    assert "torch" not in only_line(make(TRIXIE, "system", id="echo 1000", sudo="exit 1"))


APT = """case "$*" in
  *assume-no*) echo "Need to get 548 MB of archives." ;;
  *"install -y"*) {install} ;;
esac"""


def test_what_will_be_loaded_is_said_first_and_apt_is_silent(make: Make) -> None:
    done = make(BOOKWORM, "system", id="echo 0", apt_get=APT.format(install="echo Unpacking; echo notice >&2"))
    assert done.returncode == 0
    assert done.stdout == "Installing Debian packages: 548 MB to load, about 3 min\n"
    assert done.stderr == ""


@pytest.mark.parametrize(
    ("said", "remedy"),
    [
        ("E: Failed to fetch http://a/b.deb  Temporary failure resolving 'a'", "network"),
        ("E: Unable to locate package python3-dolfinx-real", "network"),
        ("E: You don't have enough free space in /var/cache/apt/archives/.", "free 5 GB"),
        ("E: Could not get lock /var/lib/dpkg/lock-frontend. It is held by process 7 (apt)", "wait for its end"),
        ("W: a\nE: Unmet dependencies. Try 'apt --fix-broken install'\nE: b", "Try 'apt --fix-broken install' E: b"),
    ],
)
def test_apt_that_fails_ends_in_one_line(make: Make, said: str, remedy: str) -> None:
    line = only_line(make(BOOKWORM, "system", id="echo 0", apt_get=APT.format(install=f'echo "{said}" >&2; exit 100')))
    assert line.startswith("Debian packages: ")
    assert remedy in line


@pytest.mark.parametrize(
    ("said", "remedy"),
    [
        ("OSError: [Errno 28] No space left on device", "free 5 GB"),
        ("WARNING: Retrying after '<x>: Failed to establish a new connection: [Errno -3]'\nERROR: No match", "network"),
        ("Traceback\n  line\nERROR: requires a different Python: 3.10 not in '>=3.11'", "3.10 not in '>=3.11'"),
    ],
)
def test_an_environment_that_fails_ends_in_one_line(make: Make, said: str, remedy: str) -> None:
    present = "printf 'ii  %s\\n' $(echo \"$@\")"  # dpkg has whatever it is asked for
    line = only_line(make(BOOKWORM, "setup", dpkg_query=present, python3=f'echo "{said}" >&2; exit 1'))
    assert line.startswith("The Python environment .venv: ")
    assert remedy in line


def test_another_release_is_told_what_is_missing(make: Make) -> None:
    line = only_line(make(UBUNTU, "system", python3="echo dolfinx gmsh"))
    assert line.startswith("ubuntu-26.04 is untried")
    assert "lacks dolfinx gmsh: take Debian 12 or 13" in line
    assert "lacks everything" in only_line(make("", "system", python3="exit 1"))


def test_another_release_that_has_everything_goes_on(make: Make) -> None:
    done = make(UBUNTU, "system", python3="echo")
    assert done.returncode == 0
    assert done.stderr.startswith("ubuntu-26.04 is untried")
    assert done.stderr.count("\n") == 1


@pytest.mark.parametrize(
    ("played", "remedy"),
    [
        ({"id": "echo 1000"}, "only root can make a system: type sudo tests/fresh"),
        ({"unshare": "exit 1"}, "no mounts of its own are allowed here: try a machine that is no container"),
        ({"df": "echo Avail; echo 7000000"}, "/var/tmp has less than 8 GB free: set TMPDIR to a folder with more"),
    ],
)
def test_a_machine_that_cannot_make_an_empty_system_says_why(
    tmp_path: Path, played: dict[str, str], remedy: str
) -> None:
    for name, script in ({"id": "echo 0", "unshare": "", "df": "exit 1", "debootstrap": "exit 1"} | played).items():
        (tmp_path / name).write_text(f"#!/bin/sh\n{script}\n")
        (tmp_path / name).chmod(0o755)
    environment = {name: value for name, value in os.environ.items() if name != "TMPDIR"}
    done = subprocess.run(
        [ROOT / "tests" / "fresh"], env=environment | {"PATH": f"{tmp_path}:{os.environ['PATH']}"},
        stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=60,
    )  # fmt: skip
    assert done.returncode == 77
    assert done.stderr == f"tests/fresh: {remedy}\n"
