"""What every command does where its streams are closed or full, and when it is ended while Python cleans up."""

from __future__ import annotations

import signal
import subprocess
import sys
from pathlib import Path

import click
import pytest
from click.testing import CliRunner

from macrofit.base.errors import OutputError
from macrofit.base.progress import say
from macrofit.cli import main as macrofit
from meso.cli import main as meso
from surrogate.cli import main as surrogate

COMMAND = """
import atexit, time
import click
from macrofit.base.commands import Commands

@click.group("macrofit", cls=Commands)
def main():
    atexit.register(clean_up)  # as petsc4py and mpi4py do when they are imported

def clean_up():
    print("cleaning", flush=True)
    time.sleep(30)

@main.command()
def run():
    pass

main(["run"])
"""


def shell(line: str, folder: Path) -> subprocess.CompletedProcess[str]:
    words = f"{sys.executable} -m macrofit run contact-patch -o {folder / 'run'} {line}"
    return subprocess.run(["bash", "-c", words], stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=100)


@pytest.mark.parametrize(
    ("program", "typed", "remedy"),
    [
        (macrofit, "rnu", "did you mean 'run'?"),
        (macrofit, "judg", "did you mean 'judge'?"),
        (macrofit, "zzz", "commands: check, converge, "),
        (meso, "sufrace", "did you mean 'surface'?"),
        (surrogate, "tarin", "did you mean 'train'?"),
    ],
)
def test_a_mistyped_command_is_told_what_was_meant(program: click.Group, typed: str, remedy: str) -> None:
    shown = CliRunner(mix_stderr=False).invoke(program, [typed])
    assert shown.exit_code == 2
    assert f"No such command '{typed}' ({remedy}" in shown.stderr


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("--foo", "macrofit: No such option: --foo (see macrofit --help)"),
        ("run", "macrofit: Missing argument 'SCENE' (see macrofit run --help)"),
        ("run wheelset --fo", "macrofit: No such option: --fo (see macrofit run --help)"),
        ("judge a.csv --diameter 180,25", "'180,25' has a decimal comma; write 180.25 (see macrofit judge --help)"),
        ("judge a.csv --diameter wide", "'wide' is not a valid number (see macrofit judge --help)"),
        ("judge a.csv --length 0", "0.0 is not in the range x>0.0 (see macrofit judge --help)"),
        ("run wheelset --set mesh.order=0,5", "write 0.5 with a decimal point, or a list as [0,5]"),
    ],
)
def test_a_mistake_in_the_line_is_one_line(words: str, said: str) -> None:
    shown = CliRunner(mix_stderr=False).invoke(macrofit, words.split())
    assert shown.exit_code == 2
    assert len(shown.stderr.splitlines()) == 1
    assert said in shown.stderr


@pytest.mark.parametrize(
    ("typed", "remedy"),
    [
        ("wheelst", "did you mean 'wheelset'?"),
        ("lame-ring", "did you mean 'lame-rings'?"),
        ("my-weel.toml", "did you mean 'my-wheel.toml'?"),
        ("drawings/hbu.toml", "did you mean 'drawings/hub.toml'?"),
        ("zzz", "which are: contact-patch, hertz-sphere, "),
        ("none/zzz.toml", "which are: contact-patch, "),
    ],
)
def test_a_mistyped_scene_is_told_what_was_meant(
    typed: str, remedy: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A built-in scene or a file beside where it was looked for."""
    monkeypatch.chdir(tmp_path)
    Path("drawings").mkdir()
    for path in ("my-wheel.toml", "drawings/hub.toml"):
        Path(path).touch()
    shown = CliRunner(mix_stderr=False).invoke(macrofit, ["check", typed])
    assert (shown.exit_code, shown.stderr.count("\n")) == (2, 1)
    assert shown.stderr.startswith(f"macrofit: no scene '{typed}': ")
    assert remedy in shown.stderr


@pytest.mark.parametrize("closed", [">&-", "<&- >&- 2>&-"])
def test_closed_streams_change_nothing(closed: str, tmp_path: Path) -> None:
    """Neither do lines for people get into the first file that is opened, which has the stream's number."""
    done = shell(closed, tmp_path)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
    assert (tmp_path / "run" / "summary.json").is_file()
    assert (tmp_path / "run" / "journal.bin").read_bytes().startswith(b"macrofit journal\n")
    assert "contact-patch" not in (tmp_path / "run" / "fitting_curve.csv").read_text()


def test_a_full_disk_behind_standard_output_is_one_line(tmp_path: Path) -> None:
    done = shell(">/dev/full", tmp_path)
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert "standard output: cannot be written: No space left on device" in done.stderr


def test_the_last_words_are_one_line_too() -> None:
    """What a command prints by itself, without `say`."""
    words = f"{sys.executable} -m macrofit scenes >/dev/full"
    done = subprocess.run(["bash", "-c", words], stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stderr.count("\n")) == (2, 1)
    assert "make room" in done.stderr


def test_saying_what_cannot_be_written_is_an_error_of_output() -> None:
    with Path("/dev/full").open("w") as full, pytest.raises(OutputError, match="standard output: cannot be written"):
        say("words", full)


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_signal_while_python_cleans_up_ends_it_without_a_word(number: int) -> None:
    with subprocess.Popen([sys.executable, "-c", COMMAND], stdout=subprocess.PIPE, stderr=subprocess.PIPE) as run:
        assert run.stdout is not None
        assert run.stderr is not None
        assert run.stdout.readline() == b"cleaning\n"
        run.send_signal(number)
        assert run.wait(timeout=10) == -number
        assert run.stderr.read() == b""


@pytest.mark.parametrize("how", ["raise ImportError('initialization failed') from error", "raise ImportError('odd')"])
def test_an_interruption_that_a_library_hides_is_one(how: str) -> None:
    """dolfinx, interrupted while it is loaded, says ImportError."""
    code = COMMAND.replace(
        "    pass\n", f"    try: raise KeyboardInterrupt\n    except KeyboardInterrupt as error: {how}\n"
    )
    code = code.replace("time.sleep(30)", "")
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stderr) == (130, "macrofit: interrupted\n")


def test_an_interruption_that_a_command_has_told_is_told_once() -> None:
    told = "try: raise KeyboardInterrupt\n    except KeyboardInterrupt: click.echo('told', err=True); sys.exit(130)\n"
    for end in ("sys.exit(130)", "click.get_current_context().exit(130)"):
        code = "import sys" + COMMAND.replace("    pass\n", f"    {told.replace('sys.exit(130)', end)}")
        code = code.replace("time.sleep(30)", "")
        done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
        assert (done.returncode, done.stderr) == (130, "told\n")
