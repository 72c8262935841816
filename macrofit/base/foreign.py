"""Code that others wrote and that runs here: what it may not do is end the process."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any

SIGNALS = (signal.SIGINT, signal.SIGTERM)
"""What Ctrl-C and a batch system send, and Python may turn into KeyboardInterrupt."""


class ForeignExit(RuntimeError):
    """Foreign code that raised SystemExit, KeyboardInterrupt or another exception that ends a process."""


@contextmanager
def foreign_code() -> Iterator[None]:
    """Run foreign code: an exit that it raises is an error of it; the user's Ctrl-C stays what it is.

    Raises:
        ForeignExit: in place of every exception that is no Exception, unless a signal made it.
    """
    with _signals_noted() as noted:
        try:
            yield
        except Exception:
            raise
        except BaseException as error:
            if noted or (isinstance(error, KeyboardInterrupt) and not _in_main_thread()):
                raise
            if isinstance(error, SystemExit):
                raise ForeignExit(f"it asked the program to exit, with {error.code!r} (SystemExit)") from None
            raise ForeignExit(f"it raises {type(error).__name__}({error}), which would end the program") from None


@contextmanager
def _signals_noted() -> Iterator[list[int]]:
    """The signals that came meanwhile; each still does what it did. Only the main thread can know of them."""
    noted: list[int] = []
    before: dict[signal.Signals, Any] = {}

    def note(number: int, frame: FrameType | None) -> None:
        noted.append(number)
        before[signal.Signals(number)](number, frame)

    try:
        if _in_main_thread():
            for each in SIGNALS:
                handler = signal.getsignal(each)
                if callable(handler):
                    before[each] = handler
                    signal.signal(each, note)
        yield noted
    finally:
        for each, handler in before.items():
            if signal.getsignal(each) is note:
                signal.signal(each, handler)


def _in_main_thread() -> bool:
    return threading.current_thread() is threading.main_thread()
