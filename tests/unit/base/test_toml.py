"""Whatever is written as TOML is read back equal; overrides reach every key."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from macrofit.base.toml import (
    TomlError,
    dump_toml,
    join_key,
    last_part,
    parse_toml,
    read_toml,
    set_key,
    split_override,
    unknown_key,
)

texts = st.text(st.characters(exclude_categories=["Cs"]), max_size=12)
"""Any characters, those of control included; lone surrogates are not Unicode text."""
scalars = st.one_of(
    st.booleans(), st.integers(-(2**63), 2**63 - 1), st.floats(allow_nan=False), texts
)  # fmt: skip
values = st.recursive(
    scalars,
    lambda inner: st.one_of(st.lists(inner, max_size=4), st.dictionaries(texts, inner, max_size=4)),
    max_leaves=12,
)
tables = st.dictionaries(texts, values, max_size=6)


def same(a: Any, b: Any) -> bool:
    """Equal, and of the same types: 1 is not 1.0, and -0.0 is not 0.0."""
    if isinstance(a, dict):
        return isinstance(b, dict) and list(a) == list(b) and all(same(a[key], b[key]) for key in a)
    if isinstance(a, list):
        return isinstance(b, list) and len(a) == len(b) and all(map(same, a, b))
    if isinstance(a, float):
        return isinstance(b, float) and a == b and math.copysign(1.0, a) == math.copysign(1.0, b)
    return type(a) is type(b) and a == b


def in_toml_order(table: dict[str, Any]) -> Any:
    """Keys of values before those of tables, as TOML has to write them."""
    return sorted(table)


@settings(deadline=None)
@given(tables)
def test_what_is_written_is_read_back(table: dict[str, Any]) -> None:
    back = parse_toml(dump_toml(table), "test")
    assert in_toml_order(back) == in_toml_order(table)
    assert all(same_but_for_order(table[key], back[key]) for key in table)


def same_but_for_order(a: Any, b: Any) -> bool:
    if isinstance(a, dict):
        return isinstance(b, dict) and a.keys() == b.keys() and all(same_but_for_order(a[key], b[key]) for key in a)
    if isinstance(a, list):
        return isinstance(b, list) and len(a) == len(b) and all(map(same_but_for_order, a, b))
    return same(a, b)


@settings(deadline=None)
@given(st.lists(texts, min_size=1, max_size=4), scalars)
def test_an_override_reaches_any_key(path: list[str], value: Any) -> None:
    """Keys that need quotes included."""
    written = dump_toml({"v": value}).removeprefix("v = ").strip()
    found, parsed = split_override(f"{join_key(path)}={written}")
    assert found == tuple(path)
    assert same(parsed, value)
    table: dict[str, Any] = {}
    set_key(table, found, parsed)
    for part in path:
        table = table[part]
    assert same(table, value)


@pytest.mark.parametrize(
    ("text", "path", "value"),
    [
        ("motion.travel=20", ("motion", "travel"), 20),
        (" motion . travel = 20.5 ", ("motion", "travel"), 20.5),
        ("friction.provider=dem", ("friction", "provider"), "dem"),
        ("title=a = b", ("title",), "a = b"),
        ("title=", ("title",), ""),
        ('friction.options."a.b"=[1, 2]', ("friction", "options", "a.b"), [1, 2]),
        ('"a=b"=3', ("a=b",), 3),
        ("friction.options={ seed = 1 }", ("friction", "options"), {"seed": 1}),
        ("title=x\ny=1", ("title",), "x\ny=1"),
        ("a=1 # one", ("a",), 1),
    ],
)
def test_overrides(text: str, path: tuple[str, ...], value: Any) -> None:
    assert split_override(text) == (path, value)


@pytest.mark.parametrize("text", ["", "motion.travel", "=3", "a b=3", "a..b=3", ".a=3", "# a=3"])
def test_what_is_no_override_is_said(text: str) -> None:
    with pytest.raises(TomlError, match=r"an override is written key=value, for example load\.pressure=100"):
        split_override(text, "load.pressure=100")


def test_a_value_is_no_table() -> None:
    with pytest.raises(TomlError, match=r"title\.x: 'title' is not a table"):
        set_key({"title": "t"}, ("title", "x"), 1)


def test_the_nearest_key_is_named() -> None:
    assert unknown_key("mesh.ordr", ["order", "growth"]) == "mesh.ordr: unknown key (did you mean 'order'?)"
    assert unknown_key("mesh.x", ["order", "growth"]) == "mesh.x: unknown key (known keys: order, growth)"


@pytest.mark.parametrize("text", ["a = ", "a = [" * 5000, "a = 1\na = 2"])
def test_what_is_not_toml_names_its_source(text: str) -> None:
    with pytest.raises(TomlError, match=r"^scene\.toml: not valid TOML: "):
        parse_toml(text, "scene.toml")


@pytest.mark.parametrize("again", ["[wheel.material]\nyoungs_modulus = 7e4", "wheel.material = 1"])
def test_a_table_in_braces_is_closed(again: str) -> None:
    with pytest.raises(TomlError, match=r"; a table in braces is closed: write all of its keys inside of them$"):
        parse_toml("wheel = { bore_radius = 1.0 }\n" + again, "scene.toml")


def test_a_decimal_comma_is_said() -> None:
    with pytest.raises(TomlError, match=r"; write -90\.125 with a decimal point$"):
        parse_toml("[axle]\nlist = [1,2]\nseat_radius = -90,125  # drawing 7\n", "scene.toml")
    with pytest.raises(TomlError) as caught:
        parse_toml("a = [1,2]\nb = \n", "scene.toml")
    assert "decimal" not in str(caught.value)


@pytest.mark.parametrize(
    ("key", "last"), [("motion.travel", "travel"), ('friction.options."a.b"', "a.b"), ("a b", "a b")]
)
def test_the_last_part_of_a_key(key: str, last: str) -> None:
    assert last_part(key) == last


@pytest.mark.parametrize("line", [b"a = 1\n", b"a = 1\r\n", b""])
def test_a_byte_order_mark_is_no_mistake(tmp_path: Path, line: bytes) -> None:
    path = tmp_path / "scene.toml"
    path.write_bytes(b"\xef\xbb\xbf" + line)
    assert read_toml(path) == ({"a": 1} if line else {})


DEEP = {
    "lists": f"a = {'[' * 100_000}", "closed lists": f"a = {'[' * 60}{']' * 60}", "tables": f"{'a.' * 3000}a = 1",
    "headers": f"[{'a.' * 3000}a]\nb = 1", "inline": f"a = {'{a = ' * 60}1{'}' * 60}",
}  # fmt: skip


@pytest.mark.parametrize("kind", DEEP)
def test_what_is_nested_too_deeply_is_said(kind: str) -> None:
    with pytest.raises(TomlError, match="nested too deeply, more than 50"):
        parse_toml(DEEP[kind], "test")


def test_numbers_of_any_length_are_one_line() -> None:
    with pytest.raises(TomlError, match=r"not valid TOML: .*digits"):
        parse_toml(f"a = {'1' * 100_000}", "test")
    assert split_override(f"a={'1' * 100_000}") == (("a",), "1" * 100_000)
    with pytest.raises(TomlError, match="nested too deeply"):
        split_override(f"a={'[' * 60}{']' * 60}")
