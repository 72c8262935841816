"""What `macrofit init` writes loads at once, explains every key, and never overwrites."""

from __future__ import annotations

import tomllib
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from macrofit.cli import main
from macrofit.scene import json_schema, load_scene

KINDS = ("hub", "wheel", "hollow-axle", "meshes")


def macrofit(*arguments: object) -> Result:
    return CliRunner(mix_stderr=False).invoke(main, [str(argument) for argument in arguments])


@pytest.fixture(autouse=True)
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize("kind", KINDS)
def test_a_draft_checks_at_once_and_without_a_doubt(kind: str) -> None:
    assert macrofit("init", kind, "-o", "my wheel.toml").exit_code == 0
    checked = macrofit("check", "my wheel.toml")
    assert checked.exit_code == 0, checked.stderr
    assert checked.stderr == ""
    assert "Doubtful" not in checked.stdout
    assert "First touch     at" in checked.stdout


@pytest.mark.parametrize("kind", KINDS)
def test_every_key_has_its_meaning_above_it(kind: str, here: Path) -> None:
    macrofit("init", kind)
    text = (here / f"{kind}.toml").read_text()
    lines, told = text.splitlines(), " ".join(text.replace("\n# ", " ").split())
    schema = json_schema()["$defs"]
    bodies = ("MeshFile",) if kind == "meshes" else ("Shaft", "Hub")
    for record in (*bodies, "Motion", "MeshKeys", "FrictionKeys", "ContactKeys", "OutputKeys", "Material"):
        for key, known in schema[record]["properties"].items():
            if key not in ("shape", "options", "material"):
                assert known["description"] in told, key
                number = next(k for k, line in enumerate(lines) if line.removeprefix("# ").startswith(f"{key} = "))
                assert lines[number - 1].startswith("# ")
    assert all(len(line) <= 120 for line in lines)


@pytest.mark.parametrize("kind", KINDS)
def test_a_key_that_is_not_set_stands_there_with_its_default(kind: str, here: Path) -> None:
    """Taken out of the comments one by one, each is accepted and changes nothing."""
    macrofit("init", kind)
    file = here / f"{kind}.toml"
    lines, whole = file.read_text().splitlines(), load_scene(file)
    hidden = [k for k, line in enumerate(lines) if line.startswith("# ") and " = " in line and "[" not in line[:3]]
    defaults = [k for k in hidden if not lines[k].endswith("...") and is_a_key(lines[k][2:])]
    assert len(defaults) > 10
    for k in defaults:
        file.write_text("\n".join([*lines[:k], lines[k][2:], *lines[k + 1 :]]))
        assert load_scene(file) == whole, lines[k]


def is_a_key(line: str) -> bool:
    try:
        return len(tomllib.loads(line)) == 1
    except tomllib.TOMLDecodeError:
        return False


def test_nothing_is_overwritten(here: Path) -> None:
    (here / "hub.toml").write_text("mine")
    refused = macrofit("init")
    assert refused.exit_code == 2
    assert (
        refused.stderr == "macrofit: hub.toml: is there already, and is not overwritten; choose another name with -o\n"
    )
    assert (here / "hub.toml").read_text() == "mine"
    (here / "a-wheel.msh").write_text("mine")
    refused = macrofit("init", "meshes", "-o", "a.toml")
    assert "a-wheel.msh: is there already" in refused.stderr
    assert sorted(file.name for file in here.iterdir()) == ["a-wheel.msh", "hub.toml"]


@pytest.mark.parametrize(
    ("words", "said"),
    [(("cone",), "'cone' is not one of"), (("-o", "file/where.toml"), "file/where.toml: cannot be written")],
)
def test_a_mistake_is_said(words: tuple[str, ...], said: str) -> None:
    Path("file").write_text("no folder")
    shown = macrofit("init", *words)
    assert shown.exit_code == 2
    assert said in shown.stderr


def test_the_meshes_are_those_of_the_draft_of_a_wheel(here: Path) -> None:
    """Pressed a little they give the force of the drawn bodies, for the facets are the same."""
    from mpi4py import MPI

    from macrofit.solve import solve

    short = ("motion.start=20", "motion.travel=22", "output.stress=false", "output.fields_at=[]")
    forces = []
    for kind in ("wheel", "meshes"):
        macrofit("init", kind)
        forces.append(solve(load_scene(here / f"{kind}.toml", short), MPI.COMM_SELF).force[-1])
    assert forces[1] == pytest.approx(forces[0], rel=2e-3)


@pytest.mark.slow
def test_the_commands_of_the_page_run(here: Path) -> None:
    """docs/your-own-wheel.md, in the order in which it is read."""
    page = (Path(__file__).parents[3] / "docs" / "your-own-wheel.md").read_text()
    commands = [line.split()[1:] for line in page.splitlines() if line.startswith("macrofit ")]
    assert [words[0] for words in commands] == ["init", "check", "converge"]
    for words in commands:
        shown = macrofit(*words, *(("--set", "motion.travel=20") if words[0] == "converge" else ()))
        assert shown.exit_code == 0, shown.stderr
    assert "Preset" in shown.stdout
    assert (here / "section.svg").exists()
    assert (here / "my-convergence" / "convergence.json").exists()
