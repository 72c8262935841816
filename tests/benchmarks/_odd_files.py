"""Networks, databases and journals of strangers from a seed: damaged, or made otherwise with check sums that fit."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import msgspec
import numpy as np
import safetensors.torch
import torch

from macrofit.base.errors import OutputError
from macrofit.base.log import frame, frames
from macrofit.results import journal as runs
from macrofit.study import record as studies
from surrogate.data import journal
from surrogate.data.seal import seal
from surrogate.network import checkpoint

from ..fuzz import Case, damage
from ._kept_files import KINDS, Content

Forge = Callable[[np.random.Generator, Path], bytes]
ODD: tuple[Any, ...] = (
    0,
    -1,
    99,
    2**63 - 1,
    np.nan,
    "",
    "x" * 300,
    "{}",
    [1.0, np.inf],
    b"\xff\xfe",
    np.complex128(1j),
)
"""Values of attributes and columns."""


def kept_cases(name: str, folder: Path) -> Callable[[np.random.Generator], Case]:
    """What makes the cases of a kind of file: damaged ones, and such as another version or program might write."""
    kind, forge = KINDS[name], FORGED.get(name)
    place = folder / name.replace(" ", "_").replace("`", "")
    place.mkdir()
    path = kind.make(place)
    whole, true = path.read_bytes(), kind.read(path)

    def case(rng: np.random.Generator) -> Case:
        choice = rng.random()
        if forge is not None and choice < 0.4:
            path.write_bytes(whole)
            return Case(forge(rng, path), told(kind.read), lambda found: True, path=path)
        sound = bool(choice > 0.9)
        data = whole if sound else damage(rng, whole)

        def right(found: Content) -> bool:
            return found == true or (kind.grows and true is not None and found == true[: len(found or [])])

        return Case(data, told(kind.read), right, path=path, sound=sound)

    return case


def told(read: Callable[[Path], Content]) -> Callable[[Path], Content]:
    """A reader whose warning that all is made anew is a refusal, too."""

    def reader(path: Path) -> Content:
        with warnings.catch_warnings(record=True) as said:
            warnings.simplefilter("always")
            found = read(path)
        if said:
            raise OutputError(str(said[0].message))
        return found

    return reader


def forged_frames(magic: bytes) -> Forge:
    """Frames whose check sums are right, with damaged content, in another order, doubled or left out."""

    def forge(rng: np.random.Generator, path: Path) -> bytes:
        contents = [content for content, _ in frames(path.read_bytes(), len(magic))]
        at = int(rng.integers(len(contents)))
        match int(rng.integers(4)):
            case 0:
                contents[at] = damage(rng, contents[at])
            case 1:
                contents[at] = msgspec.msgpack.encode([None, {"x": 1}, 3.0, "x", b"", [[[]]]][int(rng.integers(6))])
            case 2:
                contents.insert(int(rng.integers(len(contents))), contents[at])
            case _:
                del contents[at]
        return magic + b"".join(frame(content) for content in contents)

    return forge


def forged_network(rng: np.random.Generator, path: Path) -> bytes:
    """Other tensors or another provenance, with the digest of these."""
    tensors: dict[str, torch.Tensor] = safetensors.torch.load(path.read_bytes())
    with safetensors.safe_open(path, framework="pt") as file:
        entry = msgspec.json.decode(file.metadata()[checkpoint.ENTRY])
    about = msgspec.json.encode(entry["provenance"])
    name = str(rng.choice(sorted(tensors)))
    match int(rng.integers(6)):
        case 0:
            tensors[name] = torch.full_like(tensors[name], np.nan)
        case 1:
            tensors[name] = tensors[name].reshape(-1)[:1].clone()
        case 2:
            tensors["another"] = tensors.pop(name)
        case 3:
            tensors[name] = tensors[name].to([torch.int64, torch.float16, torch.float64][int(rng.integers(3))])
        case 4:
            about = damage(rng, about)
        case _:
            entry["provenance"]["options"][str(rng.choice(["load", "members", "width", "positions", "stiffness"]))] = [
                0,
                -1,
                10**9,
                0.5,
                [],
                [3.0, 2.0],
                "x",
            ][int(rng.integers(7))]
            about = msgspec.json.encode(entry["provenance"])
    digest = checkpoint.checkpoint_digest({name: each.numpy() for name, each in tensors.items()}, about)
    text = b'{"provenance":' + about + b',"sha256":"' + digest.encode() + b'"}'
    return safetensors.torch.save(tensors, {checkpoint.ENTRY: text.decode(errors="replace")})


def forged_database(rng: np.random.Generator, path: Path) -> bytes:
    """An attribute or a column of another kind, shape or length, or none."""
    odd = ODD[int(rng.integers(len(ODD)))]
    with h5py.File(path, "r+") as file:
        columns = [f"{group}/{name}" for group in ("samples", "failures") for name in file[group]]
        name = str(rng.choice(columns if rng.random() < 0.6 else list(file.attrs)))
        if name in file.attrs:
            file.attrs[name] = odd
        else:
            forge_column(rng, file, name, odd)
    seal(path)
    return path.read_bytes()


def forge_column(rng: np.random.Generator, file: Any, name: str, odd: Any) -> None:
    """Put something else in the place of a column."""
    stored = file[name][:]
    del file[name]
    match int(rng.integers(5)):
        case 0:
            file[name] = odd
        case 1:
            file[name] = stored[:-1]
        case 2:
            file[name] = np.zeros_like(stored)
        case 3:
            file.create_dataset(name, shape=(10**7, *stored.shape[1:]), chunks=True, dtype=stored.dtype)
        case _:
            file.create_group(name)


FORGED: dict[str, Forge] = {
    "journal of a run": forged_frames(runs.MAGIC),
    "journal of a study": forged_frames(studies.MAGIC),
    "journal of a database": forged_frames(journal.MAGIC),
    "network": forged_network,
    "database": forged_database,
}
"""Kinds whose check sums are made to fit."""
