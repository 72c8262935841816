"""The kinds of files that the software writes and reads back: a sound one of each, and its content as plain bytes."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import scipy.sparse as sp
import torch

from macrofit.bodies.discretisation import Discretisation
from macrofit.bodies.kept import keep_mesh, kept_mesh
from macrofit.bodies.stiffness import keep_stiffness, kept_stiffness
from macrofit.bodies.triangles import MeshData
from macrofit.results.encoding import encode
from macrofit.results.journal import Journal
from macrofit.study.fields import fields_file, load_fields, save_fields
from macrofit.study.plan import PlannedRun
from macrofit.study.record import RunRecord, StudyFile
from meso.coefficient_cache import CoefficientCache, Entry, code
from meso.packing.cache import flat_packing
from meso.packing.pack import Packing
from meso.settings import Settings
from surrogate.data.database import Database, Header, content_hash, open_database, read_database
from surrogate.data.journal import journal_of
from surrogate.data.samples import Samples
from surrogate.data.table import read_table, write_table
from surrogate.network.checkpoint import load_checkpoint
from surrogate.network.resume import TrainingState

from ..fakes import fake_increment, fake_scene, fake_solution
from ..untrained import untrained
from ._database import TOY, made_up

Content = list[bytes] | None
"""What a file holds, piece by piece; None where it is as good as none and what it held is made anew."""
HEADER = Header(
    design=json.dumps({"seed": 0, "levels": [3, 4]}),
    settings='title = "Two"\n\n[surface]\nform = "tiles"\n\n[plates]\nspheres = 500\n',
    code="c0de",
    version="0.1.0",
    micro_frictions=2,
    squares=2,
    points=5,
)
SAMPLES = 120
"""About a chunk of a database."""
KEY = "the training of a benchmark"
DIGEST = "0" * 64
CORNERS = np.array([[0, 1, 2]])
PACKING = (300, (1.0, 1.0), 0.4, 1)


@dataclass(frozen=True)
class Kind:
    """How a sound file is made in an empty folder, and how one is read."""

    make: Callable[[Path], Path]
    read: Callable[[Path], Content]
    grows: bool = False
    """Whether one that is cut is what a kill leaves, whose last pieces are computed anew."""


def make_run_journal(folder: Path) -> Path:
    path = folder / "journal.bin"
    with Journal.start(path, fake_scene()) as journal:
        for k in range(6):
            journal.append(fake_increment(k, 2.0 * k, 1e5 * k), {"kappa": np.arange(9.0) / 7.0, "kind": np.arange(9)})
    return path


def read_run_journal(path: Path) -> Content:
    with Journal.resume(path, fake_scene()) as journal:
        return [encode(record, state) for record, state in journal.records()]


def make_study(folder: Path) -> Path:
    path = folder / "study.bin"
    study = StudyFile(path, replace=True)
    for k in range(5):
        study.append(RunRecord.of(f"{k:064d}", fake_solution(force=1e5 * (k + np.linspace(0.0, 1.0, 10))), 1.0 / 3.0))
    study.close()
    return path


def read_study(path: Path) -> Content:
    study = StudyFile(path, replace=False)
    study.close()
    return [msgspec.msgpack.encode(record) for record in study.records.values()]


def make_fields(folder: Path) -> Path:
    save_fields(folder, DIGEST, fake_solution())
    return fields_file(folder, DIGEST)


def read_fields(path: Path) -> Content:
    run = PlannedRun(number=1, label="", values={}, scene=fake_scene(), digest=DIGEST)
    found = load_fields(path.parent.parent, run)
    return [
        f"{place} {body} {part.name}".encode() + plain(getattr(field, part.name))
        for place, bodies in found.items()
        for body, field in bodies.items()
        for part in fields(field)
    ]


def make_coefficient(folder: Path) -> Path:
    settings = Settings()
    cache = CoefficientCache(folder, settings)
    cache.keep(
        Entry(
            coefficient=0.0711 / 3.0, uncertainty=1e-3 / 7.0, mean_normal=170.0 / 3.0, mean_tangential=12.0 / 7.0,
            engine="quasi-static", remark="", imbalance=1e-5, unconverged_increments=0, largest_residual=1e-9,
            settings=settings, code=code(), version="0.1.0",
        )
    )  # fmt: skip
    return cache.file(settings)


def read_coefficient(path: Path) -> Content:
    entry = CoefficientCache(path.parents[3], Settings()).find(Settings())
    return None if entry is None else [msgspec.json.encode(entry)]


def packed(cache: Path) -> Packing:
    """The packing, from this cache or made and kept there."""
    os.environ["MACROFIT_CACHE"] = str(cache)
    flat_packing.cache_clear()
    return flat_packing(*PACKING)


def make_packing(folder: Path) -> Path:
    packed(folder)
    (path,) = (folder / "packings").iterdir()
    return path


def read_packing(path: Path) -> Content:
    packing = packed(path.parents[1])
    return [plain(packing.centres), plain(packing.radii)]


def make_mesh(folder: Path) -> Path:
    edges = {"seat": np.array([[0, 1]]), "held": np.array([[1, 2]])}
    path = folder / "meshes" / "a.npz"
    keep_mesh(
        path, MeshData(points=np.array([[0.1, 0.0], [1.0 / 3.0, 0.0], [0.0, 0.7]]), triangles=CORNERS, edges=edges)
    )
    return path


def read_mesh(path: Path) -> Content:
    mesh = kept_mesh(path)
    return None if mesh is None else [plain(mesh.points), plain(mesh.triangles), *map(plain, mesh.edges.values())]


def make_stiffness(folder: Path) -> Path:
    space = Discretisation(
        order=1,
        nodes=np.array([[0.1, 0.0], [1.0 / 3.0, 0.0], [0.0, 0.7]]),
        cells=CORNERS,
        edges={"seat": np.array([[0, 0, 1]])},
        stiffness=sp.csr_matrix(np.cos(np.arange(36.0)).reshape(6, 6)),
    )
    path = folder / "stiffness" / "a.npz"
    keep_stiffness(path, space)
    return path


def read_stiffness(path: Path) -> Content:
    space = kept_stiffness(path, 1)
    if space is None:
        return None
    K = space.stiffness
    arrays = [space.nodes, space.cells, K.data, K.indices, K.indptr, *space.edges.values()]
    return [repr(K.shape).encode(), *map(plain, arrays)]


def rows() -> list[bytes]:
    """Samples of numbers without a short form."""
    made = np.zeros(SAMPLES, HEADER.row())
    rng = np.random.default_rng(1)
    for name in made.dtype.names or ():
        if made[name].dtype.kind == "f":
            made[name] = rng.standard_normal(made[name].shape)
    made["id"], made["engine"], made["remark"] = np.arange(SAMPLES), b"quasi-static", b"no equilibrium"
    return [row.tobytes() for row in made]


def make_database(folder: Path) -> Path:
    path = folder / "samples.h5"
    with open_database(path, HEADER) as (writer, _):
        for row in rows():
            writer.append(row)
        writer.fail(SAMPLES, "the plates do not touch")
    return path


def make_database_journal(folder: Path) -> Path:
    path = folder / "samples.h5"
    with suppress(KeyboardInterrupt), open_database(path, HEADER) as (writer, _):
        for row in rows():
            writer.append(row)
        raise KeyboardInterrupt
    return journal_of(path)


def read_samples(path: Path) -> Content:
    found = read_database(path)
    columns = [getattr(found.samples, field.name) for field in fields(Samples)]
    samples = [b"".join(plain(column[k]) for column in columns) for k in range(len(found.samples))]
    return [msgspec.json.encode(found.header), msgspec.json.encode(sorted(found.failures.items())), *samples]


def make_table(folder: Path) -> Path:
    samples, path = made_up(4), folder / "samples.csv"
    write_table(Database(TOY, samples, {}, content_hash(samples)), path)
    return path


def read_table_of(path: Path) -> Content:
    found = read_table(path)
    columns = [plain(getattr(found.samples, field.name)) for field in fields(Samples)]
    return [msgspec.json.encode(found.header), found.content_hash.encode(), *columns]


def make_network(folder: Path) -> Path:
    return Path(untrained(folder / "network.safetensors"))


def read_network(path: Path) -> Content:
    model, provenance = load_checkpoint(path)
    return [msgspec.json.encode(provenance), *tensors_of(dict(model.state_dict()))]


def make_state(folder: Path) -> Path:
    path = folder / "state"
    TrainingState(path, KEY).write(
        {"generator": torch.arange(64, dtype=torch.uint8), "model.weight": torch.linspace(-1.0, 1.0, 350)}
    )
    return path


def read_state(path: Path) -> Content:
    state = TrainingState(path, KEY).read()
    return None if state is None else tensors_of(state)


def tensors_of(tensors: dict[str, torch.Tensor]) -> list[bytes]:
    """Names and values."""
    return [name.encode() + plain(value.numpy()) for name, value in sorted(tensors.items())]


def plain(array: Any) -> bytes:
    """Type, shape and bytes of an array."""
    array = np.asarray(array)
    return f"{array.dtype.str} {array.shape} ".encode() + array.tobytes()


KINDS: dict[str, Kind] = {
    "journal of a run": Kind(make_run_journal, read_run_journal, grows=True),
    "journal of a study": Kind(make_study, read_study, grows=True),
    "fields of a study": Kind(make_fields, read_fields),
    "coefficient of `dem`": Kind(make_coefficient, read_coefficient),
    "packing": Kind(make_packing, read_packing),
    "mesh of a drawing": Kind(make_mesh, read_mesh),
    "stiffness of a body": Kind(make_stiffness, read_stiffness),
    "database": Kind(make_database, read_samples),
    "journal of a database": Kind(make_database_journal, lambda path: read_samples(path.with_suffix("")), grows=True),
    "table of samples": Kind(make_table, read_table_of),
    "network": Kind(make_network, read_network),
    "state of a training": Kind(make_state, read_state),
}
