"""From what a file says to heights that a plate can take: refused, mended, levelled, and told what was done."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from macrofit.base.arrays import BoolArray, FloatArray

from ..errors import SurfaceError
from .head import HINT
from .keys import ScanKeys
from .raw import RawScan, length_unit

MOST_MISSING, MUCH_MISSING = 0.25, 0.05
"""Share of missing points above which a scan is refused, and above which it is doubted [-]."""
MOST_SPIKES, MANY_SPIKES = 0.05, 0.01
"""The same for spikes [-]."""
EMPTY_LINE = 0.5
"""A line at the border with more missing points than this is cut off [-]."""
HIGH, SHARP = 5.0, 10.0
"""A spike leaves the median of its 5 x 5 neighbours by so many rms heights, and by so many usual distances [-]."""
MOST_ROUNDS = 8
"""How often spikes are looked for, at most."""
PEAKED = 12.0
"""Largest height over Sq above which a scan is doubted [-]."""
SWEEPS = 50
"""Sweeps of relaxation over points that are filled."""
SMOOTHEST, ROUGHEST = 2e-5, 0.06
"""Sq outside of these is none of a machined face: another unit is meant [mm]."""
SMOOTH, ROUGH = 5e-5, 0.02
"""Sq outside of these is rare [mm]."""
FINEST, COARSEST, LONGEST, WIDE = 1e-4, 0.2501, 400.0, 20.0
"""Spacings and a length outside of these are none of a scan: another unit is meant; a wider scan is doubted [mm]."""
COARSE = 2.01
"""Spacing over that of the means above which a scan is doubted [-]; generated faces have twice theirs."""
STEEPEST = 1.0
"""Sdq above this is doubted [-]."""
FLAT_SHARE, FLAT_OVER = 0.01, 10.0
"""Share of points with exactly the highest or lowest height above which a scan is doubted, and over others' [-]."""
SAMPLE = 1000
"""Points along each axis, at most, from which slopes and usual distances are taken."""


@dataclass(frozen=True, kw_only=True)
class Scan:
    """Heights without gaps, and what was done to them."""

    heights: FloatArray
    """Heights [mm], first axis along the slide, shape (nx, ny); a point stands for the cell around it."""
    spacing: tuple[float, float]
    """Distances of the points [mm]."""
    done: tuple[str, ...] = ()
    """What was done, in words."""
    made_up: tuple[str, ...] = ()
    """Which of its points were not measured, in words; too many of them are a doubt besides."""
    doubts: tuple[str, ...] = ()
    """What may be wrong, in words."""

    @property
    def size(self) -> tuple[float, float]:
        """Length along the slide and width [mm]."""
        return self.heights.shape[0] * self.spacing[0], self.heights.shape[1] * self.spacing[1]


def cleaned(raw: RawScan, keys: ScanKeys) -> Scan:
    """Heights in mm, mended and without their form.

    Args:
        raw: as the file says.
        keys: what it does not say, and what is taken away.

    Raises:
        SurfaceError: no spacing, too few points, too much missing, flat, or of another unit than stated.
    """
    scan = _cropped(_in_mm(raw, keys))
    heights, missing = scan.heights, ~np.isfinite(scan.heights)
    flat = _flat_ends(heights)
    if missing.mean() > MOST_MISSING:
        raise SurfaceError(f"{missing.mean():.0%} of its points are missing: take less than {MOST_MISSING:.0%}")
    heights = filled(heights, missing)
    heights, spikes = _without_spikes(heights, missing, keys)
    rest, made_up = without_form(heights, keys), (*_mended("missing", missing), *_mended("spikes", spikes))
    scan = replace(
        scan,
        heights=rest,
        done=(*scan.done, *made_up, _levelled(keys)),
        made_up=made_up,
        doubts=(*scan.doubts, *flat, *_much("missing", missing, MUCH_MISSING), *_much("spikes", spikes, MANY_SPIKES)),
    )
    return _plausible(scan, keys, raw.unit is not None)


def _in_mm(raw: RawScan, keys: ScanKeys) -> Scan:
    """Unit, spacing and the axis along the slide applied; a contradiction with the keys is refused."""
    if raw.heights.ndim != 2 or min(raw.heights.shape) < 2:
        shape = " x ".join(map(str, raw.heights.shape))
        raise SurfaceError(
            f"it holds {shape} numbers: a surface takes at least 2 x 2 points; is it a profile? measure an area, 2 mm "
            "along the axle and 1 mm across or more"
        )
    asked = None if keys.unit is None else length_unit(keys.unit)
    if asked is not None and raw.unit is not None and not math.isclose(asked, raw.unit):
        raise SurfaceError(
            f"unit = '{keys.unit}' is asked for, and the file says another one: leave the key out for this file"
        )
    unit = raw.unit if raw.unit is not None else asked
    given = keys.spacings
    heights, remarks = raw.heights, raw.remarks
    said = None if given is not None and remarks.assumed else raw.spacing
    if keys.along == "y":
        heights, said = heights.T, None if said is None else (said[1], said[0])
    if said is not None and given is not None and not np.allclose(said, given, rtol=0.01):
        raise SurfaceError(
            f"spacing = {given[0]:g}, {given[1]:g} mm is asked for, and the file says {said[0]:g}, {said[1]:g} mm: "
            "leave the key out for this file"
        )
    spacing = said if said is not None else given
    if spacing is None:
        raise SurfaceError(no_spacing(raw))
    for step, count in zip(spacing, heights.shape, strict=True):
        if not FINEST <= step <= COARSEST or step * count > LONGEST:
            raise SurfaceError(
                f"{count} points {step:g} mm apart are no scan of a machined face (spacings of {FINEST:g} to "
                f"{COARSEST:g} mm, at most {LONGEST:g} mm long): spacing is in mm; is it in m or µm?"
            )
    done = [*remarks.done, *(f"not taken for the spacing: {line}" for line in remarks.unclear)]
    done += [remarks.assumed] if said is not None and remarks.assumed else []
    done += ["heights taken for mm: no unit was given"] if unit is None else []
    done += ["heights turned over (invert)"] if keys.invert else []
    scale = (1.0 if unit is None else unit) * (-1.0 if keys.invert else 1.0)
    doubts = (*remarks.doubts, *(() if keys.invert else remarks.turned))
    return Scan(heights=heights * scale, spacing=spacing, done=tuple(done), doubts=doubts)


def no_spacing(raw: RawScan) -> str:
    """Why the distance of a file's points is not known, and what to do."""
    if raw.remarks.unclear:
        return f"the distance of its points is not understood: {raw.remarks.unclear[0]}; {HINT}"
    return "the distance of its points is not known: give it as the key spacing [mm], or in the head of a table"


def _cropped(scan: Scan) -> Scan:
    """Without lines at the border that are mostly empty."""
    there = np.isfinite(scan.heights)
    if not there.any():
        raise SurfaceError("none of its heights is a finite number")
    rows = np.flatnonzero(there.mean(axis=1) > EMPTY_LINE)
    columns = np.flatnonzero(there.mean(axis=0) > EMPTY_LINE)
    if not rows.size or not columns.size:
        raise SurfaceError(f"{1.0 - there.mean():.0%} of its points are missing: take less than {MOST_MISSING:.0%}")
    cut = scan.heights[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    lost = scan.heights.shape[0] - cut.shape[0], scan.heights.shape[1] - cut.shape[1]
    done = (f"{lost[0]} rows and {lost[1]} columns cut off at the border, mostly missing",) if any(lost) else ()
    if min(cut.shape) < 2:
        raise SurfaceError("less than 2 x 2 of its points are measured")
    return replace(scan, heights=cut, done=(*scan.done, *done))


def filled(heights: FloatArray, missing: BoolArray) -> FloatArray:
    """Missing points take the nearest height that was measured, then relax towards the mean of their neighbours."""
    if not missing.any():
        return heights
    from scipy.ndimage import distance_transform_edt

    nearest = distance_transform_edt(missing, return_distances=False, return_indices=True)
    mended: FloatArray = np.pad(heights[tuple(nearest)], 1, mode="edge")
    i, j = (places + 1 for places in np.nonzero(missing))
    for _ in range(SWEEPS):
        mended[i, j] = 0.25 * (mended[i - 1, j] + mended[i + 1, j] + mended[i, j - 1] + mended[i, j + 1])
        for border, inner in ((0, 1), (-1, -2)):
            mended[border], mended[:, border] = mended[inner], mended[:, inner]
    return mended[1:-1, 1:-1]


def without_form(heights: FloatArray, keys: ScanKeys) -> FloatArray:
    """What is left after the least-squares fit of the form: a plane, one that is curved across, or a polynomial."""
    if keys.remove == "none":
        return heights
    degree = keys.degree if keys.remove == "polynomial" else 2
    if min(heights.shape) <= degree:
        raise SurfaceError(
            f"{heights.shape[0]} x {heights.shape[1]} points are too few for remove = '{keys.remove}': are they some "
            "profiles, or a list of points? a surface has as many points across; or take remove = 'plane'"
        )
    bases = [_polynomials(count, degree) for count in heights.shape]
    moments = bases[0].T @ heights @ bases[1]
    i, j = np.indices(moments.shape)
    terms = i + j <= degree
    if keys.remove != "polynomial":
        terms = (i + j <= 1) | ((keys.remove == "cylinder") & (i == 0) & (j == 2))
    rest: FloatArray = heights - bases[0] @ (moments * terms) @ bases[1].T
    return rest


def _polynomials(count: int, degree: int) -> FloatArray:
    """Orthonormal polynomials on so many points, by rising degree, shape (count, degree + 1)."""
    powers = np.polynomial.legendre.legvander(np.linspace(-1.0, 1.0, count), degree)
    basis: FloatArray = np.linalg.qr(powers)[0]
    return basis


def _without_spikes(heights: FloatArray, missing: BoolArray, keys: ScanKeys) -> tuple[FloatArray, BoolArray]:
    """Heights with spikes filled, and where they were: large ones hide smaller ones, and bend the form.

    Raises:
        SurfaceError: they are too many.
    """
    spikes = np.zeros(heights.shape, dtype=np.bool_)
    for _ in range(MOST_ROUNDS):
        more = _spikes(without_form(heights, keys)) & ~missing & ~spikes
        if not more.any():
            break
        spikes |= more
        if spikes.mean() > MOST_SPIKES:
            raise SurfaceError(f"{spikes.mean():.1%} of its points are spikes: measure anew, or filter it first")
        heights = filled(heights, missing | spikes)
    return heights, spikes


def _spikes(heights: FloatArray) -> BoolArray:
    """Points that leave their neighbours as no machined face does."""
    from scipy.ndimage import uniform_filter

    spikes = np.zeros(heights.shape, dtype=np.bool_)
    rms = _robust(heights)
    if rms == 0.0:
        return spikes
    far = np.abs(heights - uniform_filter(heights, 7, mode="nearest"))
    i, j = np.nonzero(far > 0.5 * HIGH * rms)
    usual = _robust(_from_median(heights, *_sampled(heights.shape)))
    for part in range(0, len(i), 100_000):
        some = slice(part, part + 100_000)
        spikes[i[some], j[some]] = np.abs(_from_median(heights, i[some], j[some])) > max(HIGH * rms, SHARP * usual)
    return spikes


def _sampled(shape: tuple[int, ...]) -> tuple[np.ndarray[tuple[int], np.dtype[np.intp]], ...]:
    """Places spread over a grid, some ten thousand."""
    rows, columns = (np.linspace(0, count - 1, min(count, 100)).astype(np.intp) for count in shape)
    i, j = np.meshgrid(rows, columns, indexing="ij")
    return i.ravel(), j.ravel()


def _from_median(heights: FloatArray, i: np.ndarray, j: np.ndarray) -> FloatArray:  # type: ignore[type-arg]
    """Distances of points from the median of their 5 x 5 neighbours, at the border of those that are there."""
    near = np.arange(-2, 3)
    rows = np.clip(i[:, None, None] + near[:, None], 0, heights.shape[0] - 1)
    columns = np.clip(j[:, None, None] + near[None, :], 0, heights.shape[1] - 1)
    windows = heights[rows, columns].reshape(len(i), -1)
    distance: FloatArray = heights[i, j] - np.median(windows, axis=1)
    return distance


def _robust(values: FloatArray) -> float:
    """Rms of values about their median as the middle half of them tells it."""
    some = values.ravel()[:: max(1, values.size // 200_000)]
    return float(1.4826 * np.median(np.abs(some - np.median(some))))


def _mended(what: str, places: BoolArray) -> tuple[str, ...]:
    if not places.any():
        return ()
    return (f"{what}: {int(places.sum())} points ({places.mean():.2g} of all), filled from their neighbours",)


def _much(what: str, places: BoolArray, limit: float) -> tuple[str, ...]:
    return (f"{what}: {places.mean():.1%} of the points, more than {limit:.0%}",) if places.mean() > limit else ()


def _flat_ends(heights: FloatArray) -> tuple[str, ...]:
    """Whether many points have exactly the highest or the lowest height, as where an instrument's range ends.

    In whole steps many points share a height anyway: then more than `FLAT_OVER` times those of the next five steps.
    """
    found = []
    heights = heights.ravel()[:: max(1, heights.size // 200_000)]
    for what, end in (("highest", np.fmax.reduce(heights, axis=None)), ("lowest", np.fmin.reduce(heights, axis=None))):
        count = int(np.count_nonzero(heights == end))
        if count <= FLAT_SHARE * heights.size:
            continue
        values, counts = np.unique(heights[np.isfinite(heights)], return_counts=True)
        next_to = counts[-6:-1] if what == "highest" else counts[1:6]
        if len(values) > 2 and count > FLAT_OVER * next_to.mean():
            found.append(
                f"{count / heights.size:.1%} of its points have exactly its {what} height: did the range of the "
                "instrument end there?"
            )
    return tuple(found)


def _levelled(keys: ScanKeys) -> str:
    form = f"polynomial of degree {keys.degree}" if keys.remove == "polynomial" else keys.remove
    return "form left in" if keys.remove == "none" else f"form removed: {form}"


def _plausible(scan: Scan, keys: ScanKeys, stated: bool) -> Scan:
    """The scan with what may be wrong with it.

    Raises:
        SurfaceError: flat, or so rough or smooth that only another unit explains it.
    """
    level = without_form(scan.heights, ScanKeys(files=keys.files, remove="plane"))
    rms = float(np.sqrt(np.mean(level**2)))
    if rms <= max(1e-7, 1e-9 * float(np.abs(scan.heights).max())):
        raise SurfaceError("all its heights are the same, or lie in one plane")
    told = f"its Sq is {1e3 * rms:.3g} µm"
    said = "the unit that the file states" if stated else "the key unit"
    if not SMOOTHEST <= rms <= ROUGHEST:
        hint = "a larger unit, m or mm" if rms < SMOOTHEST else "a smaller unit, µm or nm"
        raise SurfaceError(
            f"{told}, machined faces have {1e3 * SMOOTHEST:g} to {1e3 * ROUGHEST:g} µm; are the heights in {hint}? "
            f"see {said}"
        )
    doubts = list(scan.doubts)
    if not SMOOTH <= rms <= ROUGH:
        doubts.append(f"{told}, which is rare on machined faces: is {said} right?")
    if scan.size[1] > WIDE:
        doubts.append(f"it is {scan.size[1]:.4g} mm wide, scans have less than {WIDE:g} mm: is the spacing right?")
    if max(scan.spacing) > COARSE * 2.0**-keys.levels:
        doubts.append(
            f"its points are {1e3 * max(scan.spacing):.3g} µm apart, coarser than the means over "
            f"{1e3 * 2.0**-keys.levels:.3g} µm that are taken: what lies between is not known"
        )
    peak = float(np.abs(level).max()) / rms
    if peak > PEAKED:
        doubts.append(f"its highest point is {peak:.0f} Sq from the mean plane: are there spikes or scratches left?")
    steep = slope(scan)
    if steep > STEEPEST:
        doubts.append(f"its slope Sdq is {steep:.2g}: are unit and spacing right, is it noise?")
    angle, strength = lay(scan)
    if strength > 0.5 and angle < 30.0:
        doubts.append(f"its lay runs along the slide ({angle:.0f}°), turned seats have it across: is along right?")
    return replace(scan, doubts=tuple(doubts))


def _slopes(scan: Scan) -> tuple[FloatArray, FloatArray]:
    """Differences along and across over a middle piece [-], between the centres of two by two points."""
    h = scan.heights
    parts = [slice(max(0, (n - SAMPLE) // 2), max(0, (n - SAMPLE) // 2) + SAMPLE) for n in h.shape]
    h = h[parts[0], parts[1]]
    along, across = np.diff(h, axis=0) / scan.spacing[0], np.diff(h, axis=1) / scan.spacing[1]
    return 0.5 * (along[:, 1:] + along[:, :-1]), 0.5 * (across[1:] + across[:-1])


def slope(scan: Scan) -> float:
    """Root mean square slope Sdq [-]."""
    along, across = _slopes(scan)
    return float(np.sqrt(np.mean(along**2 + across**2)))


def lay(scan: Scan) -> tuple[float, float]:
    """Angle of the lay to the slide [degrees, 0 ... 90], and its strength [-], 0 (none) to 1 (lines).

    The lay is the direction in which the mean square of the slope is smallest; the strength is the difference of
    largest and smallest over their sum.
    """
    along, across = _slopes(scan)
    xx, yy, xy = (float(np.mean(a * b)) for a, b in ((along, along), (across, across), (along, across)))
    if xx + yy == 0.0:
        return 90.0, 0.0
    steepest = 0.5 * math.degrees(math.atan2(2.0 * xy, xx - yy))  # against the slide
    return 90.0 - abs(steepest), math.hypot(xx - yy, 2.0 * xy) / (xx + yy)
