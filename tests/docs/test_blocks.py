"""Every command, scene and script of the manual runs: a page in an empty folder, from its first block to its last."""

from __future__ import annotations

import importlib
import os
import re
import subprocess
import sys
import tomllib
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pages
import pytest
import scans
from benchmarks import _book as benchmarks
from click.testing import CliRunner
from launcher import alone, launcher_environment
from small import small_press

import macrofit.cli
import macrofit.scene
import meso.cli
import meso.settings
import surrogate.cli
from macrofit.acceptance import load_standard
from macrofit.base.toml import parse_toml
from macrofit.scene import build_scene, scene_names

MAINS = {"macrofit": macrofit.cli.main, "macrofit-meso": meso.cli.main, "macrofit-surrogate": surrogate.cli.main}
PACKAGES = {"macrofit": "macrofit", "macrofit-meso": "meso", "macrofit-surrogate": "surrogate"}
COMPLAINT = re.compile(r"^(?:macrofit[\w-]*|Error): (?!warning)", re.MULTILINE)
LIBRARY = Path(macrofit.scene.__file__).parent / "library"
PRESS = "Displacement [mm];Force [kN]\n" + "".join(f"{s};{max(0.0, s - 10.0) * 5.0}\n" for s in range(0, 191))
"""A record such as a reader has: 900 kN at the end of 180 mm of contact."""


SCAN = r"\b(?:seat\.sur|bore\d?\.x3p|b\d\.csv)"
"""Files of measured surfaces that a page takes for granted: a strip of the seat, and patches of the bore."""


def scan(name: str) -> bytes:
    """What a profilometer makes of a strip or a patch, in the format that the name says."""
    strip = name.startswith("seat")
    spacing = (0.05, 0.05) if strip else (0.02, 0.02)
    heights = scans.textured(np.random.default_rng(3), (3800, 20) if strip else (60, 60), spacing)
    return scans.WRITERS[f"a{Path(name).suffix}"](heights, spacing)


class Reader:
    """Somebody who types what a page says, in a folder of his own."""

    def __init__(self, page: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        self.page, self.patch = page, monkeypatch
        self.exports: dict[str, str] = {}
        self.names: dict[str, Any] = {"__name__": "__main__"}
        self.blocks = pages.blocks(page)
        Path("press.csv").write_text(PRESS)
        for name in {*re.findall(SCAN, page.read_text())}:
            Path(name).write_bytes(scan(name))

    def read(self) -> None:
        """Take up every file that the page shows, then do what it says."""
        for block in self.blocks:
            if block.title:
                Path(block.title).write_text(block.text)
        for block in self.blocks:
            if block.language == "toml":
                self.understand(block)
        for block in self.blocks:
            if block.language == "sh" and not block.not_run:
                for words in pages.commands(block.text):
                    self.type(words)
            elif block.language == "python":
                self.execute(block)

    def execute(self, block: pages.Block) -> None:
        """A script, with scenes and settings that are read in little."""
        with self.patch.context() as patch:
            patch.setattr(macrofit.scene, "load_scene", in_little(macrofit.scene.load_scene, pages.SHORT_KEYS))
            patch.setattr(meso.settings, "load", in_little(meso.settings.load, pages.LIGHT_KEYS))
            exec(compile(block.text, f"{self.page.name}:{block.line}", "exec"), self.names)

    def understand(self, block: pages.Block) -> None:
        """A scene, a part of one, a standard, or the entry point of a provider."""
        tables = tomllib.loads(block.text)
        if "project" in tables:
            self.install(tables["project"]["entry-points"]["macrofit.friction"])
        elif any("known" in str(table) for table in tables.values()):
            Path("my.toml").write_text(block.text)
            load_standard("my.toml")
        elif set(tables) <= set(meso.settings.Settings.__struct_fields__):
            Path("settings.toml").write_text(block.text)
            meso.settings.load("settings.toml")
        else:
            whole = {} if "wheel" in tables and "seat_radius" in tables.get("axle", {}) else wheelset()
            build_scene(merged(whole, tables))

    def install(self, entry_points: dict[str, str]) -> None:
        """What an installer writes of a module that the page shows."""
        info = Path("of_the_page-1.0.dist-info")
        info.mkdir()
        (info / "METADATA").write_text("Metadata-Version: 2.1\nName: of_the_page\nVersion: 1.0\n")
        lines = [f"{name} = {target}\n" for name, target in entry_points.items()]
        (info / "entry_points.txt").write_text("[macrofit.friction]\n" + "".join(lines))
        for target in entry_points.values():
            module, kind = target.split(":")
            (source,) = (block.text for block in self.blocks if f"class {kind}(" in block.text)
            Path(f"{module}.py").write_text(source)
            self.patch.delitem(sys.modules, module, raising=False)
        self.patch.syspath_prepend(str(Path.cwd()))
        importlib.invalidate_caches()

    def type(self, words: list[str]) -> None:
        """One command."""
        if words[0] == "export":
            self.exports |= dict(word.split("=", 1) for word in words[1:])
        elif words[0] == ".":
            assert words[1:] == [".venv/bin/activate"]
        elif words[0] == "make":
            makefile = (pages.ROOT / "Makefile").read_text()
            for target in (word for word in words[1:] if "=" not in word):
                assert re.search(rf"^{target}:", makefile, re.MULTILINE), words
        elif words[:3] == ["python", "-m", "tests.benchmarks"]:  # each runs in its toy size in make bench-check
            assert words[3] in benchmarks.names(), words
        elif words[0] == "mpirun":
            self.launch(words)
        else:
            assert words[0] in MAINS, words
            self.run(words)

    def run(self, words: list[str]) -> None:
        """A command of macrofit, in this process: what is imported once is there for all."""
        if words[:2] == ["macrofit", "judge"] and words[2] in scene_names() and not Path(words[2]).exists():
            self.run(["macrofit", "run", words[2]])
        done = CliRunner().invoke(MAINS[words[0]], pages.toy(words)[1:])
        told = f"{self.page.name}: {' '.join(words)}\n{done.output}"
        if done.exception is not None and not isinstance(done.exception, SystemExit):
            raise AssertionError(told) from done.exception
        assert done.exit_code == 0 or (words[1] == "judge" and not COMPLAINT.search(done.output)), told

    def launch(self, words: list[str]) -> None:
        """A command under mpirun; where the page says how to set it up, with nothing but that."""
        ranks, program, rest = words[2], words[3], words[3:]
        environment = {k: v for k, v in alone().items() if not k.startswith(("OMPI_", "PRTE_"))}
        if not self.exports:
            environment = launcher_environment()
        elif (os.cpu_count() or 1) < int(ranks):
            environment |= {
                "OMPI_MCA_rmaps_base_oversubscribe": "1",
                "PRTE_MCA_rmaps_default_mapping_policy": ":oversubscribe",
            }
        command = [
            "timeout",
            "250",
            "mpirun",
            "-n",
            ranks,
            sys.executable,
            "-m",
            PACKAGES[program],
            *pages.toy(rest)[1:],
        ]
        done = subprocess.run(
            command, env=environment | self.exports, stdin=subprocess.DEVNULL, capture_output=True, text=True
        )
        assert done.returncode == 0, f"{self.page.name}: {' '.join(words)}\n{done.stdout}{done.stderr}"


def wheelset() -> dict[str, Any]:
    """The built-in scene, to which the part of a scene is added."""
    tables = parse_toml((LIBRARY / "wheelset.toml").read_text(), "wheelset")
    del tables["friction"]
    return tables


def merged(whole: dict[str, Any], part: dict[str, Any]) -> dict[str, Any]:
    """Tables with those of a part in them."""
    both = [key for key in part if isinstance(part[key], dict) and isinstance(whole.get(key), dict)]
    return whole | part | {key: merged(whole[key], part[key]) for key in both}


def in_little(load: Callable[..., Any], more: Sequence[str]) -> Callable[..., Any]:
    """A function that loads settings, with these set too."""
    return lambda source, overrides=(), *rest: load(source, [*overrides, *more], *rest)


@pytest.mark.slow
@pytest.mark.parametrize("page", [page for page in pages.PAGES if page != pages.BOOK], ids=lambda page: page.stem)
def test_what_a_page_says_runs(page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    Reader(page, monkeypatch).read()


def test_a_law_in_a_script_is_the_one_that_is_used() -> None:
    """The friction law that the page on scripts tries, on the small press."""
    (block,) = (block for block in pages.blocks(pages.ROOT / "docs" / "python.md") if "class Step" in block.text)
    found: dict[str, Any] = {"__name__": "__main__", "scene": small_press()}
    exec(block.text.replace('load_scene("wheelset")', "scene"), found)
    assert found["solution"].scene.friction.provider == "__main__:Step"
    friction = found["solution"].increments[-1].facets.friction
    assert friction.min() >= 0.0
    assert np.isclose(friction.max(), 0.12)


def test_a_block_that_is_not_run_says_why() -> None:
    """Few are left out, and no reason stands where no block follows."""
    reasons = [block.not_run for page in pages.PAGES for block in pages.blocks(page) if block.not_run]
    assert all(len(reason) > 20 for reason in reasons)
    assert len(reasons) == sum(len(re.findall(r"^<!-- no run", page.read_text(), re.MULTILINE)) for page in pages.PAGES)
    assert len(reasons) <= 7


def test_the_first_page_is_one_page() -> None:
    assert len((pages.ROOT / "README.md").read_text().splitlines()) <= 120
