"""A command in a terminal of its own, and the screen that its output leaves."""

from __future__ import annotations

import os
import pty
import re
import select
import struct
import sys
import termios
import time
from collections.abc import Sequence
from fcntl import ioctl

from launcher import alone

CODE = re.compile(r"\x1b\[([?\d;]*)([A-Za-z])")


class Terminal:
    """`python -m MODULE WORDS...` at a terminal: what it writes, with the time since its start."""

    def __init__(self, module: str, *words: str, columns: int = 80) -> None:
        self.columns, self.output, self.first_s = columns, "", float("inf")
        self._begun = time.monotonic()
        self._child, self._terminal = pty.fork()
        if self._child == 0:
            ioctl(0, termios.TIOCSWINSZ, struct.pack("HHHH", 24, columns, 0, 0))
            os.execve(sys.executable, [sys.executable, "-m", module, *words], alone() | {"TERM": "xterm"})

    def press(self, keys: str) -> None:
        """Type something."""
        os.write(self._terminal, keys.encode())

    def wait_for(self, text: str, seconds: float = 60.0) -> None:
        """Read on until a text is there."""
        end = time.monotonic() + seconds
        while text not in self.output:
            assert time.monotonic() < end, self.output
            assert self._read(end - time.monotonic()), self.output

    def ended(self) -> int:
        """Read on to the end; the exit code."""
        while self._read(60.0):
            pass
        code = os.waitstatus_to_exitcode(os.waitpid(self._child, 0)[1])
        os.close(self._terminal)
        return code

    def echoes_control(self) -> bool:
        """Whether the terminal shows ^C where that is typed."""
        return bool(termios.tcgetattr(self._terminal)[3] & termios.ECHOCTL)

    def lines(self) -> list[str]:
        """What is to be read on the screen, empty lines left out."""
        return [line for line in shown(self.output, self.columns) if line]

    def _read(self, seconds: float) -> bool:
        if not select.select([self._terminal], [], [], max(seconds, 0.0))[0]:
            return False
        try:
            data = os.read(self._terminal, 65536)
        except OSError:  # the other end is closed
            return False
        self.first_s = min(self.first_s, time.monotonic() - self._begun)
        self.output += data.decode(errors="replace")
        return bool(data)


def shown(output: str, columns: int) -> Sequence[str]:
    """The lines of a screen of so many columns after an output: wrapped, overwritten and erased as a terminal does."""
    rows, row, column, place = [""], 0, 0, 0
    while place < len(output):
        code = CODE.match(output, place)
        if code:
            place = code.end()
            count = int(code[1]) if code[1].isdecimal() else 0
            if code[2] == "K":
                rows[row] = "" if count == 2 else rows[row][:column]
            elif code[2] == "A":
                row = max(row - max(count, 1), 0)
            continue
        sign = output[place]
        place += 1
        if sign == "\r":
            column = 0
        elif sign == "\n" or (sign >= " " and column == columns):
            row, column = row + 1, 0 if sign != "\n" else column
            rows += [""] * (row == len(rows))
        if sign >= " ":
            rows[row] = rows[row].ljust(column)[:column] + sign + rows[row][column + 1 :]
            column += 1
    return [line.rstrip() for line in rows]
