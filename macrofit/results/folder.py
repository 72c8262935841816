"""The files of a run: each is written beside its name and then put in place, so that none is ever half there.

A folder belongs to macrofit once it holds a journal; a new run replaces what is in it. Any other folder that
is not empty is refused, so that nothing of the user's is overwritten.
"""

from __future__ import annotations

import math
import tempfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..base.arrays import FloatArray
from ..base.files import append_whole, replacing, write_json, write_text, writing
from ..base.ranks import raise_together
from ..errors import OutputError
from ..scene import Scene, dump_scene
from ..solution import BodyField, FacetState, Increment, PairFrictionMap
from .kinds import RUN, kind_of

if TYPE_CHECKING:
    from mpi4py import MPI

    from ..solution import Solution

JOURNAL, SUMMARY = RUN.mark, RUN.numbers
SCENE, CURVE, INTERFACE, FIELDS = "scene.toml", "fitting_curve.csv", "interface.h5", "fields"
HEADER = (
    "displacement_mm,force_N,normal_force_N,mean_friction,max_pressure_MPa,active_facets,sticking_facets,"
    "newton_iterations,wall_s"
)
FORCE_SD = "force_sd_N"
"""The column after these where the provider of friction states its standard deviation."""
PAGE = "report.html"
"""What `macrofit report` writes; with `--pdf` a file of the same name beside it."""
UNITS = {
    "pressure": "MPa", "traction": "MPa", "gap": "mm", "slip": "mm", "accumulated_slip": "mm",
    "status": "0 open, 1 stick, 2 slip", "friction": "1",
}  # fmt: skip


def prepare(folder: Path, *, owned: bool) -> None:
    """Make the folder and make sure it can be written to.

    Raises:
        OutputError: it is not writable; or it is not empty and, not ``owned``, holds something else.
    """
    with writing(folder):
        folder.mkdir(parents=True, exist_ok=True)
        if not owned and any(folder.iterdir()):
            kind = kind_of(folder)
            if kind is not None:
                raise OutputError(f"{folder}: holds {kind.what}, of {kind.command}; choose another folder with -o")
            raise OutputError(f"{folder}: is not empty and holds no run of macrofit; choose another folder with -o")
        with tempfile.TemporaryFile(dir=folder) as probe:
            probe.write(b"macrofit")


def prepare_for_all(comm: MPI.Comm, folder: Path, mark: str) -> None:
    """As `prepare`, by the first rank; the folder is macrofit's own where a file of this name is in it. Collective.

    Raises:
        OutputError: as `prepare`, on all ranks together.
    """
    with raise_together(comm):
        if comm.rank == 0:
            prepare(folder, owned=(folder / mark).is_file())


def clear(folder: Path) -> None:
    """Remove the results of an earlier run, and nothing else."""
    remove_page(folder)
    with writing(folder):
        for stale in (folder / CURVE, folder / SUMMARY, folder / INTERFACE, *folder.glob("*.png")):
            stale.unlink(missing_ok=True)
        for pattern in ("*.vtu", "*.pvd"):
            for stale in (folder / FIELDS).glob(pattern):
                stale.unlink()


def write_scene(folder: Path, scene: Scene) -> None:
    """The resolved scene, every default written out: scene.toml."""
    write_text(folder / SCENE, dump_scene(scene))


def write_summary(folder: Path, summary: Mapping[str, Any]) -> None:
    """summary.json; its presence says that the run is complete."""
    write_numbers(folder / SUMMARY, summary)


def write_numbers(path: Path, numbers: Mapping[str, Any]) -> None:
    """The file of numbers that a page is made of; a page of older ones is removed first.

    Raises:
        OutputError: it cannot be written.
    """
    remove_page(path.parent)
    write_json(path, numbers)


def remove_page(folder: Path) -> None:
    """Remove the page of a folder, and its PDF: it would be taken for that of the results to come.

    Raises:
        OutputError: it cannot be removed.
    """
    with writing(folder):
        for ending in (".html", ".pdf"):
            (folder / PAGE).with_suffix(ending).unlink(missing_ok=True)


class CurveFile:
    """The monitor that writes fitting_curve.csv, one row as soon as an increment is accepted."""

    def __init__(self, folder: Path, before: Sequence[Increment] = ()) -> None:
        self.path = folder / CURVE
        self.records = list(before)  # everything accepted so far, those of the resumed run first
        self._last = before[-1].index if before else -1
        self._deviates = False
        self._begin()

    def _begin(self) -> None:
        """Write all increments, with their deviations where one of them has one."""
        self._deviates = any(math.isfinite(record.friction_sd) for record in self.records)
        head = f"{HEADER},{FORCE_SD}" if self._deviates else HEADER
        with writing(self.path):
            self._file = self.path.open("wb", buffering=0)
            append_whole(self._file.fileno(), "".join([head + "\n", *map(self._row, self.records)]).encode())

    def started(self, scene: Scene, total_increments: int, dofs: int) -> None:
        """Nothing: the header is there."""

    def increment(self, record: Increment) -> None:
        """Write the increment; one that the resumed run already had is not written twice."""
        if record.index <= self._last:
            return
        if math.isfinite(record.friction_sd) and not self._deviates:
            self.finished()
            self.records.append(record)
            self._begin()
            return
        with writing(self.path):
            append_whole(self._file.fileno(), self._row(record).encode())
        self.records.append(record)

    def _row(self, record: Increment) -> str:
        return _row(record) + (f",{record.force_sd!r}\n" if self._deviates else "\n")

    def finished(self) -> None:
        """Close the file."""
        with writing(self.path):
            self._file.close()


_EXACT = ("displacement", "force", "normal_force", "mean_friction", "max_pressure")
_COUNTS = ("active_facets", "sticking_facets", "newton_iterations")


def _row(record: Increment) -> str:
    cells = [repr(float(getattr(record, name))) for name in _EXACT]
    cells += [str(int(getattr(record, name))) for name in _COUNTS]
    return ",".join([*cells, f"{record.wall_s:.6f}"])


def read_curve(folder: Path) -> tuple[FloatArray, FloatArray]:
    """Displacement [mm] and force [N] from the fitting curve of a folder, or from such a file itself.

    Raises:
        OutputError: there is none or it is not one of macrofit.
    """
    path = folder / CURVE if folder.is_dir() else folder
    kind = None if path.exists() else kind_of(folder)
    if kind is not None and kind != RUN:
        raise OutputError(f"{folder}: holds {kind.what}, which has no fitting curve; give the folder of a run")
    columns = read_table(path)
    return columns["displacement_mm"], columns["force_N"]


def read_table(path: Path) -> dict[str, FloatArray]:
    """The columns of a fitting curve by their names, which end in their units.

    Raises:
        OutputError: there is none or it is not one of macrofit.
    """
    try:
        lines = path.read_text().splitlines()
        names = lines[0].split(",") if lines else []
        if names not in (HEADER.split(","), [*HEADER.split(","), FORCE_SD]):
            raise OutputError(f"{path}: is not a fitting curve of macrofit, its header is another")
        values = np.array([line.split(",") for line in lines[1:]], dtype=float).reshape(-1, len(names))
    except OSError as error:
        raise OutputError(f"{path}: cannot be read: {error.strerror}") from None
    except ValueError:
        raise OutputError(f"{path}: holds a row that is not numbers") from None
    return dict(zip(names, values.T, strict=True))


def write_interface(
    folder: Path,
    scene: Scene,
    seat: FloatArray | None,
    records: Sequence[Increment],
    friction: PairFrictionMap | None = None,
) -> None:
    """interface.h5: the state of every facet of the seat at every increment, (increments, facets).

    ``seat`` (facets + 1,) are the facet ends [mm]; unknown (None, or another number) they are left as NaN. The group
    `pairs` has the pairs of tiles met, where the run had any: tile numbers, coefficient, uncertainty.
    """
    facets = len(records[0].facets.pressure) if records else 0
    if seat is None or len(seat) != facets + 1:
        seat = np.full(facets + 1, np.nan)
    line = {"facet_start": seat[:-1], "facet_end": seat[1:]}
    middle = 0.5 * (seat[:-1] + seat[1:])
    with h5_file(folder / INTERFACE) as file:
        file.attrs["title"] = scene.title
        file.attrs["coordinate"] = "z" if scene.direction == "radial" else "r"
        dataset(file, "displacement", np.array([record.displacement for record in records]), "mm")
        for name, values in line.items():
            dataset(file, name, values, "mm")
        dataset(file, "z", np.broadcast_to(middle, (len(records), facets)), "mm")
        for item in fields(FacetState):
            rows = [getattr(record.facets, item.name) for record in records]
            dataset(file, item.name, np.array(rows).reshape(len(records), facets), UNITS[item.name])
        if friction is not None and friction.seat.size:
            _write_pairs(file.create_group("pairs"), friction)


@contextmanager
def h5_file(path: Path) -> Iterator[Any]:
    """A file of HDF5 that is put in place whole at the end of the `with` block.

    Raises:
        OutputError: it cannot be written.
    """
    import h5py

    # built in memory: where HDF5 itself meets a full disk it does not always come back
    with h5py.File(path.name, "w", driver="core", backing_store=False) as file:
        yield file
        file.flush()
        image = file.id.get_file_image()
    with replacing(path) as draft:
        draft.write_bytes(image)


def _write_pairs(group: Any, friction: PairFrictionMap) -> None:
    tiling = friction.tiling
    group.attrs["tile_size_mm"] = tiling.size
    group.attrs["seat_origin_mm"] = tiling.seat_origin
    group.attrs["bore_leading_edge_mm"] = tiling.bore_ends[1]
    group.attrs["seat_tiles"], group.attrs["bore_tiles"] = tiling.seat_tiles, tiling.bore_tiles
    group.attrs["lasting"] = friction.lasting
    units = {"seat": "tile, from the seat's start", "bore": "tile, from the leading edge"}
    for name in ("seat", "bore", "coefficient", "uncertainty"):
        dataset(group, name, getattr(friction, name), units.get(name, "1"))


def dataset(file: Any, name: str, values: Any, unit: str) -> None:
    """Add values with their unit to a file or group of HDF5, those of several axes compressed."""
    squeezed = {"compression": "gzip", "compression_opts": 1} if values.ndim > 1 and values.size else {}
    file.create_dataset(name, data=values, **squeezed).attrs["unit"] = unit


def write_fields(folder: Path, solution: Solution) -> None:
    """fields/: a .vtu per body and displacement, a .pvd per body that lists them. x is r and y is z [mm]."""
    if not solution.fields:
        return
    target = folder / FIELDS
    with writing(target):
        target.mkdir(exist_ok=True)
    steps = sorted(solution.fields.items())
    for body in ("axle", "wheel"):
        names = []
        for number, (displacement, bodies) in enumerate(steps):
            if body in bodies:
                names.append((displacement, f"{body}_{number:04d}.vtu"))
                with replacing(target / names[-1][1]) as draft:
                    _vtk_mesh(bodies[body], solution.scene.output.fields).write(draft, file_format="vtu")
        write_text(target / f"{body}.pvd", _collection(names))


def _vtk_mesh(field: BodyField, asked: Iterable[str]) -> Any:
    import meshio

    cells = field.cells
    if cells.shape[1] == 6:  # ours: middles opposite to vertices 0, 1, 2; VTK: middles of edges 01, 12, 20
        cells = cells[:, [0, 1, 2, 5, 3, 4]]
    kind = "triangle" if cells.shape[1] == 3 else "triangle6"
    flat = np.zeros(len(field.points))
    data: dict[str, Any] = {}
    if "displacement" in asked:
        data["displacement"] = np.column_stack([field.displacement, flat])
    if "von_mises" in asked:
        data["von_mises"] = field.von_mises
    if field.plastic_strain is not None:
        data["plastic_strain"] = field.plastic_strain
    if "stress" in asked:
        names = ("stress_rr", "stress_zz", "stress_tt", "stress_rz")
        data |= {name: field.stress[:, k].copy() for k, name in enumerate(names)}
    return meshio.Mesh(np.column_stack([field.points, flat]), [(kind, cells)], point_data=data)


def _collection(names: Iterable[tuple[float, str]]) -> str:
    lines = [f'    <DataSet timestep="{float(time)!r}" part="0" file="{name}"/>\n' for time, name in names]
    head = '<?xml version="1.0"?>\n<VTKFile type="Collection" version="0.1">\n  <Collection>\n'
    return head + "".join(lines) + "  </Collection>\n</VTKFile>\n"
