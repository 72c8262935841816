"""What the three commands share: one voice for mistakes, one way to end, few threads."""

from __future__ import annotations

import atexit
import gc
import os
import signal
import sys
import traceback
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from .errors import MacrofitError, nearest
from .files import FULL
from .progress import swallow

if TYPE_CHECKING:
    from .completion import Complete

BUG, USER_MISTAKE, INTERRUPTED = 1, 2, 130
"""Exit codes of every command."""
SETTINGS = {"help_option_names": ["-h", "--help"]}
"""Settings of the context of every command."""
FILE = click.Path(path_type=Path)
YOUNG = 200_000
"""New objects after which Python looks for unreachable ones; after its 700, imports and figures make it look at all."""
THREADS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "NUMBA_NUM_THREADS")
"""Variables that numpy, PETSc and numba read when they are first imported."""


class Positive(click.FloatRange):
    """A number above 0 on the command line."""

    name = "number"

    def __init__(self) -> None:
        super().__init__(min=0.0, min_open=True)

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """The number of a text.

        Raises:
            click.BadParameter: it is none, or not above 0.
        """
        if isinstance(value, str) and value.count(",") == 1 and "." not in value:
            self.fail(f"{value!r} has a decimal comma; write {value.replace(',', '.')}", param, ctx)
        return super().convert(value, param, ctx)


class Commands(click.Group):
    """A group that says an error the user can mend on one line and exits with 2; an interruption with 130."""

    def main(self, *given: Any, **named: Any) -> Any:
        """Run as a program, or answer a shell that completes a line."""
        if f"_{self.name}_complete".replace("-", "_").upper() in os.environ:
            from .completion import register

            register()
        return super().main(*given, **named)

    def make_context(self, *given: Any, **named: Any) -> click.Context:
        """The context of a line, whose own options are read here; of a mistake in them one line."""
        try:
            return super().make_context(*given, **named)
        except click.UsageError as error:
            raise _on_one_line(error) from None

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """The command that was asked for; of one that is not there, what was perhaps meant."""
        word = args[0]
        if not (word.startswith("-") or ctx.resilient_parsing or self.get_command(ctx, word)):
            ctx.fail(f"No such command '{word}' ({nearest(word, self.list_commands(ctx), 'commands')}).")
        return super().resolve_command(ctx, args)

    def invoke(self, ctx: click.Context) -> Any:
        """Run the command that was asked for."""
        gc.set_threshold(YOUNG)
        atexit.register(gc.freeze)  # or everything is looked through once more when the process ends
        open_streams()
        end_as_ctrl_c()
        try:
            with warnings_on_one_line():
                return super().invoke(ctx)
        except MacrofitError as error:
            complain(error)
            ctx.exit(USER_MISTAKE)
        except KeyboardInterrupt:
            complain("interrupted")
            ctx.exit(INTERRUPTED)
        except OSError as error:
            if error.errno not in FULL or error.filename is not None:
                raise
            swallow(sys.stdout)
            complain(f"standard output: cannot be written: {error.strerror} (make room, then give the command again)")
            ctx.exit(USER_MISTAKE)
        except click.UsageError as error:
            raise _on_one_line(error) from None
        except (click.ClickException, click.exceptions.Exit, click.Abort):
            raise
        except Exception as error:
            if not was_interrupted(error):
                raise
            complain("interrupted")
            ctx.exit(INTERRUPTED)
        finally:
            atexit.register(end_at_once)  # last in, first out: before what was imported meanwhile cleans up


def _on_one_line(error: click.UsageError) -> click.exceptions.Exit:
    """Say what is wrong with a line that was typed, and give what ends the program."""
    command = command_name() if error.ctx is None else error.ctx.command_path
    said = " ".join(error.format_message().split()).rstrip(".")
    click.echo(f"{command.split()[0]}: {said} (see {command} --help)", err=True)
    return click.exceptions.Exit(USER_MISTAKE)


def set_option(what: str, complete: Complete | None = None) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """The option --set, which changes a key of ``what``; the command gets all of them as ``overrides``.

    ``complete`` gives a shell the keys.
    """
    return click.option(
        "--set", "overrides", multiple=True, metavar="KEY=VALUE", shell_complete=complete,
        help=f"Change a key of {what}.",
    )  # fmt: skip


def complain(message: object) -> None:
    """Say what went wrong, on one line that begins with the command's name."""
    click.echo(f"{command_name()}: {' '.join(str(message).split())}", err=True)


def command_name() -> str:
    """The command that runs, for what it says."""
    context = click.get_current_context(silent=True)
    name = context.find_root().command.name if context is not None else None
    return name or "macrofit"


@contextmanager
def warnings_on_one_line() -> Iterator[None]:
    """Say a warning in the words of the command, without the place in the code."""
    with warnings.catch_warnings():
        warnings.showwarning = lambda message, *_, **__: complain(f"warning: {message}")
        yield


def was_interrupted(error: BaseException | None) -> bool:
    """Whether an error began as Ctrl-C: a library in C that is loading makes an ImportError of it."""
    while error is not None and not isinstance(error, KeyboardInterrupt):
        error = error.__cause__ or error.__context__
    return error is not None


def end_as_ctrl_c() -> None:
    """Let SIGTERM, by which a batch system ends a job, do what Ctrl-C does."""
    with suppress(ValueError):  # not in the main thread
        signal.signal(signal.SIGTERM, signal.default_int_handler)


def end_at_once() -> None:
    """Let signals end the process without a word, when its work is done and Python cleans up."""
    with suppress(ValueError):
        for number in (signal.SIGTERM, signal.SIGINT):
            signal.signal(number, signal.SIG_DFL)


def open_streams() -> None:
    """Put what swallows everything in the place of standard streams that are closed (`>&-`).

    Else the next file that is opened would be standard output, and whatever a library prints would go into it.
    """
    for number, name, mode in ((0, "stdin", "r"), (1, "stdout", "w"), (2, "stderr", "w")):
        try:
            os.fstat(number)
        except OSError:
            os.dup2(opened := os.open(os.devnull, os.O_RDWR), number)
            if opened != number:
                os.close(opened)
        if getattr(sys, name) is None:
            setattr(sys, name, Path(os.devnull).open(mode, encoding="utf-8"))  # noqa: SIM115


def few_threads() -> None:
    """One thread a process, unless the user has set another number: the small dense problems lose more than they gain.

    Under mpirun the ranks would fight for the cores.
    """
    for variable in THREADS:
        os.environ.setdefault(variable, "1")


def say_bug(rank: int, size: int) -> None:
    """Print the traceback of the exception in hand, with the rank it happened on."""
    click.echo(f"{command_name()}: rank {rank} of {size} failed\n{traceback.format_exc()}", err=True)
    flush()


def flush() -> None:
    """Hand over what was printed, before a process is ended the hard way."""
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError, ValueError):
            stream.flush()
