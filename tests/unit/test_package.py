"""What is distributed: all that the programs read is inside, the sdist gives the same wheel, and that runs."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tarfile
import tomllib
import zipfile
from pathlib import Path

import pytest
from unit.test_imports import imported_modules

import macrofit

ROOT = Path(__file__).parents[2]
PACKAGES = ("macrofit", "meso", "surrogate")
BUILD = "import sys; from setuptools import build_meta; print(build_meta.build_{what}(sys.argv[1]))"
OF_THE_SYSTEM = {"basix", "dolfinx", "ffcx", "ufl", "petsc4py", "numba", "llvmlite", "gmsh", "h5py", "cffi"}
"""Modules that come with dolfinx and from Debian, not from a package index; see pyproject.toml."""

IF_THERE = {"SurfaceTopography"}
"""Modules that are used where a user has put them; docs/surfaces.md says why they are no extra."""


def build(what: str, tree: Path, into: Path) -> Path:
    """An sdist or a wheel of a tree, made by the build system of pyproject.toml without a network."""
    into.mkdir(exist_ok=True)
    subprocess.run(
        [sys.executable, "-c", BUILD.format(what=what), str(into)],
        cwd=tree,
        check=True,
        capture_output=True,
        timeout=100,
    )
    (made,) = into.iterdir()
    return made


def contents(wheel: Path) -> dict[str, bytes]:
    with zipfile.ZipFile(wheel) as opened:
        return {name: opened.read(name) for name in opened.namelist()}


@pytest.fixture(scope="module")
def sources(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The tree without what was made in it."""
    tree = tmp_path_factory.mktemp("tree")
    for package in PACKAGES:
        shutil.copytree(ROOT / package, tree / package, ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, tree)
    return tree


@pytest.fixture(scope="module")
def wheel(sources: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The wheel that the sdist gives."""
    folder = tmp_path_factory.mktemp("built")
    with tarfile.open(build("sdist", sources, folder / "sdist")) as opened:
        opened.extractall(folder)
    (unpacked,) = (path for path in folder.glob("macrofit-*") if path.is_dir())
    return build("wheel", unpacked, folder / "wheel")


def test_the_sdist_gives_the_wheel_of_the_tree(sources: Path, wheel: Path, tmp_path: Path) -> None:
    assert contents(build("wheel", sources, tmp_path / "direct")) == contents(wheel)


def test_every_file_of_the_packages_is_in_the_wheel(sources: Path, wheel: Path) -> None:
    """Scenes, drafts, standards, steels, calibrations and networks as much as the code; nothing of the tests."""
    wanted = {
        str(path.relative_to(sources))
        for package in PACKAGES
        for path in (sources / package).rglob("*")
        if path.is_file()
    }
    found = {name for name in contents(wheel) if ".dist-info/" not in name}
    assert {name for name in wanted if not name.endswith(".py")}
    assert found == wanted


def test_the_wheel_runs_in_an_environment_of_its_own(wheel: Path, tmp_path: Path) -> None:
    """With the packages of the system and of this environment, but not with its macrofit; away from the tree."""
    place = tmp_path / "env"
    subprocess.run([sys.executable, "-m", "venv", "--system-site-packages", "--without-pip", place], check=True)
    pip = [
        sys.executable,
        "-m",
        "pip",
        "--python",
        place / "bin" / "python",
        "install",
        "-q",
        "--no-deps",
        "--no-index",
    ]
    subprocess.run([*pip, wheel], check=True, capture_output=True)
    (packages,) = place.glob("lib/python*/site-packages")
    others = [path for path in sys.path if path.endswith("-packages")]
    (packages / "others.pth").write_text("".join(f"{path}\n" for path in others))
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}

    def out(program: str, *words: str) -> str:
        done = subprocess.run(
            [place / "bin" / program, *words], cwd=tmp_path, env=environment, stdin=subprocess.DEVNULL,
            capture_output=True, text=True, timeout=100,
        )  # fmt: skip
        assert done.returncode == 0, done.stderr
        return done.stdout

    assert str(packages) in out("python", "-c", "import macrofit, meso, surrogate; print(macrofit.__path__)")
    assert re.findall(r"^(\w+)  from", out("macrofit", "providers"), re.MULTILINE) == [
        "dem", "evolving", "surrogate", "table", "uniform"
    ]  # fmt: skip
    out("macrofit", "init", "hub")
    coarse = ("--preset", "fast", "--set", "motion.increment=20")
    assert "by GOST 11018" in out("macrofit", "run", "hub.toml", *coarse, "--standard", "gost-11018")
    assert "Roughness" in out("macrofit-meso", "surface")
    assert "Usage" in out("macrofit-surrogate", "train", "--help")


def test_what_is_imported_is_asked_for() -> None:
    """Each package from outside is a dependency in pyproject.toml, or comes with Debian's dolfinx."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    lines = [*project["dependencies"], *project["optional-dependencies"]["surrogate"]]
    asked = {re.split(r"[^\w-]", line)[0].replace("-", "_") for line in lines}
    used = set()
    for package in PACKAGES:
        for path in (ROOT / package).rglob("*.py"):
            inside = ".".join(path.relative_to(ROOT).parent.parts)
            used |= {name.partition(".")[0] for name in imported_modules(path, inside)}
    assert used - set(sys.stdlib_module_names) - set(PACKAGES) - OF_THE_SYSTEM - IF_THERE == asked


def test_the_recipe_asks_for_what_the_package_asks_for() -> None:
    """Names differ for two of them: the build of matplotlib without windows, and torch."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    recipe = (ROOT / "docs" / "install" / "recipe.yaml").read_text()
    names = {"matplotlib": "matplotlib-base", "torch": "pytorch"}
    for line in [*project["dependencies"], *project["optional-dependencies"]["surrogate"]]:
        name, bound = line.split(">=")
        assert f"    - {names.get(name, name)} >={bound}\n" in recipe
    for command, target in project["scripts"].items():
        assert f"      - {command} = {target}\n" in recipe
    assert f"python {project['requires-python']}" in recipe


def test_the_container_has_what_its_set_up_reads() -> None:
    text = (ROOT / "docs" / "install" / "Containerfile").read_text()
    copied = {name for words in re.findall(r"^COPY (.+) \S+$", text, re.MULTILINE) for name in words.split()}
    assert copied == {"Makefile", "pyproject.toml", "constraints.txt", "README.md", "LICENSE", *PACKAGES}
    assert "RUN make setup-network" in text


def test_versions_and_dates_agree() -> None:
    """The newest release of the changelog is the one to cite, and the recipe builds it."""
    changes = (ROOT / "CHANGELOG.md").read_text()
    version, day = re.findall(r"^## \[([\d.]+)\] - (\d{4}-\d\d-\d\d)$", changes, re.MULTILINE)[0]
    assert version == macrofit.__version__
    citation = (ROOT / "CITATION.cff").read_text()
    assert f"\nversion: {version}\n" in citation
    assert f"\ndate-released: {day}\n" in citation
    assert f"\n  version: {version}\n" in (ROOT / "docs" / "install" / "recipe.yaml").read_text()
