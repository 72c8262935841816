"""The files that come with the package are those that `make networks` makes: same samples, same options."""

from __future__ import annotations

import shlex
import subprocess
from pathlib import Path

import numpy as np
import pytest

from surrogate.data.table import read_table
from surrogate.network.checkpoint import CNNOptions, load_for_answers
from surrogate.network.shipped import FOLDER

ROOT = Path(__file__).parents[3]
PLAYED = 'mkdir() { :; }\ncp() { echo cp "$@"; }\nsurrogate() { echo "$@"; }\n'


@pytest.fixture(scope="module")
def commands() -> list[list[str]]:
    """The words of every command of the recipe, with the network and copying played."""
    shown = ["make", "--no-print-directory", "-n", "networks"]
    recipe = subprocess.run(shown, cwd=ROOT, check=True, capture_output=True, text=True).stdout
    lines = [line for line in recipe[recipe.rindex("mkdir -p ") :].splitlines() if not line.startswith("surrogate()")]
    said = subprocess.run(["bash", "-eu", "-c", PLAYED + "\n".join(lines)], check=True, capture_output=True, text=True)
    return [shlex.split(line) for line in said.stdout.splitlines()]


def option(words: list[str], name: str, default: int) -> int:
    return int(words[words.index(name) + 1]) if name in words else default


def maker(commands: list[list[str]], kind: str, file: str) -> list[str]:
    """The command of a kind that writes a file, under its own name or the one that it is copied from."""
    made = {Path(words[-1]).name: words[1] for words in commands if words[0] == "cp" and len(words) == 3}
    (found,) = [
        words for words in commands
        if words[0] == kind and Path(words[words.index("-o") + 1]).name == Path(made.get(file, file)).name
    ]  # fmt: skip
    return found


@pytest.mark.parametrize("file", [path.name for path in FOLDER.glob("*.safetensors")])
def test_a_shipped_network_is_the_one_of_the_recipe(file: str, commands: list[list[str]]) -> None:
    words = maker(commands, "train", file)
    databases = words[1 : words.index("-o")]
    _, about = load_for_answers(FOLDER / file)
    assert about.wide == (len(databases) > 1)
    assert about.architecture == ("paper" if "paper" in words else "energy")
    assert about.faces == ("envelope" if "envelope" in words else "generated")
    assert about.points == option(words, "--points", 65 if about.faces == "envelope" else 33)
    if isinstance(about.options, CNNOptions):
        assert about.options.members == option(words, "--seeds", 1)
    pairs = sum(option(maker(commands, "generate", database), "--pairs", 0) for database in databases)
    assert 0.95 * pairs < about.training + about.validation <= pairs  # what plates cannot do is left out


@pytest.mark.parametrize("file", [path.name for path in FOLDER.glob("*.csv*")])
def test_a_shipped_table_has_the_pairs_of_the_recipe(file: str, commands: list[list[str]]) -> None:
    words, found = maker(commands, "table", file), read_table(FOLDER / file)
    made = maker(commands, "generate", words[1])
    packings = option(made, "--packings", 1)
    assert len(np.unique(found.samples.id // packings)) == option(made, "--pairs", 0)
