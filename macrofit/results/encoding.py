"""Increments as bytes that give the numbers back to the bit.

An array is its type, shape and bytes. The container is MessagePack; nothing is ever unpickled.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from typing import Any

import msgspec
import numpy as np

from ..base.arrays import FloatArray, IntArray
from ..solution import FacetState, Increment

State = dict[str, FloatArray | IntArray]
"""Arrays the solver needs to go on after an increment."""

_CAST = {"float": float, "int": int, "bool": bool}
_SCALARS = {item.name: _CAST[str(item.type)] for item in fields(Increment) if item.name != "facets"}


class PackedArray(msgspec.Struct, array_like=True):
    """An array as its type, shape and bytes."""

    dtype: str
    shape: tuple[int, ...]
    data: bytes


class _Record(msgspec.Struct, array_like=True):
    scalars: dict[str, bool | int | float]
    facets: dict[str, PackedArray]
    state: dict[str, PackedArray]


_DECODER = msgspec.msgpack.Decoder(_Record)


def encode(record: Increment, state: Mapping[str, FloatArray | IntArray]) -> bytes:
    """An increment and the state after it. Raises TypeError for an array that is not of numbers."""
    scalars = {name: cast(getattr(record, name)) for name, cast in _SCALARS.items()}
    facets = {item.name: getattr(record.facets, item.name) for item in fields(FacetState)}
    return msgspec.msgpack.encode(_Record(scalars, packed(facets), packed(state)))


def decode(content: bytes) -> tuple[Increment, State]:
    """What `encode` was given. Raises ValueError for anything else."""
    try:
        record = _DECODER.decode(content)
        scalars: dict[str, Any] = {name: cast(record.scalars[name]) for name, cast in _SCALARS.items()}
        facets: dict[str, Any] = unpacked(record.facets)
        return Increment(**scalars, facets=FacetState(**facets)), unpacked(record.state)
    except (msgspec.MsgspecError, TypeError, KeyError) as error:
        raise ValueError(f"not an increment: {error}") from None


def packed(arrays: Mapping[str, FloatArray | IntArray]) -> dict[str, PackedArray]:
    """Named arrays as bytes. Raises TypeError for one that is not of numbers."""
    found = {}
    for name, values in arrays.items():
        array = np.asarray(values)
        if array.dtype.kind not in "biuf":
            raise TypeError(f"array '{name}' is of {array.dtype}, not of numbers")
        found[name] = PackedArray(array.dtype.str, array.shape, array.tobytes())
    return found


def unpacked(arrays: Mapping[str, PackedArray]) -> State:
    """The inverse of `packed`. Raises ValueError for bytes that are no such array."""
    # frombuffer gives views that cannot be written, and the solver may change its state in place
    return {
        name: np.frombuffer(item.data, dtype=np.dtype(item.dtype)).reshape(item.shape).copy()
        for name, item in arrays.items()
    }
