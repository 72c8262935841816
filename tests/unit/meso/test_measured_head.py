"""Heads of tables as strangers write them: unit and spacing are two statements, and what is not understood is said."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import scans

from meso.errors import SurfaceError
from meso.measured.clean import Scan, without_form
from meso.measured.head import read_head
from meso.measured.keys import ScanKeys
from meso.measured.raw import length_unit
from meso.measured.read import read_scan
from meso.surfaces.measured import scan_of

SHAPE = (40, 30)

UNDERSTOOD = {
    "spacing = 5 µm": (5.0, 5.0),
    "spacing: 5um": (5.0, 5.0),
    "spacing = 5, 10 µm": (5.0, 10.0),
    "spacing = 5 x 10 µm": (5.0, 10.0),
    "spacing = 5x10 µm": (5.0, 10.0),
    "spacing = 5 µm x 10 µm": (5.0, 10.0),
    "spacing = 5 um, 10 um": (5.0, 10.0),
    "spacing = 5;10 µm": (5.0, 10.0),
    "spacing = 0.005 mm; 10 µm": (5.0, 10.0),
    "spacing = 5 micron": (5.0, 5.0),
    "spacing (µm): 5": (5.0, 5.0),
    "spacing [µm] = 5, 10": (5.0, 10.0),
    "spacing in mm: 0.005": (5.0, 5.0),
    "spacing_mm = 0.005": (5.0, 5.0),
    "spacing (x, y) = 5 x 10 µm": (5.0, 10.0),
    "spacing;5;µm": (5.0, 5.0),
    "dx = 5 µm, dy = 10 µm": (5.0, 10.0),
    "x spacing = 5 µm; y spacing = 10 µm": (5.0, 10.0),
    "pixel size: 5 µm": (5.0, 5.0),
    "Pixel size = 5 µm/pixel": (5.0, 5.0),
    "Point distance 5 µm": (5.0, 5.0),
    "Abstand = 5 µm": (5.0, 5.0),
    "spacing = 5e-6 m": (5.0, 5.0),
    "spacing = 0,005 mm": (5.0, 5.0),
    "spacing = 5 µm # from calibration": (5.0, 5.0),
    "spacing = 5 Âµm": (5.0, 5.0),
    "heights [µm], spacing = 5 µm": (5.0, 5.0),
    "spacing = 0.0002 in": (5.08, 5.08),
}
"""Lines, and the distances that they say [µm]."""


@pytest.mark.parametrize("line", UNDERSTOOD)
def test_a_spacing_is_understood_however_it_is_written(line: str) -> None:
    said = read_head([(1, f"# {line}")], ".", SHAPE)
    assert said.spacing == pytest.approx(tuple(1e-3 * each for each in UNDERSTOOD[line]))
    assert said.unclear == ()
    assert said.unit == (1e-3 if "heights" in line else None)


COMMAS = {
    "spacing = 2,5 µm": (2.5, 2.5),
    "Abstand = 2,5 µm x 5,0 µm": (2.5, 5.0),
    "spacing = 5, 10 µm": (5.0, 10.0),
    "spacing = 2,5; 5 µm": (2.5, 5.0),
    "spacing = 0.005 mm": (5.0, 5.0),
    "spacing = 0,005 mm": (5.0, 5.0),
}


@pytest.mark.parametrize("line", COMMAS)
def test_a_spacing_has_the_decimal_sign_of_the_table(line: str) -> None:
    said = read_head([(1, line)], ",", SHAPE)
    assert said.spacing == pytest.approx(tuple(1e-3 * each for each in COMMAS[line]))


UNCLEAR = {
    "spacing = 5.0": "has no unit",
    "spacing = -5 µm": "is not one or two positive lengths",
    "spacing = 0 µm": "is not one or two positive lengths",
    "spacing = 2,5 µm": "whose ',' is not the decimal sign of the table",
    "spacing = 5,000 µm": "whose ',' is not the decimal sign of the table",
    "spacing = 5 µm x 10 µm x 2 µm": "goes on with 'x'",
    "spacing = 5 furlong": "has 'furlong' for a unit of length",
    "spacing = 200 points/mm": "has 'points' for a unit of length",
    "spacing: five µm": "has no number that is understood",
    "cellsize 0.005": "has no unit",
    "dx = 5 µm": "says it along one axis alone",
    "lateral resolution = 5 µm": "may be another length",
    "Sampling rate: 1000 Hz": "for a unit of length",
}


@pytest.mark.parametrize("line", UNCLEAR)
def test_a_spacing_that_is_not_understood_is_never_dropped(line: str, tmp_path: Path) -> None:
    """It is refused with the line and what to write; a key says it in its place, and then that is told."""
    said = read_head([(3, line)], ".", SHAPE)
    assert said.spacing is None
    assert UNCLEAR[line] in said.unclear[0]
    path = written(tmp_path, f"# heights [µm]\n# {line}\n")
    with pytest.raises(SurfaceError, match="the distance of its points is not understood: line 2: ") as caught:
        scan(path)
    assert f"'# {line}'" in str(caught.value)
    assert "give the key spacing [mm]" in str(caught.value)
    found = scan(path, spacing=0.005)
    assert found.spacing == (0.005, 0.005)
    assert f"not taken for the spacing: line 2: '# {line}'" in " ".join(found.done)


NO_SPACING = (
    "Number of pixels: 1024 x 768",
    "pixels = 40 x 30",
    "vertical resolution: 0.1 nm",
    "z-step = 0.1 µm",
    "dz = 1 nm",
    "step height = 3 µm",
    "Working distance = 10 mm",
    "Raster scan",
    "Operator: M",
    "Sq = 1.2 µm",
    "Length = 3 mm",
    "Mean spacing of profile elements RSm = 80 µm",
    "RSm: mean spacing 60 µm",
    "sampling length lr = 0.25 mm, evaluation length 4 mm",
    "groove spacing 0.2 mm",
    "turned, feed pitch 0.1 mm",
    "cut-off spacing 0.8 mm",
)


@pytest.mark.parametrize("line", NO_SPACING)
def test_what_does_not_speak_of_the_spacing_says_nothing(line: str) -> None:
    assert read_head([(1, f"# {line}")], ".", SHAPE) == (None, None, (), ())


HEIGHTS = {
    "heights [µm]": 1e-3,
    "heights in nm": 1e-6,
    "heights in Âµm": 1e-3,
    "heights in ?m": 1e-3,
    "z (mm)": 1.0,
    "z_um": 1e-3,
    "Höhen [µm]": 1e-3,
    "Value units: m": 1e3,
    "µm": 1e-3,
    "[nm]": 1e-6,
    "Topography [Âµm]": 1e-3,
    "x [mm], y [mm], z [µm]": 1e-3,
    "heights [mm]; 40 rows along x = 0 ... 2 mm, 30 columns along y = 0 ... 1 mm": 1.0,
}


@pytest.mark.parametrize("line", HEIGHTS)
def test_the_unit_of_the_heights_is_a_statement_of_its_own(line: str) -> None:
    """Whatever stands before and behind it in the head."""
    others = [(2, "# spacing = 0.0002 in"), (3, "# Length = 3 cm"), (4, "# XY unit: m")]
    for lines in ([(1, f"# {line}"), *others], [*others, (5, f"# {line}")]):
        if "rows along" in line:
            lines = [each for each in lines if "spacing" not in each[1]]
        assert read_head(lines, ".", SHAPE).unit == HEIGHTS[line]


def test_lines_that_contradict_each_other_are_refused() -> None:
    for first, other, what in (
        ("heights [µm]", "z [nm]", "the unit of the heights"),
        ("spacing = 5 µm", "pixel size = 6 µm", "the spacing"),
    ):
        with pytest.raises(SurfaceError, match=f"two things of {what}, line 1: .* and line 2: .*: take the wrong one"):
            read_head([(1, first), (2, other)], ".", SHAPE)
    assert read_head([(1, "spacing = 5 µm"), (2, "pixel size = 0.005 mm")], ".", SHAPE).spacing is not None
    for line, unit in (("heights [µin]", "µin"), ("h [bar]", "bar"), ("z in V", "V")):
        with pytest.raises(SurfaceError, match=f"unit '{unit}' is not one of length"):
            read_head([(1, line)], ".", SHAPE)


HEIGHTS_HERE = scans.textured(np.random.default_rng(3), (130, 120), (0.01, 0.01))
RMS = float(without_form(HEIGHTS_HERE, ScanKeys(files=("a",))).std())


def written(folder: Path, head: str, name: str = "a.csv", separator: str = ",", decimal: str = ".") -> Path:
    """A table in µm with this head."""
    rows = [separator.join(f"{1e3 * z:.6f}".replace(".", decimal) for z in row) for row in HEIGHTS_HERE.tolist()]
    (folder / name).write_text(head + "\n".join(rows) + "\n", encoding="utf-8")
    return folder / name


def scan(path: Path, **more: object) -> Scan:
    return scan_of(ScanKeys(files=(str(path),), use="face", **more), 0)  # type: ignore[arg-type]


def test_the_size_of_an_image_says_the_spacing(tmp_path: Path) -> None:
    """As Gwyddion writes it: rows run down the height. A height and a width of something else say nothing."""
    head = "# Channel: Topography\n# Width: 1200 µm\n# Height: 1.3 mm\n# Value units: {}\n"
    assert scan(written(tmp_path, head.format("um"))).spacing == pytest.approx((0.01, 0.01))
    assert read_scan(written(tmp_path, head.format("m"))).unit == 1e3
    assert read_scan(written(tmp_path, "# Width: 2 mm\n# Height: 3 µm\n")).spacing is None
    assert read_scan(written(tmp_path, "# Width: 2 mm\n")).spacing is None


@pytest.mark.parametrize("spacing", ["0.01 mm", "10 µm", "10000 nm", "0.00001 m"])
@pytest.mark.parametrize("turned", [False, True])
def test_the_order_of_the_two_lines_does_not_matter(tmp_path: Path, spacing: str, turned: bool) -> None:
    lines = ["# heights [µm]\n", f"# spacing = {spacing}\n"]
    path = written(tmp_path, "".join(lines[::-1] if turned else lines))
    found = scan(path)
    assert found.spacing == pytest.approx((0.01, 0.01))
    assert found.heights.std() == pytest.approx(RMS, rel=1e-6)
    assert read_scan(path).unit == 1e-3


def test_a_spacing_alone_leaves_the_unit_to_the_key(tmp_path: Path) -> None:
    path = written(tmp_path, "# spacing = 0.01 mm\n")
    assert read_scan(path).unit is None
    assert scan(path, unit="um").heights.std() == pytest.approx(RMS, rel=1e-6)


def test_a_german_table_is_read_as_it_is_meant(tmp_path: Path) -> None:
    path = written(tmp_path, "# Höhen [µm]\n# Abstand = 12,5 µm\n", separator=";", decimal=",")
    assert scan(path).size == pytest.approx((130 * 0.0125, 120 * 0.0125))


AXES = {"a corner left empty": "", "a zero in the corner": "0", "names in the corner": "x [mm]/y [mm]"}


@pytest.mark.parametrize("corner", AXES)
def test_places_in_the_first_row_and_column_are_no_heights(tmp_path: Path, corner: str) -> None:
    rows = [",".join([AXES[corner], *(f"{0.02 * j:.3f}" for j in range(120))])]
    rows += [
        f"{0.01 * i:.3f}," + ",".join(f"{1e3 * z:.6f}" for z in row) for i, row in enumerate(HEIGHTS_HERE.tolist())
    ]
    path = tmp_path / "a.csv"
    path.write_text("\n".join(rows) + "\n")
    found = scan(path, unit="um")
    assert found.heights.shape == HEIGHTS_HERE.shape
    assert found.spacing == pytest.approx((0.01, 0.02))
    assert found.done[0] == "first row and first column taken for places of columns and rows"
    assert ("places taken for mm: no unit was given" in found.done) is ("mm" not in AXES[corner])
    if "mm" not in AXES[corner]:
        assert scan(path, unit="um", spacing=(0.02, 0.04)).spacing == (0.02, 0.04)
    path.write_text("# spacing = 10, 20 µm\n" + "\n".join(rows) + "\n")
    assert scan(path, unit="um").spacing == pytest.approx((0.01, 0.02))
    path.write_text("# spacing = 11, 20 µm\n" + "\n".join(rows) + "\n")
    with pytest.raises(SurfaceError, match=r"by their places, and 0\.011 and 0\.02 mm by its head"):
        scan(path, unit="um")


def test_numbers_of_rows_and_columns_are_no_heights(tmp_path: Path) -> None:
    table = [[f"{1e3 * z:.6f}" for z in row] for row in HEIGHTS_HERE.tolist()]
    count = [str(j) for j in range(120)]
    for rows, told in (
        ([count, *table], "first row taken for numbers of the columns"),
        ([[str(i + 1), *row] for i, row in enumerate(table)], "first column taken for numbers of the rows"),
        ([["", *count], *([str(i), *row] for i, row in enumerate(table))], "numbers of columns and rows"),
    ):
        (tmp_path / "a.csv").write_text("\n".join(map(",".join, rows)) + "\n")
        found = scan(tmp_path / "a.csv", unit="um", spacing=0.01)
        assert found.heights.shape == HEIGHTS_HERE.shape
        assert told in found.done[0]
    rows = [[f"{0.01 * i:.2f}", *row] for i, row in enumerate(table)]
    (tmp_path / "a.csv").write_text("\n".join(map(",".join, rows)) + "\n")
    with pytest.raises(SurfaceError, match="its first column rises in even steps"):
        scan(tmp_path / "a.csv", unit="um", spacing=0.01)


def points(order: str, head: str, turned: bool = False) -> str:
    """A list of points, its columns in this order."""
    columns = dict(zip("xyz", (*np.indices(HEIGHTS_HERE.shape) * 0.01, 1e3 * HEIGHTS_HERE), strict=True))
    columns["i"] = np.ones(HEIGHTS_HERE.shape)
    rows = np.stack([columns[name].ravel() for name in order], axis=1)
    return head + "\n".join(" ".join(f"{value:.6f}" for value in row) for row in rows) + "\n"


@pytest.mark.parametrize(
    ("order", "head"),
    [
        ("yxz", "# y [mm] x [mm] z [µm]\n"),
        ("zxy", "z(µm) x(mm) y(mm)\n"),
        ("yxz", "Y_mm X_mm Z_um\n"),
        ("xyiz", "x[mm] y[mm] intensity z[µm]\n"),
        ("xyzi", "# x [mm] y [mm] z [µm]\n"),
    ],
)
def test_columns_of_points_are_taken_by_their_names(tmp_path: Path, order: str, head: str) -> None:
    (tmp_path / "a.xyz").write_text(points(order, head))
    raw = read_scan(tmp_path / "a.xyz")
    assert raw.unit == 1e-3
    assert np.allclose(raw.heights, 1e3 * HEIGHTS_HERE, atol=1e-5)
    assert raw.remarks.done != ()


def test_points_that_are_there_twice_are_told(tmp_path: Path) -> None:
    text = points("xyz", "# x [mm] y [mm] z [µm]\n")
    lines = text.splitlines()
    again = [" ".join([*line.split()[:2], f"{float(line.split()[2]) + 0.5:.6f}"]) for line in lines[1:51]]
    for name in ("a.xyz", "a.csv"):
        (tmp_path / name).write_text("\n".join([*lines, *again, ""]))
        found = scan(tmp_path / name)
        assert found.doubts[0] == "50 of its places have two heights or more, their mean is taken"
        raw = read_scan(tmp_path / name)
        assert np.allclose((raw.heights - 1e3 * HEIGHTS_HERE).ravel()[:51], [0.25] * 50 + [0.0], atol=1e-5)
    (tmp_path / "a.xyz").write_text("\n".join([*lines, *lines[1:]]))
    assert scan(tmp_path / "a.xyz").doubts == ()
    other = [line[:-1] + ("1" if line[-1] == "0" else "0") for line in lines[1:]]
    (tmp_path / "a.xyz").write_text("\n".join([*lines, *other]))
    with pytest.raises(SurfaceError, match="of its places have two heights: are there two scans in it"):
        scan(tmp_path / "a.xyz")


@pytest.mark.parametrize("written", ["Âµm", "Î¼m", "?m", "\ufffdm", "æm"])
def test_a_micrometre_is_known_in_a_broken_encoding(written: str) -> None:
    assert length_unit(written) == 1e-3


def test_units_of_digital_surf_may_be_utf8(tmp_path: Path) -> None:
    data = bytearray(scans.sur(HEIGHTS_HERE, (0.01, 0.01)))
    for at in (180, 212):
        data[at : at + 16] = "µm".encode().ljust(16, b"\0")
    (tmp_path / "a.sur").write_bytes(data)
    assert read_scan(tmp_path / "a.sur").unit == 1e-3


def test_a_cast_is_turned_over(tmp_path: Path) -> None:
    path = written(tmp_path, "# heights [µm]\n# spacing = 10 µm\n")
    found, cast = scan(path), scan(path, invert=True)
    assert np.allclose(cast.heights, -found.heights, atol=1e-15)
    assert "heights turned over (invert)" in cast.done


@pytest.mark.parametrize("line", ["depth into the metal [µm]", "heights [µm], inverted: yes", "Abdruck der Bohrung"])
def test_heights_that_may_go_into_the_metal_are_doubted(tmp_path: Path, line: str) -> None:
    path = written(tmp_path, f"# heights [µm]\n# spacing = 10 µm\n# {line}\n")
    (doubt,) = (each for each in scan(path).doubts if "out of the metal" in each)
    assert doubt.startswith(f"line 3: '# {line}'")
    assert not any("out of the metal" in each for each in scan(path, invert=True).doubts)


@pytest.mark.parametrize("separator", [",", ";", "\t"])
@pytest.mark.parametrize("trailing", [False, True])
def test_cells_left_empty_were_not_measured(tmp_path: Path, separator: str, trailing: bool) -> None:
    """At the end of a line too, in the first one, and along a whole line."""
    table = HEIGHTS_HERE.copy()
    table[0, -2:] = table[7, 3] = table[9, -5:] = table[40] = np.nan
    rows = [separator.join("" if z != z else f"{1e3 * z:.6f}" for z in row) for row in table.tolist()]
    text = "".join(row + separator * trailing + "\n" for row in rows)
    (tmp_path / "a.csv").write_text("% heights [µm]\n% x spacing = 10 µm; y spacing = 10 µm\n" + text)
    raw = read_scan(tmp_path / "a.csv")
    assert np.array_equal(np.isnan(raw.heights), np.isnan(table))
    assert np.nanmax(np.abs(raw.heights - 1e3 * table)) < 1e-6
    (tmp_path / "a.csv").write_text(text.replace(rows[20], rows[20].rpartition(separator)[0]))
    if not trailing:
        with pytest.raises(SurfaceError, match="line 21: has 119 heights, others 120"):
            read_scan(tmp_path / "a.csv")


@pytest.mark.parametrize("name", ["dx", "pixel_size", "step"])
def test_an_array_that_speaks_of_the_spacing_is_never_dropped(tmp_path: Path, name: str) -> None:
    np.savez(tmp_path / "a.npz", heights=HEIGHTS_HERE, **{name: 0.01})
    with pytest.raises(SurfaceError, match=f"is not understood: its array '{name}' is not taken"):
        scan(tmp_path / "a.npz")
    assert f"its array '{name}' is not taken" in " ".join(scan(tmp_path / "a.npz", spacing=0.01).done)
    np.savez(tmp_path / "b.npz", heights=HEIGHTS_HERE, spacing=0.01, **{name: 7.0})
    assert scan(tmp_path / "b.npz").spacing == (0.01, 0.01)
