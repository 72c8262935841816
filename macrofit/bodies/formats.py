"""Mesh files by their format: Abaqus decks by `abaqus`, all others through meshio."""

from __future__ import annotations

import io
import resource
import warnings
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from ..base.files import check_regular
from ..errors import MeshError, OutputError
from .abaqus import LARGEST, read_deck
from .gmsh_text import check_text
from .nastran import check_whole, name_properties
from .raw import RawMesh

MaskArray = npt.NDArray[np.bool_]

UNREADABLE = "it is not as its format has it; is it cut off, or its name's ending that of another format?"

ROOM, PER_BYTE = 2**29, 100
"""Memory that reading a file may take [bytes]: in any case, and per byte of the file."""


def read_contents(file: Path, body: str, where: str) -> RawMesh:
    """What a body's file holds, by the reader of its kind; ``where`` begins the message of an error.

    Raises:
        MeshError: it cannot be read.
    """
    try:
        check_regular(file, LARGEST)
        return read_deck(file, where) if file.suffix.lower() == ".inp" else _through_meshio(file, where)
    except OutputError as error:
        raise MeshError(f"mesh.{body}: no file '{file}'" if not file.exists() else f"mesh.{body}: {error}") from None
    except (OSError, MemoryError) as error:
        raise MeshError(f"{where} cannot be read: {error or type(error).__name__}") from None


def _through_meshio(file: Path, where: str) -> RawMesh:
    """The file through meshio; what meshio prints belongs into the message."""
    import meshio

    said = io.StringIO()
    try:
        with redirect_stdout(said), redirect_stderr(said), np.errstate(all="ignore"), _bounded(file), _strict():
            check_text(file)
            check_whole(file)
            mesh = meshio.read(file)
            name_properties(file, mesh, where)
        if "not closed" in said.getvalue():
            raise MeshError(f"{where} cannot be read: it is cut off; write it again")
        return _raw(mesh, where)
    except MeshError:
        raise
    except (Exception, SystemExit) as error:
        printed = said.getvalue().partition("Error: Couldn't read")[0]
        words = " ".join(printed.split()) or (
            "" if isinstance(error, SystemExit | Warning) else " ".join(str(error).split())
        )
        if "gmsh:physical" in words:
            words = "some of its elements are in no group; write the groups alone (in gmsh Mesh.SaveAll = 0)"
        raise MeshError(f"{where} cannot be read: {words[:200] or UNREADABLE}") from None


@contextmanager
def _bounded(file: Path) -> Iterator[None]:
    """No more memory than a file of that size can need: damaged counts ask for any amount."""
    try:
        taken = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    except OSError:
        taken = 0
    soft, hard = resource.getrlimit(resource.RLIMIT_AS)
    allowed = taken + ROOM + PER_BYTE * file.stat().st_size
    if taken == 0 or (soft != resource.RLIM_INFINITY and soft < allowed):
        yield
        return
    resource.setrlimit(resource.RLIMIT_AS, (allowed, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, (soft, hard))


@contextmanager
def _strict() -> Iterator[None]:
    """What numpy cannot read to the end is an error, everything else it warns of is not the user's."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        warnings.filterwarnings("error", message="string or file could not be read")
        yield


def _raw(mesh: Any, where: str) -> RawMesh:
    """What meshio found, with the names of boundaries wherever its formats keep them."""
    raw = RawMesh(points=np.asarray(mesh.points, dtype=np.float64))
    if raw.points.ndim != 2 or raw.points.shape[1] < 2:
        raise MeshError(f"{where} holds no points; is its name's ending that of its format?")
    for k, block in enumerate(mesh.cells):
        data = np.asarray(block.data, dtype=np.int64)
        if block.type in ("triangle", "triangle6", "triangle7"):
            raw.triangles.append(data[:, : 3 if block.type == "triangle" else 6])
        elif block.type in ("quad", "quad8", "quad9"):
            raw.quads.append(data[:, : 4 if block.type == "quad" else 8])
        elif block.type in ("line", "line3"):
            for name, chosen in _names(mesh, k, len(data)):
                raw.lines.setdefault(name, []).append(data[chosen][:, :2])
        elif block.type != "vertex":
            raise MeshError(
                f"{where} holds elements '{block.type}', which are not read; write triangles or quadrilaterals of "
                f"first or second order in the plane x = r, y = z"
            )
    for name, members in getattr(mesh, "point_sets", {}).items():
        raw.nodes.setdefault(name, []).append(np.asarray(members, dtype=np.int64).ravel())
    if "point_tags" in mesh.point_data:
        tags = np.asarray(mesh.point_data["point_tags"])
        for tag, names in getattr(mesh, "point_tags", {}).items():
            for name in names:
                raw.nodes.setdefault(name, []).append(np.flatnonzero(tags == tag))
    raw.others = {name: "elements" for name in [*mesh.field_data, *mesh.cell_sets] if not name.startswith("gmsh:")}
    return raw


def _names(mesh: Any, k: int, count: int) -> list[tuple[str, MaskArray]]:
    """Names of the lines of block k, each with those that bear it: groups, sets, families, arrays of 0 and 1."""
    tags = {key: np.asarray(values[k]) for key, values in mesh.cell_data.items()}
    found: list[tuple[str, MaskArray]] = []
    for name, value in mesh.field_data.items():
        if "gmsh:physical" in tags and np.ravel(value)[1] == 1:
            found.append((name, tags["gmsh:physical"] == np.ravel(value)[0]))
    for name, blocks in mesh.cell_sets.items():
        members = np.asarray([] if blocks[k] is None else blocks[k], dtype=np.int64).ravel()
        found.append((name, np.isin(np.arange(count), members)))
    for tag, names in getattr(mesh, "cell_tags", {}).items():
        found += [(name, tags["cell_tags"] == tag) for name in names if "cell_tags" in tags]
    found += [(name, values != 0) for name, values in tags.items() if values.ndim == 1 and name != "cell_tags"]
    return [(name, chosen) for name, chosen in found if ":" not in name and chosen.any()]
