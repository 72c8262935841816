"""The code keeps the bars it is measured by, and the measures see what they are to see."""

from __future__ import annotations

from pathlib import Path

import pytest
from code_measures import MEASURES, Measure, measures

GOOD = '''"""A module that keeps every bar."""

import typing
from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class Wide:
    """Five fields that are named by whoever makes it."""

    a: int
    """The first of the five fields."""
    b: int
    c: int
    d: int
    e: int


def doubled(a: int) -> int:
    """Twice the number that is given."""
    return 2 * a
'''
LONG = "def long() -> None:\n    '''Far too long a function.'''\n" + 59 * "    a = 1\n"
KERNEL = "@njit(cache=True)\ndef long(a):\n    '''A kernel, which may be long.'''\n" + 70 * "    a = 1\n"
TUPLE = "class Five(NamedTuple):\n    '''Five fields without names.'''\n" + "".join(f"    {c}: int\n" for c in "abcde")


@pytest.fixture(scope="module")
def found() -> dict[str, Measure]:
    return {measure.what: measure for measure in measures()}


@pytest.mark.parametrize("what", MEASURES)
def test_the_code_keeps_its_bar(what: str, found: dict[str, Measure]) -> None:
    measure = found[what]
    assert measure.kept, f"{measure.values}, bar {measure.bar}:\n" + "\n".join(measure.places)


def of_tree(root: Path, **files: str) -> dict[str, Measure]:
    """Measures of three small packages; ``files`` are modules of macrofit, with __ for the folder's mark."""
    for package in ("macrofit", "meso", "surrogate", "tests"):
        (root / package).mkdir()
        (root / package / "__init__.py").write_text('"""A package with nothing in it."""\n')
        (root / package / "good.py").write_text(GOOD)
    for name, text in files.items():
        path = (root / "macrofit").joinpath(*name.split("__")).with_suffix(".py")
        path.parent.mkdir(exist_ok=True)
        path.write_text(text)
    return {measure.what: measure for measure in measures(root)}


def missed(root: Path, **files: str) -> list[str]:
    return [what for what, measure in of_tree(root, **files).items() if not measure.kept]


def test_good_code_keeps_every_bar(tmp_path: Path) -> None:
    assert missed(tmp_path, kernel=GOOD + KERNEL) == []


@pytest.mark.parametrize(
    ("what", "text"),
    [
        ("functions over 60 lines, kernels excepted", LONG),
        ("modules over 500 lines, those of kernels excepted", "a = 1\n" * 501),
        ("functions fully annotated, kernels excepted", "def f(a) -> None:\n    '''Without a type.'''\n"),
        ("functions fully annotated, kernels excepted", "def f(a: int):\n    '''Without a type.'''\n"),
        ("public modules, classes and functions documented", "class A:\n    def f(self) -> None: ...\n"),
        ('docstrings that begin with "Of" or are under 14 letters', "'''Of all modules the worst.'''\n"),
        ('docstrings that begin with "Of" or are under 14 letters', "class A:\n    a: int = 1\n    '''mu [-].'''\n"),
        ("records of 5 fields and more made by position", GOOD.replace(", kw_only=True", "")),
        ("records of 5 fields and more made by position", TUPLE + "Five(1, 2, 3, 4, 5)\n"),
        ("median function [lines]", "\n".join(LONG.replace("def long", f"def f{k}")[:-500] for k in range(9))),
    ],
)
def test_what_misses_a_bar_is_seen(what: str, text: str, tmp_path: Path) -> None:
    assert what in missed(tmp_path, bad=text)


def test_a_named_tuple_made_by_name_is_kept(tmp_path: Path) -> None:
    assert missed(tmp_path, five=f'"""A record made by name."""\n{TUPLE}Five(a=1, b=2, c=3, d=4, e=5)\n') == []


def test_circles_are_seen_inside_functions_but_not_where_types_alone_need_them(tmp_path: Path) -> None:
    head = '"""One of a few modules."""\n'
    late = f"{head}def f() -> None:\n    '''Import one of a room.'''\n    from macrofit.room.b import g\n"
    types = f"{head}from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    from . import a\n"
    seen = of_tree(tmp_path, a=late, room__b=f"{head}from . import c\n", room__c=f"{head}from ..a import f\n", d=types)
    assert seen["import circles of modules"].places == ("macrofit.a <-> macrofit.room.b <-> macrofit.room.c",)
    assert seen["import circles of rooms"].places == ("macrofit.a <-> macrofit.room",)


def test_too_many_files_at_the_top_are_seen(tmp_path: Path) -> None:
    files = {f"file{k}": GOOD for k in range(17)}
    assert "files flat at the top" in missed(tmp_path, **files)
