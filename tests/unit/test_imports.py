"""What is loaded, and by whom: nothing heavy before it is used, and a friction contract that stands alone."""

from __future__ import annotations

import ast
import json
import subprocess
import sys
from importlib.util import find_spec, resolve_name
from pathlib import Path

import pytest

import macrofit

HEAVY = {"dolfinx", "petsc4py", "mpi4py", "torch", "numba", "matplotlib", "gmsh", "scipy", "h5py", "meshio"}
SHOW_LOADED = """
import json, runpy, sys
try:
    {statement}
finally:
    print("\\n" + json.dumps(sorted({{name.partition(".")[0] for name in sys.modules}})))
"""
ALLOWED_IN_FRICTION = {"numpy", "msgspec", "macrofit.base", "macrofit.errors", "macrofit.friction"}


def loaded_by(statement: str) -> set[str]:
    """The top-level modules a fresh interpreter has after a statement."""
    done = subprocess.run(
        [sys.executable, "-c", SHOW_LOADED.format(statement=statement)],
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        check=True,
    )
    return set(json.loads(done.stdout.splitlines()[-1]))


def run_help(module: str) -> str:
    return f"sys.argv[1:] = ['--help']; runpy.run_module({module!r}, run_name='__main__')"


@pytest.mark.parametrize("module", ["macrofit", "meso", "surrogate"])
def test_import_loads_nothing_heavy(module):
    loaded = loaded_by(f"import {module}")
    assert module in loaded
    assert not loaded & (HEAVY | {"numpy", "msgspec", "click", "rich"})


@pytest.mark.parametrize("module", ["macrofit", "meso", "surrogate"])
def test_help_loads_nothing_heavy(module):
    if find_spec(f"{module}.cli") is None:
        pytest.skip(f"{module} has no command line yet")
    loaded = loaded_by(run_help(module))
    assert "click" in loaded
    assert not loaded & HEAVY


def test_judge_loads_nothing_heavy(tmp_path):
    """Nor does it need any: a curve is judged within 0.5 s of CPU (0.2 s are measured by the benchmark `startup`)."""
    path = tmp_path / "press.csv"
    path.write_text("displacement_mm,force_kN\n" + "".join(f"{s},{5.5 * s}\n" for s in range(181)))
    words = ["judge", str(path), "--diameter", "190", "--length", "180"]
    loaded = loaded_by(f"sys.argv[1:] = {words}; runpy.run_module('macrofit', run_name='__main__')")
    assert "numpy" in loaded
    assert not loaded & HEAVY


@pytest.mark.parametrize(("words", "allowed"), [
    (["scenes"], set()),
    (["schema", "verdict"], set()),
    (["init", "hub"], set()),
    (["check", "wheelset"], set()),
    (["check", "wheelset", "-o", "section.svg"], {"matplotlib"}),
])  # fmt: skip
def test_light_commands_load_nothing_heavy(words, allowed, tmp_path, monkeypatch):
    """Their start is that of Python, click, msgspec and numpy; a drawing needs matplotlib and no more."""
    monkeypatch.chdir(tmp_path)
    loaded = loaded_by(f"sys.argv[1:] = {words}; runpy.run_module('macrofit', run_name='__main__')")
    assert not loaded & (HEAVY - allowed)


def imported_modules(path: Path, package: str) -> set[str]:
    """The full names a file of a package imports, wherever in the file."""
    names: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            source = resolve_name("." * node.level + (node.module or ""), package)
            names |= {f"{source}.{alias.name}" for alias in node.names}
    return names


def test_the_friction_contract_imports_numpy_and_msgspec_only():
    files = sorted((Path(macrofit.__file__).parent / "friction").glob("*.py"))
    for path in files:
        for name in imported_modules(path, "macrofit.friction"):
            standard = name.partition(".")[0] in sys.stdlib_module_names
            allowed = any(f"{name}.".startswith(f"{prefix}.") for prefix in ALLOWED_IN_FRICTION)
            assert standard or allowed, f"{path.name} imports {name}"
