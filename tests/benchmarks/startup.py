"""How long does each command take to start, and what does it import for it?

    python -m tests.benchmarks startup

Every command is run from the shell, in a folder with nothing but a made curve and with warm caches. Measured are the
seconds on the clock and of the processor until it ends, or until it prints the first increment or coefficient (it is
stopped then); the number of modules it imports, and the packages whose own modules take the longest (python -X
importtime).
"""

from __future__ import annotations

import argparse
import os
import re
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import median

from ._measure import Cost, head, row

ROOT = Path(__file__).parents[2]
LISTED = 4  # packages
INCREMENT, COEFFICIENT = r"^increment +1/", r"^Micro"
CURVE, CURVE_TEXT = "press.csv", "displacement_mm,force_kN\n" + "".join(f"{s},{5.5 * s}\n" for s in range(181))


@dataclass(frozen=True)
class Command:
    """What is typed, and the line of its output that ends the measurement (none: its end)."""

    words: str
    until: str | None = None

    @property
    def argv(self) -> list[str]:
        """The interpreter with the program as a module."""
        program, *rest = self.words.split()
        module = {"macrofit": "macrofit", "macrofit-meso": "meso", "macrofit-surrogate": "surrogate"}[program]
        return ["-m", module, *rest]


BARS = {Command("macrofit --help"): 0.15, Command("macrofit run wheelset", INCREMENT): 2.5}  # s on the clock
WHOLE = {
    Command("macrofit run wheelset"): 2.2,
    Command("macrofit run wheelset --preset fast"): 1.2,
    Command("macrofit run wheelset --set friction.provider=surrogate"): 3.2,
    Command("macrofit-meso run"): 1.6,
}  # s of the processor
COMMANDS = (
    Command("macrofit --help"),
    Command("macrofit scenes"),
    Command("macrofit providers"),
    Command("macrofit check wheelset"),
    Command(f"macrofit judge {CURVE} --diameter 190 --length 180"),
    Command("macrofit schema"),
    Command("macrofit run wheelset", INCREMENT),
    Command("macrofit run wheelset --set friction.provider=surrogate", INCREMENT),
    Command("macrofit run wheelset"),
    Command("macrofit run wheelset --preset fast"),
    Command("macrofit run wheelset --set friction.provider=surrogate"),
    Command("macrofit-meso run"),
    Command("macrofit study wheelset --vary friction.options.coefficient=0.1,0.12 --set motion.travel=1"),
    Command("macrofit-meso --help"),
    Command("macrofit-meso surface"),
    Command("macrofit-meso sample -o plates.vtu"),
    Command("macrofit-meso run", COEFFICIENT),
    Command("macrofit-surrogate --help"),
    Command("macrofit-surrogate predict"),
)
QUICK = (COMMANDS[0], COMMANDS[3])


def started(command: Command, *options: str) -> tuple[float, float, str]:
    """Seconds on the clock and of the processor until the command ends or says its word, and its stderr."""
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    with tempfile.TemporaryDirectory() as folder, tempfile.TemporaryFile("w+") as errors:
        (Path(folder) / CURVE).write_text(CURVE_TEXT)
        begun = time.perf_counter()
        process = subprocess.Popen(
            [sys.executable, *options, *command.argv], cwd=folder, env=environment, stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE, stderr=errors, text=True,
        )  # fmt: skip
        assert process.stdout is not None
        said = any(command.until and re.search(command.until, line) for line in process.stdout)
        wall, spent = time.perf_counter() - begun, processor_time(process.pid)
        if said:
            process.terminate()
        process.stdout.close()
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        errors.seek(0)
        text = errors.read()
        if not said and (process.returncode or command.until):
            raise RuntimeError(f"{command.words}: exit code {process.returncode}\n{text[-2000:]}")
        return wall, spent if said else usage.ru_utime + usage.ru_stime, text


def processor_time(process: int) -> float:
    """Seconds of the processor a living process has taken, its ended children not counted."""
    fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / float(os.sysconf("SC_CLK_TCK"))


def imports(text: str) -> tuple[int, list[tuple[str, float]]]:
    """Modules in the words of -X importtime, and the packages with the most milliseconds in modules of their own."""
    lines = re.findall(r"^import time: +(\d+) \| +\d+ \| +(\S+)$", text, re.MULTILINE)
    own: Counter[str] = Counter()
    for microseconds, name in lines:
        own[name.partition(".")[0]] += int(microseconds)
    return len(lines), [(name, taken / 1e3) for name, taken in own.most_common(LISTED)]


def measure(command: Command, repeats: int) -> tuple[Cost, Cost, int, list[tuple[str, float]]]:
    """Both costs after a run that warms the caches, the number of modules, and the largest imports."""
    modules, largest = imports(started(command, "-X", "importtime")[2])
    taken = [started(command)[:2] for _ in range(repeats)]
    wall, spent = zip(*taken, strict=True)
    return Cost(wall), Cost(spent), modules, largest


def main(words: Sequence[str]) -> int:
    """Print a row per command."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks startup", description=__doc__)
    parser.add_argument("--quick", action="store_true", help="two commands, once")
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--whole", action="store_true", help="the four commands with a bar of CPU seconds alone")
    options = parser.parse_args(words)
    commands, repeats = (QUICK, 1) if options.quick else (COMMANDS, options.repeats)
    commands = tuple(WHOLE) if options.whole else commands
    print(head("command", "until", "clock s", "bar", "CPU s", "modules", "largest imports, ms of their own modules"))
    over: list[str] = []
    heavy: list[str] = []
    for command in commands:
        wall, spent, modules, largest = measure(command, repeats)
        bar = BARS.get(command)
        if bar is not None and median(wall.seconds) > bar:
            over.append(command.words)
        if command in WHOLE and median(spent.seconds) > WHOLE[command]:
            heavy.append(command.words)
        until = {INCREMENT: "first increment", COEFFICIENT: "first coefficient", None: "its end"}[command.until]
        listed = ", ".join(f"{name} {taken:.0f}" for name, taken in largest)
        print(row(f"`{command.words}`", until, wall, bar or "", spent, modules, listed), flush=True)
    held = f"over its bar: {', '.join(over)}" if over else "every bar is kept"
    bars = ", ".join(f"`{command.words}` {bar:g}" for command, bar in WHOLE.items())
    kept = f"over their bars: {', '.join(heavy)}" if heavy else "every bar is kept"
    print(f"\nMedian of {repeats}, range in brackets. On the clock, {held}. Of CPU seconds ({bars}), {kept}.")
    return 0
