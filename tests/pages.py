"""The pages of the manual as a reader uses them: their code blocks, the commands in these, and toys of commands."""

from __future__ import annotations

import re
import shlex
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[1]
BOOK = ROOT / "docs" / "benchmarks.md"
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]

FENCE = re.compile(r"^```([\w-]*)(?: title=\"([^\"]+)\")?[^\n]*\n(.*?)^```$", re.MULTILINE | re.DOTALL)
NOT_RUN = re.compile(r"<!-- no run: (.+) -->\n\Z")
PROGRAMS = ("macrofit", "macrofit-meso", "macrofit-surrogate", "mpirun", "make", "export", ".", "python")
"""What the first word of a command may be."""


class Block(NamedTuple):
    """A fenced block of a page."""

    line: int
    language: str
    title: str
    text: str
    not_run: str  # the reason why it is not run, if there is one


def blocks(page: Path) -> list[Block]:
    """All blocks of a page; one without a language whose first word is a program counts as `sh`."""
    text, found = page.read_text(), []
    for match in FENCE.finditer(text):
        language, title, inside = match[1], match[2] or "", match[3]
        first = Path((inside.split() or [""])[0]).name
        if not language and first in PROGRAMS:
            language = "sh"
        reason = NOT_RUN.search(text[: match.start()])
        found.append(
            Block(text.count("\n", 0, match.start()) + 1, language, title, inside, reason[1] if reason else "")
        )
    return found


def commands(text: str) -> list[list[str]]:
    """The words of each command of a `sh` block, continued lines joined, comments gone, programs without a folder."""
    found = []
    for line in text.replace("\\\n", " ").splitlines():
        words = shlex.split(line, comments=True)
        if words:
            assert not set(words) & {"|", "&&", ";", ">", "<"}, f"only plain commands are run: {line}"
            at = next((k for k, word in enumerate(words) if Path(word).name in PROGRAMS[:3]), 0)
            words[at] = words[at] if words[at] == "." else Path(words[at]).name
            assert words[0] in PROGRAMS, f"not a command of a reader: {line}"
            found.append(words)
    return found


SHORT_KEYS = ["preset=fast", "motion.travel=24", "motion.increment=2"]
LIGHT_KEYS = ["plates.spheres=1000", "engine.increment=0.05"]
SHORT = ["--set", "motion.travel=24", "--set", "motion.increment=2"]
LIGHT_PLATES = ["--set", "plates.spheres=1000"]
SMALLER = {
    "[22,180]": "[22,24]", "=[180]": "=[24]", "=1:200": "=1:2", "=1:5": "=1:2",
    "=0.01,0.03,0.05,0.07,0.09": "=0.01,0.09",
}  # fmt: skip
SERVICE_KEYS = [
    "mesh.seat_facet=8", "mesh.coarse=40", "motion.start=90", "motion.increment=30", "service.harmonics=1",
    "service.steps=9",
]  # fmt: skip
PAIRS = {"1000": "24", "100": "2"}


def toy(words: list[str]) -> list[str]:
    """A command that does the same in little: a short way, coarse meshes, few spheres, few pairs."""
    program, command, *rest = words
    if program == "macrofit" and (command == "service" or "--service" in rest):
        rest = [word.replace("=0.1:0.3:0.05", "=0.2,0.4").replace("=1:200", "=1:2") for word in rest]
        return [program, command, *rest, *(word for key in SERVICE_KEYS for word in ("--set", key))]
    if program == "macrofit" and command in ("run", "study", "identify", "converge"):
        for large, small in SMALLER.items():
            rest = [word.replace(large, small) for word in rest]
        coarse = ["--set", "mesh.seat_facet=4"] if command == "converge" else ["--preset", "fast"]
        return [program, command, *rest, *([] if "--preset" in rest else coarse), *SHORT]
    if program == "macrofit-meso" and command in ("run", "sample"):
        quick = "engine.speed=200000" if "as-published" in rest else "engine.increment=0.05"
        return [program, command, *rest, *LIGHT_PLATES, "--set", quick, *(["--no-figures"] * (command == "run"))]
    if program == "macrofit-meso" and command == "calibrate":
        return [program, command, *rest, "--spheres", "100", "--packings", "1", "--no-figures"]
    if program == "macrofit-surrogate" and command == "generate":
        rest = [
            PAIRS.get(word, word) if before == "--pairs" else word
            for before, word in zip(["", *rest], rest, strict=False)
        ]
        return [program, command, *rest, *LIGHT_PLATES[:1], "engine.increment=0.05", "--spheres", "1000", "--jobs", "1"]
    if program == "macrofit-surrogate" and command == "train":
        return [program, command, *rest, "--epochs", "2"]
    return words
