"""Tables of keys as frozen records: decoded strictly, and what is wrong said in one line that names the key."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from typing import Annotated, Any, TypeAlias, TypeVar

import msgspec

from .errors import MacrofitError
from .toml import unknown_key

Positive: TypeAlias = Annotated[float, msgspec.Meta(gt=0.0)]
NotNegative: TypeAlias = Annotated[float, msgspec.Meta(ge=0.0)]
Table = TypeVar("Table", bound=msgspec.Struct)

BOUNDS = {">": "be above", ">=": "not be below", "<": "be below", "<=": "not exceed"}
"""What a value must do, by the sign of its bound."""

KINDS = {
    "float": "a number", "int": "a whole number", "str": "text", "bool": "true or false", "array": "a list",
    "object": "a table",
}  # fmt: skip
"""What msgspec calls a value, in words of the user's."""


class Keys(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Base of every table: frozen, and an unknown key is an error."""


def told(description: str) -> msgspec.Meta:
    """The description of a key for the schema, with its unit in brackets."""
    return msgspec.Meta(description=description)


class KeyMistake(MacrofitError):
    """A key that is unknown or missing, or a value of another type or out of its bounds."""


def decode_tables(tables: Mapping[str, Any], kind: type[Table], whole: str) -> Table:
    """Plain tables as a record.

    Args:
        tables: as TOML has them.
        kind: the record, its keys annotated with their bounds.
        whole: what the tables are, for a message about all of them.

    Raises:
        KeyMistake: one line, ``table.key: what is wrong (what to try)``.
    """
    _refuse_nan(tables, "")
    try:
        return msgspec.convert(tables, kind)
    except msgspec.ValidationError as error:
        raise KeyMistake(_one_line(error, tables, kind, whole)) from None


def dotted_keys(kind: type[msgspec.Struct]) -> dict[str, list[str]]:
    """Every dotted key of the tables under a record, with its values where these are few."""
    from msgspec import inspect

    found: dict[str, list[str]] = {}
    _gather_keys(inspect.type_info(kind), "", found)
    return found


def _gather_keys(info: Any, where: str, found: dict[str, list[str]]) -> None:
    """Add the keys of the tables that a key may hold, or else the key itself with its values."""
    from msgspec import inspect

    kinds = [_plain(each) for each in getattr(_plain(info), "types", (_plain(info),))]
    tables = [each for each in kinds if isinstance(each, inspect.StructType)]
    for table in tables:
        if table.tag_field is not None:
            found.setdefault(join_keys(where, table.tag_field), []).append(str(table.tag))
        for name, inner in _field_types(table).items():
            _gather_keys(inner, join_keys(where, name), found)
    if tables:
        return
    literals = [value for each in kinds if isinstance(each, inspect.LiteralType) for value in each.values]
    switch = ["true", "false"] if any(isinstance(each, inspect.BoolType) for each in kinds) else []
    values = found.setdefault(where, [])
    values += [value for value in (*map(str, literals), *switch) if value not in values]


def join_keys(where: str, key: str) -> str:
    """The dotted key of a key within a table."""
    return f"{where}.{key}" if where else key


def _refuse_nan(value: Any, where: str) -> None:
    """No NaN or infinity anywhere."""
    if isinstance(value, Mapping):
        for key, item in value.items():
            _refuse_nan(item, join_keys(where, str(key)))
    elif isinstance(value, list | tuple):
        for item in value:
            _refuse_nan(item, where)
    elif isinstance(value, float) and not math.isfinite(value):
        raise KeyMistake(f"{where}: {value} is not a finite number")


def _one_line(error: msgspec.ValidationError, tables: Mapping[str, Any], kind: type[msgspec.Struct], whole: str) -> str:
    """msgspec's message as ``table.key: what is wrong (what to try)``."""
    message, _, place = str(error).partition(" - at `$")
    where = re.sub(r"\[[^]]*\]", "", place.rstrip("`").lstrip("."))
    unknown = re.search(r"unknown field `(.+)`", message)
    missing = re.search(r"missing required field `(.+)`", message)
    bound = re.fullmatch(r"Expected `\w+` (>=?|<=?) (\S+)", message)
    wrong = re.fullmatch(r"Expected `([^`]+)`, got `([^`]+)`", message)
    if unknown:
        return unknown_key(join_keys(where, unknown.group(1)), _known_keys(kind, where, tables))
    if missing:
        return f"{join_keys(where, missing.group(1))}: missing"
    if bound:
        return f"{where}: {_value_at(tables, where)} must {_bound(*bound.groups())}"
    if message.startswith("Invalid value '"):
        choices = ", ".join(map(str, _tags(kind, where, tables)))
        return f"{where}: {message[0].lower()}{message[1:]}" + (f" (one of {choices})" if choices else "")
    if message.startswith("Invalid enum value"):
        value = message.removeprefix("Invalid enum value ")
        return f"{where}: {value} is none of {', '.join(map(str, _choices(kind, where, tables)))}"
    if wrong:
        return f"{where or whole}: must be {_kinds(wrong.group(1))}, not {_kinds(wrong.group(2))}"
    if "of length >= 1" in message:
        return f"{where}: is empty"
    return f"{where or whole}: {message[0].lower()}{message[1:]}"


def _kinds(names: str) -> str:
    """What msgspec calls `int | null`, in words; that the key may be left out helps nobody there."""
    return " or ".join(KINDS.get(name, name) for name in names.split(" | ") if name != "null" or names == "null")


def _bound(sign: str, limit: str) -> str:
    """What a value must do, after "must"."""
    if float(limit) == 0.0 and sign in (">", ">="):
        return "be positive" if sign == ">" else "not be negative"
    return f"{BOUNDS[sign]} {float(limit):g}"


def _value_at(tables: Mapping[str, Any], where: str) -> Any:
    value: Any = tables
    for key in where.split("."):
        value = value[key] if isinstance(value, Mapping) else value
    return value


def _known_keys(kind: type[msgspec.Struct], where: str, tables: Any) -> Sequence[str]:
    """The keys of the table at a dotted place; the tag of a table that may be of several kinds decides."""
    from msgspec import inspect

    info = inspect.type_info(kind)
    for key in filter(None, where.split(".")):
        tables = tables.get(key, {}) if isinstance(tables, Mapping) else {}
        info = _table_info(_field_types(info)[key], tables)
        if info is None:
            return []
    return list(_field_types(info))


def _choices(kind: type[msgspec.Struct], where: str, tables: Any) -> Sequence[Any]:
    """The values that a key may have; none where it may have any."""
    from msgspec import inspect

    info: Any = inspect.type_info(kind)
    *path, last = where.split(".")
    for key in path:
        tables = tables.get(key, {}) if isinstance(tables, Mapping) else {}
        info = _table_info(_field_types(info)[key], tables)
    found = _plain(_field_types(info).get(last)) if info is not None else None
    while isinstance(found, inspect.CollectionType | inspect.VarTupleType):
        found = _plain(found.item_type)
    kinds = [_plain(each) for each in getattr(found, "types", (found,))]
    return [value for each in kinds if isinstance(each, inspect.LiteralType) for value in each.values]


def _tags(kind: type[msgspec.Struct], where: str, tables: Any) -> Sequence[Any]:
    """The values of the key that says of which kind its table is; none where it may have any."""
    from msgspec import inspect

    info: Any = inspect.type_info(kind)
    *path, last = where.split(".")
    for key in path[:-1]:
        tables = tables.get(key, {}) if isinstance(tables, Mapping) else {}
        info = _table_info(_field_types(info)[key], tables)
    found = _plain(_field_types(info).get(path[-1])) if info is not None and path else None
    kinds = [_plain(each) for each in getattr(found, "types", (found,))]
    return [each.tag for each in kinds if isinstance(each, inspect.StructType) and each.tag_field == last]


def _field_types(info: Any) -> dict[str, Any]:
    """Types of the keys of a table."""
    return {field.encode_name: field.type for field in info.fields}


def _plain(info: Any) -> Any:
    """A type without what is said about it."""
    from msgspec import inspect

    while isinstance(info, inspect.Metadata):
        info = info.type
    return info


def _table_info(info: Any, table: Any) -> Any:
    """What msgspec knows of the kind of this table; None where it is none."""
    from msgspec import inspect

    info = _plain(info)
    if isinstance(info, inspect.StructType):
        return info
    if isinstance(info, inspect.DictType):  # of tables alike, whose own names the message does not have
        return _table_info(info.value_type, {})
    if isinstance(info, inspect.CollectionType | inspect.VarTupleType):
        return _table_info(info.item_type, {})
    kinds = [_table_info(kind, table) for kind in getattr(info, "types", ())]
    tagged = [kind for kind in kinds if kind is not None]
    named = [kind for kind in tagged if kind.tag is not None and table.get(kind.tag_field) == kind.tag]
    return next(iter([*named, *tagged]), None)
