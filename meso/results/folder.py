"""The files of a friction test: each is written beside its name and then put in place, so that none is half there.

A folder belongs to macrofit-meso once it holds settings it wrote; a new run replaces the results in it and leaves the
rest. Any other folder that is not empty is refused, so that nothing of the user's is overwritten.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from macrofit.base.arrays import FloatArray
from macrofit.base.files import keep_inputs, replacing, starts_with, write_json, write_text, writing

from ..errors import OutputError
from ..records import Breaks, Curve, Slide
from ..settings import Settings, dump
from ..surfaces.hull import FORMATS, hull
from ..surfaces.hull import write as write_hull
from ..surfaces.surface import Surface

if TYPE_CHECKING:
    from ..plates import Plates

SETTINGS, SUMMARY, CURVE, SQUEEZE, DATA = "settings.toml", "summary.json", "curve.csv", "squeeze.csv", "run.h5"
FIGURES = ("surfaces.png", "plates.png", "forces.png")
FIGURE = ".png"
MARK = "# Settings of a run of macrofit-meso, every default written out. mm, N, MPa, t, s.\n"
HEADER = "displacement_mm,normal_force_N,tangential_force_N,friction,lateral_force_N"
SQUEEZE_HEADER = "approach_mm,normal_force_N,tangential_force_N,friction,lateral_force_N"


def prepare(folder: Path, settings: Settings) -> None:
    """Make the folder ready for a run: remove the results of an earlier one, and write settings.toml.

    Raises:
        OutputError: it cannot be written; or it is not empty and holds no run of macrofit-meso.
    """
    with writing(folder):
        folder.mkdir(parents=True, exist_ok=True)
        if any(folder.iterdir()) and not starts_with(folder / SETTINGS, MARK.encode()):
            raise OutputError(
                f"{folder}: is not empty and holds no run of macrofit-meso; choose another folder with -o"
            )
        names = (SUMMARY, CURVE, SQUEEZE, DATA, *FIGURES)
        stale = [*(folder / name for name in names), *folder.glob("curve_*.csv"), *folder.glob("breaks_*.csv")]
        faces = [settings.surface.measured(body) for body in ("wheel", "axle")]
        keep_inputs(stale, [Path(name) for keys in faces if keys is not None for name in keys.files])
        for path in stale:
            path.unlink(missing_ok=True)
    write_text(folder / SETTINGS, MARK + dump(settings))


def write_slide(folder: Path, slide: Slide, *, first: bool, several: bool) -> None:
    """The curves of a slide that is done: curve.csv and squeeze.csv of the first; of several also curve_MICRO.csv.

    Beams that broke, if any, go into breaks_MICRO.csv.
    """
    if first:
        write_curve(folder / SQUEEZE, slide.squeeze, SQUEEZE_HEADER)
        write_curve(folder / CURVE, slide.curve)
    if several:
        write_curve(folder / f"curve_{slide.micro_friction!r}.csv", slide.curve)
    if slide.breaks is not None and slide.breaks.time:
        _write_breaks(folder / f"breaks_{slide.micro_friction!r}.csv", slide.breaks)


def write_curve(path: Path, curve: Curve, header: str = HEADER) -> None:
    """Forces along the way as text, every digit kept."""
    columns = (curve.displacement, curve.normal, curve.tangential, curve.friction, curve.lateral)
    _write_rows(path, header, zip(*(column.tolist() for column in columns), strict=True))


def _write_breaks(path: Path, breaks: Breaks) -> None:
    places = zip(breaks.time, breaks.slide, breaks.mode, breaks.place, strict=True)
    rows = ((time, slide, mode, *place) for time, slide, mode, place in places)
    _write_rows(path, "time_s,slide_mm,mode,x_mm,y_mm,z_mm", rows)


def _write_rows(path: Path, header: str, rows: Iterable[Iterable[Any]]) -> None:
    lines = [header, *(",".join(map(str, row)) for row in rows)]
    write_text(path, "\n".join(lines) + "\n")


def write_summary(folder: Path, summary: Mapping[str, Any]) -> None:
    """summary.json, numbers that do not exist as null; its presence says that all was computed."""
    write_json(folder / SUMMARY, summary)


def envelopes(plates: Plates) -> dict[str, Surface]:
    """Upper envelopes of the spheres of both plates, heights over the nominal faces, an eighth of a radius apart."""
    found = {}
    for body, packing in (("wheel", plates.wheel_packing), ("axle", plates.axle_packing)):
        spacing = float(packing.radii.mean()) / 8.0
        along, across = (round(length / spacing) + 1 for length in packing.size)
        found[body] = Surface(packing.envelope((along, across)), packing.size)
    return found


def write_data(folder: Path, plates: Plates, tops: Mapping[str, Surface], slides: Sequence[Slide]) -> None:
    """run.h5: per body the surface, the envelope and the spheres, and every slide with its squeeze.

    Heights are outward from the nominal face; spheres lie in the frame of their own plate, its flat back at z = 0.
    """
    import h5py

    # built in memory: where HDF5 itself meets a full disk it does not always come back
    with h5py.File(DATA, "w", driver="core", backing_store=False) as file:
        file.attrs["title"] = plates.settings.title
        file.attrs["settings"] = dump(plates.settings)
        file.attrs["first_touch_mm"] = plates.first_touch
        for body, packing in (("wheel", plates.wheel_packing), ("axle", plates.axle_packing)):
            group = file.create_group(body)
            group.attrs["thickness_mm"] = packing.thickness
            for name, surface in (("surface", packing.surface), ("envelope", tops[body])):
                _dataset(group, name, surface.heights, "mm").attrs["size_mm"] = surface.size
            _dataset(group, "centres", packing.centres, "mm")
            _dataset(group, "radii", packing.radii, "mm")
        for number, slide in enumerate(slides):
            group = file.create_group(f"slides/{number}")
            group.attrs["micro_friction"] = slide.micro_friction
            group.attrs["meso_friction"] = slide.curve.coefficient
            group.attrs["uncertainty"] = slide.curve.uncertainty
            group.attrs["engine"] = slide.engine
            for name, curve in (("squeeze", slide.squeeze), ("slide", slide.curve)):
                _curve(group.create_group(name), curve)
        file.flush()
        image = file.id.get_file_image()
    with replacing(folder / DATA) as draft:
        draft.write_bytes(image)


def _curve(group: Any, curve: Curve) -> None:
    units = {"displacement": "mm", "normal": "N", "tangential": "N", "lateral": "N", "friction": "1", "height": "mm"}
    units["share"] = "1"
    for name, unit in units.items():
        _dataset(group, name, getattr(curve, name), unit)


def _dataset(group: Any, name: str, values: FloatArray, unit: str) -> Any:
    squeezed = {"compression": "gzip", "compression_opts": 1, "shuffle": True} if values.size > 1000 else {}
    dataset = group.create_dataset(name, data=values, **squeezed)
    dataset.attrs["unit"] = unit
    return dataset


def write_spheres(path: Path, plates: Plates) -> Path:
    """The spheres of both plates at their first touch, with their beams as lines: .vtu or .vtk; radii are point data.

    Raises:
        OutputError: another suffix, or a file that cannot be written.
    """
    suffix = path.suffix.lower()
    if suffix not in (".vtu", ".vtk"):
        raise OutputError(f"{path}: spheres are written as .vtu or .vtk, their picture as .png")
    import meshio

    lattice, wheel = plates.lattice, plates.wheel.nodes
    centres = lattice.centres.copy()
    centres[:wheel, 2] += plates.first_touch
    body = (np.arange(lattice.nodes) >= wheel).astype(np.int32)  # 0 wheel, 1 axle
    cells = [
        ("vertex", np.arange(lattice.nodes, dtype=np.int32)[:, None]),
        ("line", np.stack([lattice.first, lattice.cols], axis=1).astype(np.int32)),
    ]
    mesh = meshio.Mesh(centres, cells, point_data={"radius": lattice.radii, "body": body})
    with replacing(path) as draft:
        mesh.write(draft, file_format=suffix[1:])
    return path


def check_surface_file(path: Path) -> None:
    """Refuse a suffix in which no surface is written; `.png` is the figure's.

    Raises:
        OutputError: the suffix is another.
    """
    known = (FIGURE, ".npy", ".csv", *FORMATS)
    if path.suffix.lower() not in known:
        raise OutputError(f"{path}: a surface is written as {', '.join(known)}, not as {path.suffix or 'a bare name'}")


def write_surface(path: Path, surface: Surface, thickness: float) -> Path:
    """A surface in the form its suffix names: heights [mm] (.npy, .csv), or the hull of its plate.

    Raises:
        OutputError: another suffix, or a file that cannot be written.
    """
    check_surface_file(path)
    suffix = path.suffix.lower()
    if suffix == FIGURE:
        raise OutputError(f"{path}: figures are drawn by meso.figures, not written with the data")
    with replacing(path) as draft:
        if suffix == ".npy":
            np.save(draft, surface.heights)
        elif suffix == ".csv":
            (length, width), (nx, ny) = surface.size, surface.shape
            head = f"heights [mm]; {nx} rows along x = 0 ... {length:g} mm, {ny} columns along y = 0 ... {width:g} mm"
            np.savetxt(draft, surface.heights, fmt="%.17g", delimiter=",", header=head)
        else:
            write_hull(hull(surface, thickness), draft)
    return path
