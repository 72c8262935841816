"""TOML: read, changed by ``key=value``, written back. The only reader and writer of it in the three packages."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from .errors import MacrofitError, OutputError, nearest
from .files import read_regular

MOST_BYTES = 10_000_000
"""Size of a TOML file; a scene has a few thousand."""
DEEPEST = 50
"""Tables within tables; a scene has five."""
TOO_DEEP = f"tables or lists nested too deeply, more than {DEEPEST} within one another"


class TomlError(MacrofitError):
    """A text that is not TOML, or an override that is not ``key=value``."""


@contextmanager
def errors_as(kind: type[MacrofitError]) -> Iterator[None]:
    """Let what is wrong with a text or an override be an error of the caller's own tree, with the same words."""
    try:
        yield
    except TomlError as error:
        raise kind(str(error)) from None


def read_toml(path: Path) -> dict[str, Any]:
    """The tables of a file in UTF-8, with or without a byte-order mark.

    Raises:
        TomlError: it cannot be read, or is not TOML.
    """
    try:
        text = read_regular(path, MOST_BYTES).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise TomlError(f"{path}: cannot be read as text: not UTF-8 (byte {error.start}); save it as UTF-8") from None
    except OutputError as error:
        raise TomlError(str(error)) from None
    return parse_toml(text, str(path))


def parse_toml(text: str, source: str) -> dict[str, Any]:
    """The tables of a text; ``source`` names it in a message.

    Raises:
        TomlError: it is not TOML.
    """
    try:
        tables = tomllib.loads(text)
    except RecursionError:
        raise TomlError(f"{source}: not valid TOML: {TOO_DEEP}") from None
    except tomllib.TOMLDecodeError as error:
        raise TomlError(f"{source}: not valid TOML: {error}{_decimal_comma(text)}{_closed_table(str(error))}") from None
    except ValueError:
        raise TomlError(f"{source}: not valid TOML: an integer of thousands of digits") from None
    if depth_of(tables) > DEEPEST:
        raise TomlError(f"{source}: not valid TOML: {TOO_DEEP}")
    return tables


def _decimal_comma(text: str) -> str:
    """A word on the first number that is written with a decimal comma, ``key = 90,125``; empty where there is none."""
    found = re.search(r"^[ \t]*[\w.\"-]+[ \t]*=[ \t]*([-+]?\d+),(\d+)[ \t]*(?:#.*)?$", text, re.MULTILINE)
    return f"; write {found[1]}.{found[2]} with a decimal point" if found else ""


def _closed_table(mistake: str) -> str:
    """A word on a table declared again, as [wheel.material] under wheel = { ... }; empty for another mistake."""
    again = mistake.startswith("Cannot") and ("twice" in mistake or "immutable" in mistake)
    return "; a table in braces is closed: write all of its keys inside of them" if again else ""


def depth_of(value: Any) -> int:
    """How many tables and lists lie within one another at most, counted without recursion; 0 for a plain value."""
    depth, level = 0, [value]
    while level := [item for item in level if isinstance(item, dict | list)]:
        depth += 1
        level = [part for item in level for part in (item.values() if isinstance(item, dict) else item)]
    return depth


def dump_toml(tables: Mapping[str, Any]) -> str:
    """The tables as TOML, which `parse_toml` reads back equal; keys whose value is None are left out."""
    import tomli_w

    return tomli_w.dumps(_without_none(tables))


def split_override(text: str, example: str = "motion.travel=20") -> tuple[tuple[str, ...], Any]:
    """The key of ``key=value``, part by part, and its value: TOML, or else the text as it stands.

    A part of a key that holds a dot or a space is quoted, as in TOML.

    Raises:
        TomlError: there is no ``=``, the key is not one of TOML, the value is a number with a decimal comma, or the
            text is no UTF-8.
    """
    if not text.isascii() and any("\udc80" <= each <= "\udcff" for each in text):
        raise TomlError(f"'{text}': not UTF-8; set the terminal to UTF-8, or write the value in a file")
    written = _split_at_equals(text)
    path = None if written is None else _key_path(written[0])
    if written is None or path is None:
        raise TomlError(f"'{text}': an override is written key=value, for example {example}")
    value = written[1]
    try:
        parsed = tomllib.loads(f"value = {value}")
    except (ValueError, RecursionError):
        if re.fullmatch(r"[-+]?\d+,\d+", value):
            raise TomlError(
                f"'{text}': write {value.replace(',', '.')} with a decimal point, or a list as [{value}]"
            ) from None
        return path, value
    if depth_of(parsed) > DEEPEST or len(path) > DEEPEST:
        raise TomlError(f"'{text[:60]} ...': {TOO_DEEP}")
    return path, parsed["value"] if len(parsed) == 1 else value


def set_key(tables: dict[str, Any], path: Sequence[str], value: Any) -> None:
    """Put a value under a dotted key; tables on the way are made.

    Raises:
        TomlError: a part of the key is no table.
    """
    *parts, last = path
    for part in parts:
        tables = tables.setdefault(part, {})
        if not isinstance(tables, dict):
            raise TomlError(f"{join_key(path)}: '{part}' is not a table")
    tables[last] = value


def join_key(path: Sequence[str]) -> str:
    """A dotted key, its parts quoted where TOML wants it."""
    return ".".join(dump_toml({part: 0}).removesuffix(" = 0\n") for part in path)


def last_part(key: str) -> str:
    """The last part of a dotted key, without its quotes."""
    path = _key_path(key)
    return key if path is None else path[-1]


def unknown_key(key: str, known: Sequence[str]) -> str:
    """What to say of a key that is not there, with the nearest one that is."""
    return f"{key}: unknown key ({nearest(key.rpartition('.')[2], known, 'known keys')})"


def _split_at_equals(text: str) -> tuple[str, str] | None:
    """Key and value of ``key=value``; an ``=`` inside the quotes of a key does not count."""
    place = text.find("=")
    while place >= 0:
        if _key_path(text[:place]) is not None:
            return text[:place], text[place + 1 :].strip()
        place = text.find("=", place + 1)
    return None


def _key_path(text: str) -> tuple[str, ...] | None:
    """The parts of a dotted key; None where it is none."""
    if "\n" in text or "#" in text.split('"')[0].split("'")[0]:
        return None
    try:
        tables: Any = tomllib.loads(f"{text} = 0")
    except (ValueError, RecursionError):
        return None
    path = []
    while isinstance(tables, dict):
        ((part, tables),) = tables.items()
        path.append(part)
    return tuple(path)


def _without_none(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {key: _without_none(item) for key, item in value.items() if item is not None}
    if isinstance(value, list | tuple):
        return [_without_none(item) for item in value]
    return value
