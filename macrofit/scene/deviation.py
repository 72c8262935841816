"""Measured or drawn deviations of the seat's and the bore's radius, from a CSV of (z, deviation).

Two columns: z [mm] and the deviation of the radius [um], positive where the radius is larger than drawn. z is 0 at the
end that goes on first, the seat's entrance or the bore's leading face, and grows along the fit. Units may stand in the
header, ``z_mm;deviation_mm``; encoding, separator and decimal sign are found out. Between the rows the deviation is
linear; beyond the first and the last it keeps their values.
"""

from __future__ import annotations

import os
import re
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..base.arrays import FloatArray
from ..errors import OutputError, SceneError
from .keys import Hub, Scene, Shaft
from .profile import SMALL_STRAIN

if TYPE_CHECKING:
    from ..base.units import Heading

MOST_BYTES = 50_000_000
"""Size of a profile; 200 mm at a step of a micrometre have 5 MB."""
DIAMETER = re.compile(r"diam|durchm|[øØ⌀]|\bd[ui]a\b|\bd\b", re.IGNORECASE)
"""What the heading of a column says that holds diameters."""
UNCOVERED = 0.05
"""How much of the fit's length a profile may leave out at either end, where a probe does not reach [-]."""


@dataclass(frozen=True, kw_only=True)
class Deviation:
    """Deviation of the radius along a body, in the frame of the body."""

    z: FloatArray  # (n,) ascending [mm]
    value: FloatArray  # (n,) [mm]
    key: str  # of the scene, with the file, for messages
    unit: str  # that the deviations are written in
    assumed: bool  # it is not stated
    taken: str  # what of the file was taken for what, in words

    def at(self, z: FloatArray) -> FloatArray:
        """Deviation of the radius at z [mm]."""
        return np.interp(z, self.z, self.value)

    def slope(self, z: FloatArray) -> FloatArray:
        """Its derivative at z [-]; 0 beyond the ends."""
        steps = np.concatenate([[0.0], np.diff(self.value) / np.diff(self.z), [0.0]])
        return np.asarray(steps[np.searchsorted(self.z, z, side="right")])

    def roughness(self, length: float) -> float:
        """Root mean square [mm] of what the profile does within pieces of a length [mm], beside their means."""
        piece = ((self.z - self.z[0]) / length).astype(np.int64)
        count = np.maximum(np.bincount(piece), 1)
        means = np.bincount(piece, self.value) / count
        places = np.bincount(piece, self.z) / count
        filled = np.bincount(piece) > 0
        smooth = np.interp(self.z, places[filled], means[filled])
        return float(np.sqrt(np.mean((self.value - smooth) ** 2))) if len(self.z) > 2 * filled.sum() else 0.0

    @property
    def largest(self) -> float:
        """Largest deviation, either way [mm]."""
        return float(np.abs(self.value).max())


def deviation_of(scene: Scene, body: str) -> Deviation | None:
    """The profile that the scene gives a body; None where it gives none.

    Raises:
        SceneError: the file cannot be read, or is no profile of this body; the message has the key and the line.
    """
    file = getattr(getattr(scene, body), "profile", None)
    if file is None:
        return None
    key = f"{body}.profile"
    try:
        found = _read_once(file, key, _stamp(file))
    except OutputError as error:
        raise SceneError(f"{key}: {error}") from None
    if body == "wheel":  # drawn with its leading face at z = 0, and backwards
        found = replace(found, z=-found.z[::-1], value=found.value[::-1])
    _check_drawn(scene, body, found)
    return found


def _stamp(file: str) -> tuple[int, int] | None:
    """When a file was changed, and its size; None where it is not there."""
    try:
        known = os.stat(file)
    except OSError:
        return None
    return known.st_mtime_ns, known.st_size


@lru_cache(maxsize=4)
def _read_once(file: str, key: str, stamp: tuple[int, int] | None) -> Deviation:
    """The profile of a file as of its stamp: checks, both bodies and what is foreseen ask for it again and again."""
    return read_profile(Path(file), key)


def read_profile(file: Path, key: str) -> Deviation:
    """The profile of a file that a key of a scene names, z as it stands there.

    Raises:
        OutputError: it cannot be read, has no two columns, a unit that is not known, or z that does not grow.
    """
    from ..base.columns import find_start, headings_of, numbers_of
    from ..base.textfile import read_text_table
    from ..base.units import LENGTHS

    table = read_text_table(file, MOST_BYTES)
    preamble, first = find_start(table, "z [mm] and deviation [um]")
    if len(first) != 2:
        raise OutputError(
            f"{file}: has {len(first)} columns; a profile has two: z [mm] and deviation of the radius [um]"
        )
    headings = headings_of(preamble, 2, {"length"})
    lines, values = numbers_of(table, len(preamble), 2, (0, 1))
    stated = [None, None] if headings is None else [_unit(file, heading) for heading in headings]
    _check_radius(file, headings)
    _check_rows(file, lines, values)
    unit = stated[1] or "µm"
    z, value = values[:, 0] * LENGTHS[stated[0] or "mm"], values[:, 1] * LENGTHS[unit]
    said = (
        f"{len(z)} points from z = {z[0]:.6g} to {z[-1]:.6g} mm, radius {1e3 * value.min():+.4g} to "
        f"{1e3 * value.max():+.4g} um{'' if stated[1] else ', assumed to be in um'}"
    )
    return Deviation(
        z=z, value=value, key=f"{key}: {file}", unit=unit.replace("µ", "u"), assumed=stated[1] is None, taken=said
    )


def _unit(file: Path, heading: Heading) -> str | None:
    """The unit of length that the head of a column states; None for none.

    Raises:
        OutputError: it is another one.
    """
    strange = heading.strange or (heading.unit if heading.unit is not None and heading.kind != "length" else None)
    if strange is not None:
        raise OutputError(f"{file}: unit '{strange}' in its header is not known: take mm, cm, m, in or um")
    return heading.unit


def _check_radius(file: Path, headings: list[Heading] | None) -> None:
    """Refuse a column that is headed as one of diameters: it would count twice.

    Raises:
        OutputError: it is.
    """
    name = "" if headings is None else headings[1].name
    if DIAMETER.search(name.lower()):
        raise OutputError(
            f"{file}: '{name}' in its header is of the diameter; halve the numbers and write deviation of the radius"
        )


def _check_rows(file: Path, lines: list[int], values: FloatArray) -> None:
    """Two points at least, and z that grows.

    Raises:
        OutputError: the line where it does not.
    """
    if len(values) < 2:
        raise OutputError(f"{file}: line {lines[0]}: a profile needs two points at least")
    back = np.flatnonzero(np.diff(values[:, 0]) <= 0.0)
    if not len(back):
        return
    at = int(back[0]) + 1
    if (np.diff(values[:, 1]) > 0.0).all():
        remedy = "are the two columns swapped?"
    elif (np.diff(values[:, 0]) < 0.0).all():
        remedy = "turn the order of the rows"
    else:
        remedy = "sort the rows, one for each place"
    raise OutputError(
        f"{file}: line {lines[at]}: z = {values[at, 0]:g} after {values[at - 1, 0]:g}; z must grow from row to row: "
        f"{remedy}"
    )


def check_cover(found: Deviation, low: float, high: float) -> None:
    """Whether a profile covers the fit between two z of its body [mm], but for a little at its ends.

    Raises:
        SceneError: it does not.
    """
    room = UNCOVERED * (high - low)
    if found.z[0] <= low + room and found.z[-1] >= high - room:
        return
    turned = found.key.startswith("wheel")
    ends = (-found.z[-1], -found.z[0], -high, -low) if turned else (found.z[0], found.z[-1], low, high)
    remedy = "z = 0 is the bore's leading face" if turned else "z = 0 is the seat's entrance"
    if 300.0 * (ends[1] - ends[0]) < ends[3] - ends[2]:
        remedy = "is z in m? write z_m in the header"
    elif turned and ends[1] <= room and ends[0] < 0.0:
        remedy = "z grows from the leading face (0) into the bore: turn its sign"
    raise SceneError(
        f"{found.key}: reaches from z = {ends[0]:.6g} to {ends[1]:.6g} mm, and the fit from {ends[2]:.6g} to "
        f"{ends[3]:.6g} mm; {remedy}"
    )


def _check_drawn(scene: Scene, body: str, found: Deviation) -> None:
    """What the drawn radii say of a profile.

    Raises:
        SceneError: it does not cover the fit, or holds no deviations.
    """
    shape = getattr(scene, body)
    if isinstance(shape, Shaft):
        radius = shape.seat_radius
        reached = min(shape.seat_length, max(scene.displacements))
        check_cover(found, 0.0, max(reached, 0.1 * shape.seat_length))
    elif isinstance(shape, Hub):
        radius = shape.bore_radius
        check_cover(found, shape.rear_edge_blend - shape.hub_length, -shape.chamfer_length)
    else:
        return
    written = np.abs(found.value * 1e3 if found.assumed else found.value)
    mean, alike = float(written.mean()), np.ptp(written) < SMALL_STRAIN * written.mean()  # deviations vary by more
    if alike and any(abs(mean / full - 1.0) < 0.2 for full in (radius, 2.0 * radius)):
        raise SceneError(
            f"{found.key}: are these radii or diameters? give what they deviate by from {body}'s drawn radius, "
            f"{radius:g} mm, in um{'; if they do so already, write deviation_um in the header' * found.assumed}"
        )
    if found.largest > SMALL_STRAIN * radius:
        raise SceneError(
            f"{found.key}: a deviation of {found.largest:.4g} mm of a radius of {radius:g} mm is beyond small strain "
            f"(at most {SMALL_STRAIN * radius:.3g} mm); deviations are in um unless the header says otherwise"
        )
