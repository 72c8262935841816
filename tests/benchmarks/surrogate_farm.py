"""How fast is the database filled, does a second process double it, and does kill -9 lose or double anything?

    python -m tests.benchmarks surrogate_farm [--quick] [--kills 10]

Wall time per pair of plates with two micro coefficients, by 1 and 2 processes, after one warm pair each. Then the farm
of two is killed at random moments and started again; what it leaves is compared with the database of one process that
nobody disturbed. Prints a Markdown table; ends with 1 where the two differ.
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

from surrogate.data.database import read_database

ROOT = Path(__file__).parents[2]


def command(path: Path, pairs: int, spheres: int, jobs: int) -> list[str]:
    """The farm, as a user starts it."""
    what = ["--pairs", str(pairs), "--spheres", str(spheres), "--jobs", str(jobs), "--quiet"]
    return [sys.executable, "-m", "surrogate", "generate", "-o", str(path), *what]


def wall_s(path: Path, pairs: int, spheres: int, jobs: int) -> float:
    """Seconds per pair once the processes are warm: from the second sample each to the last."""
    process = subprocess.Popen(command(path, pairs, spheres, jobs), cwd=ROOT)
    first, began = 0, 0.0
    while process.poll() is None:
        time.sleep(0.05)
        if (
            not began
            and path.with_name(f"{path.name}.journal").exists()
            and len(read_database(path).samples) >= 2 * jobs
        ):
            first, began = len(read_database(path).samples), time.perf_counter()
    return (time.perf_counter() - began) / (pairs - first)


def kill_often(path: Path, pairs: int, spheres: int, kills: int) -> tuple[int, int]:
    """Kill the farm of two `kills` times, then let it end; gives the samples lost and doubled on the way."""
    delays, seen, lost, doubled = random.Random(4), set[int](), 0, 0
    for _ in range(kills):
        process = subprocess.Popen(command(path, pairs, spheres, 2), cwd=ROOT)
        while process.poll() is None and not path.with_name(f"{path.name}.journal").exists():
            time.sleep(0.01)
        time.sleep(delays.uniform(1.0, 6.0))
        process.send_signal(signal.SIGKILL)
        process.wait()
        there = read_database(path).samples.id.tolist()
        lost += len(seen - set(there))
        doubled += len(there) - len(set(there))
        seen = set(there)
    while subprocess.run(command(path, pairs, spheres, 2), cwd=ROOT, capture_output=True).returncode:
        time.sleep(0.2)  # the processes of the last farm are still ending
    return lost, doubled


def main(words: Sequence[str]) -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks surrogate_farm", description=__doc__)
    parser.add_argument("--quick", action="store_true", help="Few small plates: to see that it runs.")
    parser.add_argument("--kills", type=int, default=10)
    options = parser.parse_args(words)
    pairs, spheres, kills = (8, 500, 1) if options.quick else (40, 3000, options.kills)
    with tempfile.TemporaryDirectory() as folder:
        paths = {jobs: Path(folder) / f"{jobs}.h5" for jobs in (1, 2)}
        seconds = {jobs: wall_s(path, pairs, spheres, jobs) for jobs, path in paths.items()}
        killed = Path(folder) / "killed.h5"
        lost, doubled = kill_often(killed, pairs, spheres, kills)
        same = len({read_database(path).content_hash for path in (*paths.values(), killed)}) == 1
        print(f"{os.cpu_count()} cores, {spheres} spheres, {pairs} pairs of plates, two micro coefficients")
        print("| processes | wall [s] per pair | 1000 pairs [min] | speed-up |")
        print("|---|---|---|---|")
        for jobs, each in seconds.items():
            print(f"| {jobs} | {each:.2f} | {each * 1000.0 / 60.0:.0f} | {seconds[1] / each:.2f} |")
        print("| kill -9 | samples lost | doubled | content as undisturbed |")
        print("|---|---|---|---|")
        print(f"| {kills} | {lost} | {doubled} | {'yes' if same else 'NO'} |")
    return int(lost > 0 or doubled > 0 or not same)
