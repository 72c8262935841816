"""What a shell is told where a line is begun: commands, scenes, keys and their values; and what is loaded for that."""

from __future__ import annotations

import os
import shlex
import subprocess
import sys
from pathlib import Path

import pytest
from unit.test_imports import HEAVY, loaded_by

from macrofit.scene import scene_names

PROGRAMS = {"macrofit": "macrofit", "macrofit-meso": "meso", "macrofit-surrogate": "surrogate"}
TRY = """
compopt() {{ echo "compopt $*" >> told; }}
eval "$({source})"
COMP_WORDS=({words})
COMP_CWORD=$((${{#COMP_WORDS[@]}} - 1))
{function}_completion {program}
printf '%s\\n' "${{COMPREPLY[@]}}"
"""


def script(program: str, folder: Path) -> Path:
    """The command as it is installed, made for this interpreter."""
    path = folder / program
    path.write_text(f"#!{sys.executable}\nfrom {PROGRAMS[program]}.cli import main\nmain()\n")
    path.chmod(0o755)
    return path


def completed(line: str, folder: Path) -> list[str]:
    """What bash puts in the place of the last word; words are split at an = as bash does it."""
    program = line.split()[0]
    script(program, folder)
    words = shlex.join([*line.replace("=", " = ").split(), *([""] if line.endswith(" ") else [])])
    variable = f"_{program}_COMPLETE".replace("-", "_").upper()
    text = TRY.format(
        source=f"{variable}=bash_source {program}", words=words,
        function=f"_{program}".replace("-", "_"), program=program,
    )  # fmt: skip
    done = subprocess.run(
        ["bash", "-c", text], cwd=folder, env=os.environ | {"PATH": f"{folder}:{os.environ['PATH']}"},
        capture_output=True, text=True, timeout=60,
    )  # fmt: skip
    assert done.stderr == ""
    return done.stdout.splitlines()


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("macrofit ju", ["judge"]),
        ("macrofit run wheelset-", ["wheelset-en"]),
        ("macrofit check sh", ["short.toml"]),
        ("macrofit run fol", ["folder/"]),
        ("macrofit run folder/", ["folder/in.toml"]),
        ("macrofit run wheelset --preset f", ["fast"]),
        ("macrofit run wheelset --standard gost", ["gost-11018"]),
        ("macrofit run wheelset --set mesh.co", ["mesh.corner_facet=", "mesh.coarse="]),
        ("macrofit study wheelset --vary motion.inc", ["motion.increment="]),
        ("macrofit run wheelset --set friction.provider=un", ["uniform"]),
        ("macrofit run wheelset --set solver=", ["condensed", "monolithic"]),
        ("macrofit run wheelset --set motion.release=t", ["true"]),
        ("macrofit study wheelset --vary contact.theta=0,", ["0,-1", "0,0", "0,1"]),
        ("macrofit run wheelset --set friction.options.", ["friction.options.coefficient="]),
        (
            "macrofit run wheelset --set friction.provider=evolving --set friction.options.b",
            ["friction.options.base="],
        ),
        ("macrofit-meso run --set engine.na", ["engine.name="]),
        ("macrofit-meso run --set engine.name=q", ["quasi-static"]),
        ("macrofit-surrogate generate --set plates.sph", ["plates.spheres="]),
    ],
)
def test_bash_completes(line: str, words: list[str], tmp_path: Path) -> None:
    (tmp_path / "short.toml").touch()
    (tmp_path / "folder").mkdir()
    (tmp_path / "folder" / "in.toml").touch()
    assert completed(line, tmp_path) == words
    ends_open = words[0].endswith(("=", "/"))
    assert (tmp_path / "told").exists() == ends_open  # no space behind a key or a folder


@pytest.mark.parametrize(("program", "line"), [
    ("macrofit", "macrofit run wh"),
    ("macrofit", "macrofit run wheelset --set friction.options."),
    ("macrofit-meso", "macrofit-meso run --set engine."),
    ("macrofit-surrogate", "macrofit-surrogate generate --set plates."),
])  # fmt: skip
def test_completion_loads_nothing_heavy(program: str, line: str) -> None:
    variable = f"_{program}_COMPLETE".replace("-", "_").upper()
    settings = {variable: "bash_complete", "COMP_WORDS": line, "COMP_CWORD": str(len(line.split()) - 1)}
    run = f"sys.argv = [{program!r}]; from {PROGRAMS[program]}.cli import main; main()"
    loaded = loaded_by(f"import os; os.environ.update({settings!r}); {run}")
    assert "msgspec" in loaded or "--set" not in line
    assert not loaded & HEAVY


@pytest.mark.parametrize("shell", ["zsh", "fish"])
def test_other_shells_get_whole_words(shell: str, tmp_path: Path) -> None:
    program = script("macrofit", tmp_path)
    settings = {"zsh": {"COMP_WORDS": "macrofit run wheelset --set solver=m", "COMP_CWORD": "4"},
                "fish": {"COMP_WORDS": "macrofit run wheelset --set solver=m", "COMP_CWORD": "solver=m"}}  # fmt: skip
    told = subprocess.run(
        [program], env=os.environ | {"_MACROFIT_COMPLETE": f"{shell}_complete"} | settings[shell],
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert "solver=monolithic" in told.stdout.replace("\n", " ").replace(",", " ").split()


def test_every_scene_is_known(tmp_path: Path) -> None:
    assert sorted(completed("macrofit converge ", tmp_path)[: len(scene_names())]) == scene_names()
