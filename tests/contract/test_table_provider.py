"""The provider `table`: coefficients from a CSV file, along the seat or for each pair of tiles."""

from __future__ import annotations

from pathlib import Path

import msgspec
import numpy as np
import pytest
from small import small_press

from macrofit.errors import ProviderError
from macrofit.friction import BuildContext, FloatArray, FrictionProvider, TilePairs, build, load
from macrofit.friction.conformance import check
from macrofit.results.journal import Journal
from macrofit.scene import Scene, dump_scene, load_scene
from macrofit.solve import solve

CONTEXT = BuildContext(
    seat_tiles=8, bore_tiles=8, tile_size=2.0, seat_origin=-5.0, youngs_modulus=206e3, poisson_ratio=0.3
)
ALONG = "z_mm,coefficient,uncertainty\n0,0.1,0.01\n10,0.2,0.03\n"
SQUARE = "seat,bore,coefficient\n" + "".join(
    f"{k},{j},{0.1 + 0.01 * k + 0.001 * j}\n" for k in range(8) for j in range(8)
)


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return tmp_path / "measured.csv"


def made(file: Path, text: str) -> FrictionProvider:
    file.write_text(text)
    return build("table", {"file": str(file)}, CONTEXT)


def asked(seat: list[int], bore: list[int] | None = None) -> TilePairs:
    tiles = np.array(seat, dtype=np.int64), np.array(bore or [0] * len(seat), dtype=np.int64)
    return TilePairs(*tiles, np.zeros(len(seat)), np.zeros(len(seat)))


@pytest.mark.parametrize("text", [ALONG, SQUARE], ids=["along", "pairs"])
def test_it_keeps_the_contract_to_the_bit(file: Path, text: str) -> None:
    provider = made(file, text)
    assert provider.depends_on == {"tiles"}
    check(provider, tolerance=0.0)


def test_along_the_seat_it_is_linear_at_the_middle_of_the_tile(file: Path) -> None:
    """Tiles of 2 mm from z = -5 mm: their middles are -4, -2, 0, 2, ..., 8, 10, 12, 14 mm."""
    provider = made(file, ALONG)
    expected = [0.1, 0.1, 0.12, 0.18, 0.2, 0.2]
    found = provider.coefficients(asked([0, 2, 3, 6, 7, 9]))
    np.testing.assert_allclose(found, expected, rtol=1e-14)
    np.testing.assert_allclose(provider.uncertainty(asked([0, 3, 9])), [0.01, 0.014, 0.03], rtol=1e-14)  # type: ignore[attr-defined]


def test_by_pair_it_is_what_is_listed(file: Path) -> None:
    provider = made(file, "bore, coefficient ,seat\n\n# two pairs\n5,0.3,1\n0,0.25,7\n")
    assert provider.coefficients(asked([7, 1, 7], [0, 5, 0])).tolist() == [0.25, 0.3, 0.25]
    assert np.isnan(provider.uncertainty(asked([7], [0]))).all()  # type: ignore[attr-defined]
    with pytest.raises(ProviderError, match=r"measured\.csv has no row for seat tile 1 and bore tile 4"):
        provider.coefficients(asked([7, 1], [0, 4]))


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("", "is empty"),
        ("# nothing\n", "is empty"),
        ("z_mm,coefficient\n", "has no rows"),
        ("0,0.1\n1,0.2\n", "line 1: the columns are '0,0.1'; take z_mm,coefficient or seat,bore,coefficient"),
        ("z,coefficient\n0,0.1\n", "line 1: the columns are 'z,coefficient'"),
        ("z_mm;coefficient\n0;0.1\n", "line 1: the columns are"),
        ("z_mm,coefficient,coefficient\n0,0.1,0.1\n", "line 1: the columns are"),
        ("seat,bore,coefficient,z_mm\n0,0,0.1,0\n", "line 1: the columns are"),
        ("z_mm,coefficient\n0,0.1\n\n1\n", "line 4: has 1 cells, not 2: '1'"),
        ("z_mm,coefficient\n0,0.1,0.2\n", "line 2: has 3 cells, not 2"),
        ("z_mm,coefficient\n0,rough\n", "line 2: coefficient is 'rough', not a number"),
        ("z_mm,coefficient\n0,\n", "line 2: coefficient is '', not a number"),
        ("z_mm,coefficient\n0,nan\n", "line 2: coefficient is nan, not a finite number"),
        ("z_mm,coefficient\ninf,0.1\n", "line 2: z_mm is inf, not a finite number"),
        ("z_mm,coefficient\n0,0.1\n1,-0.1\n", "line 3: coefficient is -0.1; take 0 <= coefficient < 2"),
        ("z_mm,coefficient\n0,2\n", "line 2: coefficient is 2; take"),
        ("z_mm,coefficient,uncertainty\n0,0.1,-0.01\n", "line 2: uncertainty is -0.01; take 0 <= uncertainty"),
        ("z_mm,coefficient\n0,0.1\n0.0,0.2\n", "line 3: z_mm = 0 already stands in line 2"),
        ("z_mm,coefficient\n5,0.1\n2,0.2\n", "line 3: z_mm = 2 follows 5; sort the rows"),
        (
            "seat,bore,coefficient\n3,0,0.1\n1,0,0.1\n3,0,0.2\n",
            "line 4: seat tile 3 and bore tile 0 already stands in line 2",
        ),
        ("seat,bore,coefficient\n0.5,0,0.1\n", "line 2: seat is 0.5, not the number of a tile"),
        ("seat,bore,coefficient\n0,-1,0.1\n", "line 2: bore is -1, not the number of a tile"),
    ],
)
def test_a_wrong_file_is_told_with_its_line(file: Path, text: str, told: str) -> None:
    file.write_text(text)
    with pytest.raises(ProviderError) as caught:
        load("table", {"file": str(file)})
    assert "friction.options.file" in str(caught.value)
    assert str(file) in str(caught.value)
    assert told in str(caught.value)


def test_a_file_that_cannot_be_read_is_named(tmp_path: Path) -> None:
    with pytest.raises(ProviderError, match=r"friction.options.file: .*none\.csv: cannot be read: No such file"):
        load("table", {"file": str(tmp_path / "none.csv")})
    (tmp_path / "binary.csv").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ProviderError, match=r"binary\.csv cannot be read: .*utf-8"):
        load("table", {"file": str(tmp_path / "binary.csv")})


def test_a_spreadsheet_may_mark_its_encoding(file: Path) -> None:
    file.write_bytes(b"\xef\xbb\xbfz_mm,coefficient\r\n0,0.25\r\n")
    assert build("table", {"file": str(file)}, CONTEXT).coefficients(asked([4])).tolist() == [0.25]


@pytest.mark.parametrize("nested", [False, True])
def test_a_scene_looks_for_the_file_beside_itself(
    tmp_path: Path, nested: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    options = 'base = "table"\nflat_coefficient = 0.1\noptions = { file = "mu.csv" }' if nested else 'file = "mu.csv"'
    text = dump_scene(small_press()).partition("[friction]")[0]
    (tmp_path / "fit.toml").write_text(
        f'{text}[friction]\nprovider = "{"evolving" if nested else "table"}"\n[friction.options]\n{options}\n'
    )
    absolute = str((tmp_path / "mu.csv").resolve())
    assert _file(load_scene(tmp_path / "fit.toml"), nested) == absolute
    monkeypatch.chdir(tmp_path)
    wheelset = load_scene("wheelset", ["friction.provider=table", "friction.options={file='mu.csv'}"])
    assert wheelset.friction.options == {"file": absolute}
    written = tmp_path / "deep" / "scene.toml"
    written.parent.mkdir()
    written.write_text(dump_scene(load_scene("fit.toml")))
    assert _file(load_scene(written), nested) == absolute


def _file(scene: Scene, nested: bool) -> object:
    options = scene.friction.options
    return options["options"]["file"] if nested else options["file"]


def test_the_tiles_of_a_run_start_where_the_seat_does(file: Path) -> None:
    """A facet's coefficient is the mean of mu at the middles of its tiles, counted from the taper's start at -10 mm."""
    file.write_text("z_mm,coefficient\n-10,0.05\n190,0.25\n")
    solution = solve(small_press("friction.provider=table", f"friction.options={{file='{file}'}}"))
    assert solution.seat[0] == -10.0
    edges = -10.0 + np.arange(201.0)
    integral = np.interp(solution.seat, edges, np.append(0.0, np.cumsum(0.06 + 1e-3 * (edges[:-1] + 0.5))))
    expected = np.diff(integral) / np.diff(solution.seat)
    last = solution.increments[-1].facets
    held = (last.pressure > 0.0) & (solution.seat[1:] < 44.0)  # wholly faced by the bore
    assert held.sum() >= 5
    np.testing.assert_allclose(last.friction[held], expected[held], rtol=1e-12)


def test_a_journal_is_of_one_table(file: Path) -> None:
    file.write_text("z_mm,coefficient\n0,0.1\n")
    scene = small_press("friction.provider=table", f"friction.options={{file='{file}'}}")
    with Journal.start(file.with_name("journal.bin"), scene):
        pass
    with Journal.resume(file.with_name("journal.bin"), scene):
        pass
    file.write_text("z_mm,coefficient\n0,0.2\n")
    with pytest.raises(Exception, match=r"another scene \(changed: content of friction\.options\.file\)"):
        Journal.resume(file.with_name("journal.bin"), scene)
    with pytest.raises(Exception, match=r"put the file back as it was, or run without --resume"):
        Journal.resume(file.with_name("journal.bin"), scene)
    other = small_press("friction.provider=table", f"friction.options={{file='{file}'}}", "motion.travel=50")
    with pytest.raises(Exception, match=r"back as it was and run with the scene.toml beside it, or run without"):
        Journal.resume(file.with_name("journal.bin"), other)
    file.unlink()
    with pytest.raises(Exception, match=r"content of friction\.options\.file"):
        Journal.resume(file.with_name("journal.bin"), scene)


def test_the_options_are_a_frozen_struct(file: Path) -> None:
    file.write_text(ALONG)
    options = load("table", {"file": str(file)})
    assert msgspec.to_builtins(options) == {"file": str(file)}
    values: FloatArray = options.build(CONTEXT).coefficients(asked([]))
    assert values.shape == (0,)


@pytest.mark.parametrize(("scale", "unit"), [(1e-3, "in m"), (1e3, "in µm")])
def test_places_in_another_unit_are_refused(file: Path, scale: float, unit: str) -> None:
    """The seat of 16 mm in metres would get the value of its far end everywhere, without a word."""
    with pytest.raises(ProviderError, match=rf"z_mm reaches from 0 to .*, the seat to 11 mm; are they {unit}\?"):
        made(file, f"z_mm,coefficient\n0,0.1\n{11 * scale},0.2\n")


def test_places_that_leave_most_of_the_seat_are_warned_of(file: Path) -> None:
    for text in ("z_mm,coefficient\n0,0.1\n7,0.2\n", "z_mm,coefficient\n10,0.1\n50,0.2\n"):
        with pytest.warns(UserWarning, match="beyond, the values of the ends are kept"):
            made(file, text)
    made(file, "z_mm,coefficient\n0,0.1\n")
