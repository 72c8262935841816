"""How fast is the database filled, does a second process double it, and does kill -9 lose or double anything?

    python -m tests.benchmarks surrogate_farm [--quick] [--kills 10] [--design narrow] [--design wide]

Wall time per pair of plates with two micro coefficients, by 1 and 2 processes, after one warm pair each. Then the farm
of two is killed at random moments and started again; what it leaves is compared with the database of one process that
nobody disturbed. The same again for pairs of the wide design, on plates of few spheres: there tests fail too, and
no failure may be lost either. Prints Markdown tables; ends with 1 where a database and the undisturbed one differ.
"""

from __future__ import annotations

import argparse
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from surrogate.data.database import read_database
from surrogate.data.journal import journal_of

ROOT = Path(__file__).parents[2]


class Plan(NamedTuple):
    """What a farm has to do."""

    design: str
    pairs: int
    spheres: int


class Kills(NamedTuple):
    """What became of a farm that was killed again and again."""

    hit: int
    """Kills that met a farm at work."""
    lost: int
    doubled: int


PLANS = {"narrow": Plan("narrow", 40, 3000), "wide": Plan("wide", 60, 1000)}
"""Farms of the record, by design."""
TOYS = {"narrow": Plan("narrow", 8, 500), "wide": Plan("wide", 8, 500)}
DELAYS = {"narrow": (1.0, 6.0), "wide": (0.2, 2.0)}
"""Seconds from the first sample kept until a kill; pairs on few spheres take a fraction of a second."""


def command(path: Path, plan: Plan, jobs: int) -> list[str]:
    """The farm, as a user starts it."""
    what = ["--pairs", str(plan.pairs), "--spheres", str(plan.spheres), "--jobs", str(jobs), "--quiet"]
    return [sys.executable, "-m", "surrogate", "generate", "--design", plan.design, "-o", str(path), *what]


def ended(path: Path) -> list[int]:
    """Numbers of all tests that have ended, the failed ones among them."""
    if not (path.exists() or journal_of(path).exists()):
        return []
    found = read_database(path)
    return [*found.samples.id.tolist(), *found.failures]


def wall_s(path: Path, plan: Plan, jobs: int) -> float:
    """Seconds per pair once the processes are warm: from the second sample each to the last."""
    process = subprocess.Popen(command(path, plan, jobs), cwd=ROOT)
    first, began = 0, 0.0
    while process.poll() is None:
        time.sleep(0.05)
        if not began and len(ended(path)) >= 2 * jobs:
            first, began = len(ended(path)), time.perf_counter()
    return (time.perf_counter() - began) / (plan.pairs - first)


def kill_often(path: Path, plan: Plan, kills: int) -> Kills:
    """Kill the farm of two `kills` times, then let it end; gives the tests lost and doubled on the way."""
    delays, seen, hit, lost, doubled = random.Random(4), set[int](), 0, 0, 0
    for _ in range(kills):
        process = subprocess.Popen(command(path, plan, 2), cwd=ROOT)
        while process.poll() is None and len(ended(path)) <= len(seen):
            time.sleep(0.05)
        time.sleep(delays.uniform(*DELAYS[plan.design]))
        hit += process.poll() is None
        process.send_signal(signal.SIGKILL)
        process.wait()
        there = ended(path)
        lost += len(seen - set(there))
        doubled += len(there) - len(set(there))
        seen = set(there)
    while subprocess.run(command(path, plan, 2), cwd=ROOT, capture_output=True).returncode:
        time.sleep(0.2)  # the processes of the last farm are still ending
    return Kills(hit, lost, doubled)


def content(path: Path) -> tuple[str, dict[int, str]]:
    """What two databases of the same tests have in common."""
    found = read_database(path)
    return found.content_hash, found.failures


def judged(folder: Path, plan: Plan, kills: int) -> tuple[dict[int, float], Kills, bool]:
    """Seconds per pair by processes, what the kills did, and whether all databases are the same."""
    paths = {jobs: folder / f"{plan.design}-{jobs}.h5" for jobs in (1, 2)}
    seconds = {jobs: wall_s(path, plan, jobs) for jobs, path in paths.items()}
    killed = folder / f"{plan.design}-killed.h5"
    found = kill_often(killed, plan, kills)
    undisturbed, *others = (content(path) for path in (*paths.values(), killed))
    return seconds, found, all(other == undisturbed for other in others)


def print_table(head: str, rows: Sequence[str]) -> None:
    """Print a Markdown table."""
    print(head, "|" + "---|" * (head.count("|") - 1), *rows, "", sep="\n")


def main(words: Sequence[str]) -> int:
    """Print the tables."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks surrogate_farm", description=__doc__)
    parser.add_argument("--quick", action="store_true", help="Few small plates: to see that it runs.")
    parser.add_argument("--kills", type=int, default=10)
    parser.add_argument("--design", choices=PLANS, action="append", help="One of the two alone.")
    options = parser.parse_args(words)
    plans, kills = (TOYS, 1) if options.quick else (PLANS, options.kills)
    walls, killed, wrong = [], [], 0
    with tempfile.TemporaryDirectory() as folder:
        for design in options.design or plans:
            plan = plans[design]
            seconds, found, same = judged(Path(folder), plan, kills)
            about = f"| {design} | {plan.pairs} | {plan.spheres} |"
            for jobs, each in seconds.items():
                speed = seconds[1] / each
                walls.append(f"{about} {jobs} | {each:.2f} | {each * 1000.0 / 60.0:.0f} | {speed:.2f} |")
            killed.append(
                f"{about} {kills} | {found.hit} | {found.lost} | {found.doubled} | {'yes' if same else 'NO'} |"
            )
            wrong += found.lost + found.doubled + (not same)
    print(f"{os.cpu_count()} cores, two micro coefficients\n")
    about = "| design | pairs of plates | spheres |"
    print_table(f"{about} processes | wall [s] per pair | 1000 pairs [min] | speed-up |", walls)
    print_table(f"{about} kill -9 | at work | tests lost | doubled | content as undisturbed |", killed)
    return int(wrong > 0)
