"""`make bench`: every benchmark in a process of its own, its tables and figure kept, and docs/benchmarks.md of them.

    python -m tests.benchmarks book [NAME ...] [--quick] [--into FOLDER]

Of each NAME (all by default) the folder gets NAME.md (what it printed), NAME.csv (its tables) and NAME.png (its
figure, where the script has a `draw`); then benchmarks.md beside the folder is put together of all that are there,
and the tables of the README and of docs/ that stand between `<!-- bench NAME -->` and `<!-- end -->` are renewed.
"""

from __future__ import annotations

import argparse
import ast
import csv
import os
import platform
import re
import subprocess
import sys
import time
from collections.abc import Sequence
from datetime import date
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
RECORDS = ROOT / "docs" / "benchmarks"
PACKAGES = ("numpy", "scipy", "numba", "fenics-dolfinx", "petsc4py", "mpi4py", "gmsh", "torch")
MARK = re.compile(r"(<!-- bench (\w+)(?: (\d+))? -->\n).*?(<!-- end -->)", re.DOTALL)


def names() -> list[str]:
    """Names of the benchmarks, in the order of the book: the press-fit, the plates, the network, the whole."""
    found = sorted(path.stem for path in HERE.glob("*.py") if not path.stem.startswith(("_", "test_")))
    return sorted(found, key=lambda name: (name.startswith("surrogate_"), name.startswith("meso_")))


def question(name: str) -> str:
    """First line of the script's docstring."""
    text = ast.get_docstring(ast.parse((HERE / f"{name}.py").read_text())) or name
    return text.splitlines()[0].rstrip(".:")


def draws(name: str) -> bool:
    """Whether the script makes a figure."""
    tree = ast.parse((HERE / f"{name}.py").read_text())
    return any(isinstance(node, ast.FunctionDef) and node.name == "draw" for node in tree.body)


def measure(name: str, folder: Path, *, quick: bool = False) -> bool:
    """Run one benchmark and keep what it says; False where it failed: what it said is then in NAME.failed.md alone."""
    words = [name, *(["--quick"] if quick else [])]
    figure, failed = folder / f"{name}.draft.png", folder / f"{name}.failed.md"
    if draws(name):
        words += ["--figure", str(figure)]
    print(f"{name} ...", end=" ", flush=True)
    started = time.monotonic()
    done = subprocess.run(
        [sys.executable, "-m", "tests.benchmarks", *words],
        cwd=ROOT, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, text=True, check=False,
    )  # fmt: skip
    taken = time.monotonic() - started
    print(f"{taken:.0f} s" if done.returncode == 0 else f"failed with {done.returncode}", flush=True)
    failed.unlink(missing_ok=True)
    if done.returncode:
        figure.unlink(missing_ok=True)
        failed.write_text(done.stdout)
        print(f"  what it said is in {failed}")
        return False
    if figure.is_file():
        figure.replace(folder / f"{name}.png")
    stamp = f"<!-- {commit()}, {date.today().isoformat()}, {taken:.0f} s -->\n"
    (folder / f"{name}.md").write_text(stamp + done.stdout.strip() + "\n")
    with (folder / f"{name}.csv").open("w", newline="") as file:
        for k, table in enumerate(tables(done.stdout)):
            csv.writer(file).writerows([[]] * bool(k) + table)
    return True


def tables(text: str) -> list[list[list[str]]]:
    """The Markdown tables of a text as rows of cells, the heads first."""
    found: list[list[list[str]]] = []
    inside = False
    for line in text.splitlines():
        if line.startswith("|"):
            if not inside:
                found.append([])
            if not re.fullmatch(r"[|\s:-]+", line):
                found[-1].append([cell.strip() for cell in line.strip().strip("|").split("|")])
        inside = line.startswith("|")
    return found


def commit() -> str:
    """The commit of the working tree, and whether it has changes beside the records themselves."""

    def git(*words: str) -> str:
        return subprocess.run(["git", *words], cwd=ROOT, capture_output=True, text=True, check=False).stdout.strip()

    changed = git("status", "--porcelain", "--", "*.py", "*.toml")
    return (git("rev-parse", "--short", "HEAD") or "no commit") + (" with changes" if changed else "")


def machine() -> list[str]:
    """What it was measured on, a line each."""
    model = re.search(r"model name\s*:\s*(.*)", Path("/proc/cpuinfo").read_text())
    memory = re.search(r"MemTotal:\s*(\d+)", Path("/proc/meminfo").read_text())
    found = []
    for package in PACKAGES:
        try:
            found.append(f"{package} {version(package)}")
        except PackageNotFoundError:
            found.append(f"{package} of the system")
    return [
        f"- {model[1] if model else platform.processor()}, {os.cpu_count()} cores, "
        f"{int(memory[1]) / 2**20 if memory else 0:.0f} GiB, {platform.system()} {platform.release()}",
        f"- Python {platform.python_version()}, {', '.join(found)}",
    ]


def book(folder: Path) -> str:
    """benchmarks.md of the records in a folder."""
    here = [name for name in names() if (folder / f"{name}.md").is_file()]
    parts = [
        "# Benchmarks\n",
        "Made by `make bench`. Times are CPU times of a warmed process, medians with their range in brackets where "
        "there is one; a comparison is of two things in one run. The machine is shared and its speed wanders.\n",
        "\n".join(machine()) + "\n",
        "\n".join(f"- [{question(name)}](#{name})" for name in here) + "\n",
    ]
    for name in here:
        stamp, _, text = (folder / f"{name}.md").read_text().partition("\n")
        figure = f"![{question(name)}]({folder.name}/{name}.png)\n" if (folder / f"{name}.png").is_file() else ""
        parts.append(
            f"## {name}\n\n**{question(name)}** `make bench NAMES={name}`, "
            f"[csv]({folder.name}/{name}.csv); commit {stamp.strip('<!- >')}.\n\n{text.strip()}\n\n{figure}"
        )
    return "\n".join(parts).rstrip() + "\n"


def pages() -> list[Path]:
    """The pages that show tables of the records: the README and those of docs/, but for the book itself."""
    return [ROOT / "README.md", *sorted(set((ROOT / "docs").glob("*.md")) - {RECORDS.with_suffix(".md")})]


def renewed(page: str, folder: Path) -> str:
    """A page with the tables between its marks as they were measured last."""

    def table(match: re.Match[str]) -> str:
        if not (folder / f"{match[2]}.md").is_file():
            return match[0]
        blocks = re.findall(r"(?:^\|.*\n)+", (folder / f"{match[2]}.md").read_text(), re.MULTILINE)
        return f"{match[1]}{blocks[int(match[3] or 1) - 1]}{match[4]}"

    return MARK.sub(table, page)


def main(words: Sequence[str]) -> int:
    """Measure, then write the book; 1 where a benchmark failed."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks book", description=__doc__.splitlines()[0])
    parser.add_argument("names", nargs="*", metavar="NAME", help="all of them by default; none with --write")
    parser.add_argument("--quick", action="store_true", help="toy sizes, to see that they run")
    parser.add_argument("--write", action="store_true", help="measure nothing, write the book of what is there")
    parser.add_argument("--into", type=Path, default=RECORDS)
    options = parser.parse_args(words)
    unknown = sorted(set(options.names) - set(names()))
    if unknown:
        parser.error(f"no benchmark {', '.join(unknown)}; there are {', '.join(names())}")
    if options.quick and options.into == RECORDS:
        parser.error("--quick: toys are no records; say where they go with --into FOLDER")
    folder: Path = options.into.resolve()
    folder.mkdir(parents=True, exist_ok=True)
    chosen = [] if options.write else options.names or names()
    failed = [name for name in chosen if not measure(name, folder, quick=options.quick)]
    folder.with_suffix(".md").write_text(book(folder))
    if folder == RECORDS:
        for page in pages():
            page.write_text(renewed(page.read_text(), folder))
    print(f"{len(chosen) - len(failed)} measured, {len(failed)} failed: {' '.join(failed)}" if failed else "done")
    return int(bool(failed))
