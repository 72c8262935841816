"""Identification: what a measured file may look like, that the fit finds the value and states an honest error."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import rippled
from click.testing import CliRunner
from mpi4py import MPI
from small import small_press

from macrofit.cli import main
from macrofit.errors import OutputError, ProviderError, SceneError
from macrofit.friction import registry
from macrofit.identify.curves import derivative
from macrofit.identify.fit import TOLERANCE, IdentificationError, fit_parameter, identify, neighbour_correlation
from macrofit.identify.measured import Measured, Reading, read_measured
from macrofit.results.folder import CurveFile
from macrofit.scene import Scene, dump_scene, load_scene
from macrofit.solve import solve

COEFFICIENT, MICRO = "friction.options.coefficient", "friction.options.micro_friction"
PLACES = np.linspace(0.0, 1.0, 120)


@pytest.fixture(autouse=True)
def _rippled(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(registry.BUILT_IN, "rippled", rippled.ENTRY)


@pytest.fixture
def scene_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The small press in the current folder."""
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "small.toml"
    path.write_text(dump_scene(small_press()))
    return path


def curve(scene: Scene, noise: float = 0.0, seed: int = 0, points: int = 150) -> Measured:
    """The computed curve at other places than the increments, with noise relative to the largest force."""
    solution = solve(scene, MPI.COMM_SELF)
    at = np.linspace(15.2, 59.7, points)
    force = np.interp(at, solution.displacement, solution.force)
    deviation = noise * force.max()
    return Measured(at, force + deviation * np.random.default_rng(seed).standard_normal(points))


# reading


def written(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "measured.csv"
    path.write_text(text)
    return path


@pytest.mark.parametrize(
    "text",
    [
        "1,1000\n2,2000\n",
        "displacement_mm,force_N\n1,1000\n2,2000\n",
        "x [mm];F [kN]\n1,0;1,0\n2,0;2,0\n",
        "travel_m\tforce_MN\n0.001\t0.001\n0.002\t0.002\n",
        "# machine 3\n\n1  1e3\n2  2e3\n",
    ],
)
def test_ways_to_write_a_curve(tmp_path, text):
    found = read_measured(written(tmp_path, text))
    assert found.displacement == pytest.approx([1.0, 2.0], rel=1e-14)
    assert found.force == pytest.approx([1000.0, 2000.0], rel=1e-14)


def test_a_fitting_curve_of_ours_is_read(tmp_path):
    from fakes import fake_increment

    file = CurveFile(tmp_path)
    for k in range(3):
        file.increment(fake_increment(k, k / 3.0, 1e5 / (k + 3)))
    found = read_measured(tmp_path / "fitting_curve.csv")
    assert found.displacement.tolist() == [0.0, 1 / 3.0, 2 / 3.0]
    assert found.force.tolist() == [1e5 / 3, 1e5 / 4, 1e5 / 5]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "is empty"),
        ("1,2\n2,nan\n", "line 2: '2,nan' is not two finite numbers"),
        ("s,F\n1,2\n2,\n", "line 3: '2,' is not two finite numbers"),
        ("1,2\n2,x\n", "line 2"),
        ("1,2\n3,3\n2,3\n", "line 3: displacement 2 after 3 mm; they must ascend, for a curve of insertion alone"),
        ("3,2\n2,3\n1,3\n", "they descend: turn their sign"),
        ("1\n2\n", "line 1: '1' has no two columns of numbers"),
        ("s,F\n1,x\n2,3\n", "line 2: '1,x' is not two finite numbers; if it is no row of the curve, write #"),
        ("1,2\n2,3\nend of the record\n", "line 3: 'end of the record' is not two finite numbers"),
        ("0,0\n0,5,12\n", "line 2: has 3 cells, those before it 2"),
        ("1,1e999\n2,3\n", "line 1: '1,1e999' is not two finite numbers"),
        ("1,1e300\n2,3\n", "holds numbers beyond 1e+15"),
        ("x,F\n0,310,0,000\n1,647,5,250\n", "commas may be decimal signs and separators at once"),
        ("0.1,0,1.0\n0.2,1,2.0\n", "has 3 columns; which is the displacement, and which the force? Write --columns"),
        ("time [s],force [N]\n0,1\n1,2\n", "has 2 columns: time [s], force [N]; which is the displacement"),
        ("x [mm],F1 [kN],F2 [kN]\n0,1,2\n1,2,3\n", "has 3 columns"),
        ("0,0\n0,1\n100,2\n100,3\n50,4\n", "are they swapped? Write --columns 2,1"),
        ("x [mm],F [ton]\n0,1\n1,2\n", "unit 'ton' in its header is not known: write tf (1000 kg) or kip"),
        ("x [mm],F [mN]\n0,1\n1,2\n", "unit 'mN' in its header is not known: write MN or N"),
        ("x [furlong],F [kN]\n0,1\n1,2\n", "unit 'furlong' in its header is not known; take one of mm, cm, m"),
        ("x mm,load furlong\n0,1\n1,2\n", "unit 'furlong' in its header is not known; take one of N, daN"),
        ("x mm,load psi\n0,1\n1,2\n", "unit 'psi' in its header is not known; take one of N, daN"),
        ("PK\x03\x04", "is no text but a spreadsheet"),
        ("1,2\x00\n", "is no text in UTF-8"),
    ],
)
def test_a_curve_that_cannot_be_used_is_said(tmp_path, text, message):
    with pytest.raises(OutputError) as caught:
        read_measured(written(tmp_path, text))
    assert message in str(caught.value)


X = np.array([0.0, 0.31, 1.647, 2.984, 40.5, 53.79])
F = np.array([0.0, 0.0, 1234.5, 20000.0, 150000.0, 194466.0])


def lines_of(x: np.ndarray, f: np.ndarray, separator: str = ";", decimal: str = ".", form: str = "{:.4f}") -> str:
    """The rows of a curve."""
    rows = [
        separator.join(form.format(value).replace(".", decimal) for value in pair) for pair in zip(x, f, strict=True)
    ]
    return "".join(f"{row}\n" for row in rows)


@pytest.mark.parametrize(
    ("name", "factor"),
    [
        ("N", 1.0), ("daN", 10.0), ("kN", 1e3), ("MN", 1e6), ("kgf", 9.80665), ("kp", 9.80665), ("kg", 9.80665),
        ("tf", 9806.65), ("t", 9806.65), ("tonnes-force", 9806.65), ("lbf", 4.4482216), ("lbs", 4.4482216),
        ("kip", 4448.2216), ("kips", 4448.2216), ("KN", 1e3), ("kn", 1e3), ("Kilonewton", 1e3),
        ("pounds-force", 4.4482216), ("DAN", 10.0),
    ],
)  # fmt: skip
@pytest.mark.parametrize(
    "head",
    [
        "stroke [mm];Force [{}]", "Weg mm;Kraft {}", "x_mm;F_{}", "x / mm;F / {}", "Weg, mm;F, {}",
        "stroke;force\n[mm];[{}]", "stroke;force\nmm;{}", "mm;{}", "# x (mm);F ({})",
    ],
)  # fmt: skip
def test_forces_in_any_unit(tmp_path: Path, head: str, name: str, factor: float) -> None:
    found = read_measured(written(tmp_path, f"{head.format(name)}\n{lines_of(X, F / factor, form='{:.9g}')}"))
    assert found.force == pytest.approx(F, rel=1e-6)
    assert found.displacement == pytest.approx(X, rel=1e-6)
    assert found.assumed == ()


@pytest.mark.parametrize(
    ("name", "factor"),
    [("mm", 1.0), ("cm", 10.0), ("m", 1e3), ("in", 25.4), ("inch", 25.4), ("inches", 25.4), ("Millimetre", 1.0)],
)
def test_displacements_in_any_unit(tmp_path: Path, name: str, factor: float) -> None:
    for head in ("x [{}];F [N]", "Stroke {};Load N", "x_{};F_N"):
        found = read_measured(written(tmp_path, f"{head.format(name)}\n{lines_of(X / factor, F, form='{:.9g}')}"))
        assert found.displacement == pytest.approx(X, rel=1e-6)


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-16-be", "cp1252"])
@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
@pytest.mark.parametrize(
    ("separator", "decimal"), [(";", ","), (";", "."), ("\t", ","), (",", "."), ("  ", ","), ("  ", "."), ("|", ",")]
)
def test_what_programs_write(tmp_path: Path, encoding: str, end: str, separator: str, decimal: str) -> None:
    """Preamble, names with an umlaut, a row of units, any separator, decimal sign, encoding and end of line."""
    head = ["Prüfprotokoll", f"Prüfer{separator}Müller", "Nr. 5, Einpressen", separator.join(("Weg", "Kräfte")),
            separator.join(("[mm]", "[kN]"))]  # fmt: skip
    text = "\n".join(head) + "\n" + lines_of(X, F / 1e3, separator, decimal)
    path = tmp_path / "m.csv"
    path.write_bytes(text.replace("\n", end).encode(encoding))
    found = read_measured(path)
    assert found.displacement == pytest.approx(X, abs=1e-9)
    assert found.force == pytest.approx(F, abs=1e-9)


@pytest.mark.parametrize(
    "text",
    [
        "t [s];x [mm];F [kN]\n0;1,5;1,0\n1;2,5;2,0\n",
        "Zeit;Kraft;Weg\ns;kN;mm\n0;1,0;1,5\n1;2,0;2,5\n",
        "Zeit;Weg;Kraft;Öldruck\ns;mm;kN;bar\n0;1,5;1,0;9\n1;2,5;2,0;9\n",
        "Zeit;Weg;Kraft;Öl;Temperatur\ns;mm;kN;l/min;°C\n0;1,5;1,0;9;20\n1;2,5;2,0;9;20\n",
        "Zeit;Weg;Kraft;Nr;Bemerkung\ns;mm;kN;;\n0;1,5;1,0;1;\n1;2,5;2,0;2;\n",
        "Kraft [kN];Weg [mm]\n1,0;1,5\n2,0;2,5\n",
        "F [kN];x\n1,0;1,5\n2,0;2,5\n",
        "date;x_mm;force_kN;temperature\n01.02.24 12:00;1,5;1,0;21\n01.02.24 12:01;2,5;2,0;21\n",
        "time,travel,load\n0,1.5,1000\n1,2.5,2000\n",
        'x [mm],F [N]\n1.5,"1,000.0"\n2.5,"2,000.0"\n',
        "x [mm];F [N]\n1,5;1.000,0\n2,5;2.000,0\n",
        "x [mm];F [N]\n1,5;1 000,0\n2,5;2 000,0\n",
        "sep=;\nx [mm];F [kN];\n1.5;1.0;\n\n2.5;2.0;\n;;\n",
        "x [mm]\tF [N]\n1.5D0\t1.0D+3\n2.5D0\t2.0D+3\n",
    ],
)
def test_columns_are_known_by_their_units_and_names(tmp_path: Path, text: str) -> None:
    found = read_measured(written(tmp_path, text))
    assert found.displacement.tolist() == [1.5, 2.5]
    assert found.force.tolist() == [1000.0, 2000.0]


def test_columns_shift_from_and_to(tmp_path: Path) -> None:
    path = written(tmp_path, "a;b;c\n0;0;10\n1;0;20\n2;1;30\n3;2;40\n4;3;50\n5;2;0\n")
    for columns in (("2", "3"), ("b", "c")):
        found = read_measured(path, Reading(columns=columns, start=1.0, end=3.0, shift=5.0))
        assert found.displacement.tolist() == [6.0, 7.0, 8.0]
        assert found.force.tolist() == [30.0, 40.0, 50.0]
    assert (
        'displacement column 2 "b" [mm, assumed], force column 3 "c" [N, assumed], 3 rows from 1 to 3 mm' in found.taken
    )
    assert found.assumed == ("mm", "N")
    with pytest.raises(OutputError, match="no column '4'; take numbers from 1 to 3"):
        read_measured(path, Reading(columns=("1", "4")))
    with pytest.raises(OutputError, match="nothing lies between --from and --to; the displacements are 0 to 3 mm"):
        read_measured(path, Reading(columns=("b", "c"), start=9.0))
    with pytest.raises(
        OutputError, match=r"line 7: displacement 2 after 3 mm; .* end the record before it with --to 3"
    ):
        read_measured(path, Reading(columns=("b", "c")))


def test_a_record_sampled_in_time_is_averaged_where_it_rests(tmp_path: Path) -> None:
    """Resting and jittering displacements, 0.02 mm of 50: the straight line F = 3 x that lies below comes out."""
    rng = np.random.default_rng(1)
    true = np.clip(np.linspace(-20.0, 70.0, 9000), 0.0, 50.0)
    path = written(tmp_path, "x [mm],F [kN]\n" + lines_of(true + rng.normal(0.0, 0.02, 9000).round(3), 3.0 * true, ","))
    found = read_measured(path)
    assert (np.diff(found.displacement) > 0.0).all()
    assert len(found.force) > 500
    assert "averaged to" in found.taken
    assert np.abs(found.force / 1e3 - 3.0 * found.displacement).max() < 3.0 * 0.08


LETTING_GO = {
    "at rest": [(180.0, 400.0), (180.0, 30.0), (180.0, 0.0)],
    "springing back": [(179.98, 500.0), (179.9, 1.0)],
    "with noise": [(180.05, 850.0), (179.99, 200.0), (180.02, 0.0)],
}


@pytest.mark.parametrize("how", LETTING_GO)
def test_the_press_that_lets_go_is_no_part_of_the_curve(how: str, tmp_path: Path) -> None:
    """Averaged with the end of the pressing it halved the last force; the rows that are left out are told."""
    pressing = [(float(x), 5.0 * x) for x in range(0, 181, 2)]
    rows = [*pressing, *LETTING_GO[how]]
    text = "displacement_mm,force_kN\n" + "".join(f"{x},{f}\n" for x, f in rows)
    found = read_measured(written(tmp_path, text))
    assert (found.displacement[-1], found.force[-1]) == (180.0, pytest.approx(900e3))
    assert f"left out: the last {len(LETTING_GO[how])} rows, in which the press lets go" in found.taken


@pytest.mark.parametrize(
    "end", [[(182.0, 100.0)], [(180.4, 300.0)], [(180.0, 880.0), (180.0, 870.0)], [(180.0, 905.0)]]
)
def test_what_still_moves_or_holds_is_part_of_the_curve(end: list[tuple[float, float]], tmp_path: Path) -> None:
    """A groove at the end of the way, a press that holds, and one that still rises at rest."""
    rows = [*((float(x), 5.0 * x) for x in range(0, 181, 2)), *end]
    text = "displacement_mm,force_kN\n" + "".join(f"{x},{f}\n" for x, f in rows)
    found = read_measured(written(tmp_path, text))
    assert "lets go" not in found.taken
    assert found.displacement[-1] == end[-1][0]


# the fit alone


def test_a_linear_model_is_solved_exactly():
    """F = F0 + p G: the value and the error are those of linear regression through the normal equation."""
    rng = np.random.default_rng(5)
    base, slope = 3.0 + PLACES, 20.0 * PLACES
    measured = base + 0.3 * slope + 0.1 * rng.standard_normal(len(PLACES))
    found = fit_parameter(lambda p: base + p * slope, measured, 0.1, (0.0, 1.0))
    best = float(slope @ (measured - base) / (slope @ slope))
    assert found.value == pytest.approx(best, rel=2e-4)  # the tolerance of a step
    residual = measured - base - best * slope
    sigma = np.sqrt(residual @ residual / (len(PLACES) - 1))
    assert found.standard_error == pytest.approx(sigma / np.sqrt(slope @ slope), rel=1e-3)
    assert len(found.trials) <= 4


@pytest.mark.parametrize("start", [0.9, 1.0, 1.1])
def test_a_curve_that_bends_is_tried_where_the_step_is_not_sure(start):
    """exp(8 p): a step of 4 % is wrong by a tenth of itself, and the value is found to 1e-4 of it all the same."""
    found = fit_parameter(lambda p: PLACES * np.exp(8.0 * p), PLACES * np.exp(8.0 * 1.04), start, (0.1, 5.0))
    assert found.value == pytest.approx(1.04, rel=TOLERANCE)


def test_values_that_are_too_near_say_nothing_of_the_slope():
    """The curves of values 1e-9 apart differ by rounding; the next one is taken."""
    known = {p: PLACES * p + 1e-8 * (p == 1.0 + 1e-9) for p in (1.0, 1.0 + 1e-9, 1.1)}
    assert derivative(known, 1.0, 1e-3).slope == pytest.approx(PLACES, abs=1e-12)
    assert derivative({p: PLACES * p for p in (1.0, 1.0 + 1e-4)}, 1.0, 1e-3).slope == pytest.approx(PLACES, abs=1e-9)


def test_the_stated_error_covers_the_truth():
    """Of 400 replicas the 95 % interval holds the truth in 95 %, within 3 standard deviations of the binomial law."""
    truth = 0.07

    def forward(p: float) -> np.ndarray:
        return 1e6 * (p + p**2) * PLACES**0.7

    covered = 0
    for seed in range(400):
        noise = 0.01 * forward(truth).max() * np.random.default_rng(seed).standard_normal(len(PLACES))
        found = fit_parameter(forward, forward(truth) + noise, 0.05, (0.0, 1.0))
        covered += abs(found.value - truth) <= 1.96 * found.standard_error
    assert abs(covered / 400 - 0.95) <= 3.0 * np.sqrt(0.95 * 0.05 / 400)


def test_correlated_residuals_widen_the_error():
    """Noise r_i = 0.9 r_(i-1) + e_i: the wider error covers the truth where the plain one does not."""
    rng = np.random.default_rng(3)
    x = np.linspace(0.5, 1.0, 400)
    plain = wide = 0
    for _ in range(100):
        noise = np.zeros(len(x))
        for i in range(1, len(x)):
            noise[i] = 0.9 * noise[i - 1] + 0.01 * rng.standard_normal()
        found = fit_parameter(lambda p: p * x, 0.3 * x + noise, 0.2, (0.0, 1.0))
        plain += abs(found.value - 0.3) <= 1.96 * found.standard_error
        wide += abs(found.value - 0.3) <= 1.96 * found.standard_error_correlated
    assert plain < 65
    assert wide >= 85
    assert neighbour_correlation(np.ones(1000)) == pytest.approx(0.999)


@pytest.mark.parametrize(("truth", "side"), [(0.9, "upper bound 0.5"), (0.01, "lower bound 0.1")])
def test_a_value_at_a_bound_is_an_error(truth, side):
    with pytest.raises(IdentificationError, match=side):
        fit_parameter(lambda p: p * PLACES, truth * PLACES, 0.3, (0.1, 0.5))


def test_a_curve_that_does_not_depend_on_the_value():
    with pytest.raises(IdentificationError, match="does not depend on the parameter"):
        fit_parameter(lambda p: PLACES, 2.0 * PLACES, 0.3, (0.1, 0.5))


@pytest.mark.parametrize("refusal", [ProviderError, SceneError])
def test_a_trial_that_is_refused_is_taken_nearer(refusal):
    """The first guess for the forces of 0.118, 0.24, is refused by a network or a scene that goes up to 0.12."""

    def forward(p: float) -> np.ndarray:
        if p > 0.12:
            raise refusal("seen up to 0.12 only")
        return (p - 0.04) * PLACES

    assert fit_parameter(forward, 0.078 * PLACES, 0.05, (0.0, 0.5)).value == pytest.approx(0.118, rel=1e-4)
    with pytest.raises(IdentificationError, match=r"seen up to 0\.12 only"):
        fit_parameter(forward, 0.2 * PLACES, 0.05, (0.0, 0.5))


# with the solver


@pytest.mark.parametrize("seed", range(4))
def test_the_micro_coefficient_is_found_from_a_noisy_curve(scene_file, seed):
    """1 % noise: within 3 %, and within four of its own errors."""
    make = ["friction.provider=rippled", "friction.options.seed=4"]
    measured = curve(load_scene(scene_file, [*make, f"{MICRO}=0.055"]), 0.01, seed)
    found = identify(scene_file, measured, make)
    assert found.key == MICRO
    assert found.fit.value == pytest.approx(0.055, rel=0.03)
    assert abs(found.fit.value - 0.055) <= 4.0 * found.fit.standard_error
    assert found.fit.standard_error < 0.005 * found.fit.value
    assert 3 <= len(found.fit.trials) <= 6
    assert found.factorisations == 2  # one of each body, no stresses


def test_one_provider_matches_the_curve_of_another(scene_file):
    """0.02 + micro = 0.11 without ripple: the micro coefficient that matches uniform 0.11 is 0.09."""
    measured = curve(load_scene(scene_file, [f"{COEFFICIENT}=0.11"]))
    found = identify(scene_file, measured, ["friction.provider=rippled", "friction.options.ripple=0.0"])
    assert found.fit.value == pytest.approx(0.09, rel=1e-4)
    found = identify(scene_file, measured, ["friction.provider=rippled"])
    assert found.fit.value == pytest.approx(0.09, rel=0.05)  # the ripple's mean over the pairs is not quite 0
    assert found.fit.correlation > 0.3


def test_any_number_of_the_scene_can_be_sought(scene_file):
    """The bore's radius, hence the interference; its bodies are factored for every trial."""
    measured = curve(load_scene(scene_file, ["wheel.bore_radius=94.75"]))
    found = identify(scene_file, measured, key="wheel.bore_radius", bounds=(94.6, 94.9))
    assert found.fit.value == pytest.approx(94.75, abs=1e-3)
    assert found.factorisations == 2 * len(found.fit.trials)


@pytest.mark.parametrize(
    ("scale", "message"),
    [((1.0, 1e-3), "is the column in kN"), ((1.0, 1e-6), "is the column in MN"), ((1.0, -1.0), "other sign"),
     ((1e-3, 1.0), "is the column in m?"), ((10.0, 1.0), "have 0 points in common")],
)  # fmt: skip
def test_implausible_units_are_said(scene_file, scale, message):
    measured = curve(small_press(), points=20)
    wrong = Measured(measured.displacement * scale[0], measured.force * scale[1])
    with pytest.raises(OutputError) as caught:
        identify(scene_file, wrong)
    assert message in str(caught.value)


@pytest.mark.parametrize(("unit", "factor"), [("daN", 10.0), ("kgf", 9.80665), ("lbf", 4.448), ("tf", 9806.65)])
def test_assumed_newtons_are_held_to_a_narrow_range(scene_file: Path, unit: str, factor: float) -> None:
    """Without a word in the file, 0.148 in decanewtons would be 0.0148 in newtons."""
    measured = curve(small_press(f"{COEFFICIENT}=0.11"), points=20)
    wrong = Measured(measured.displacement, measured.force / factor, assumed=("mm", "N"))
    with pytest.raises(OutputError, match=rf"is the column in .*\b{unit}\b.*; .*|is the column in .*{unit}"):
        identify(scene_file, wrong)


@pytest.mark.parametrize("late", [5.0, -3.0])
def test_an_offset_of_the_displacements_is_proposed_and_found(scene_file: Path, late: float) -> None:
    """The record's zero is elsewhere: said by the residual, and found with the coefficient."""
    scene = small_press(f"{COEFFICIENT}=0.15")
    solution = solve(scene, MPI.COMM_SELF)
    at = np.linspace(16.0, 59.0, 150)
    moved = Measured(at - late, np.interp(at, solution.displacement, solution.force))
    plain = identify(scene_file, moved)
    assert plain.fit.value != pytest.approx(0.15, rel=0.01)
    assert plain.proposal is not None
    assert plain.proposal.shift == pytest.approx(late, abs=0.1)  # dF/dp is a secant
    assert plain.fit.value + plain.proposal.step == pytest.approx(0.15, rel=5e-3)
    found = identify(scene_file, moved, free_shift=True)
    assert found.fit.value == pytest.approx(0.15, rel=1e-4)
    assert found.shift == pytest.approx(late, abs=2e-3)
    assert found.proposal is None


def test_the_error_beside_a_free_offset_covers_the_truth(scene_file: Path) -> None:
    """1 % noise, 5 mm late: value and offset within four of their own errors, which are wider than one alone."""
    for seed in range(3):
        measured = curve(small_press(f"{COEFFICIENT}=0.15"), 0.01, seed)
        moved = Measured(measured.displacement - 5.0, measured.force)
        found = identify(scene_file, moved, free_shift=True)
        assert found.shift_error is not None
        assert abs(found.fit.value - 0.15) <= 4.0 * found.fit.standard_error
        assert abs(found.shift - 5.0) <= 4.0 * found.shift_error
        assert found.fit.standard_error > identify(scene_file, measured).fit.standard_error
        assert identify(scene_file, measured).proposal is None


def test_a_motion_that_turns_back_is_refused(scene_file):
    with pytest.raises(SceneError, match="must ascend"):
        identify(scene_file, curve(small_press(), points=20), ["motion={displacements=[15,40,20]}"])


def test_the_command_writes_its_files(scene_file):
    measured = curve(small_press(f"{COEFFICIENT}=0.13"), 0.01, points=80)
    table = np.column_stack([measured.displacement, measured.force / 1e3])
    np.savetxt("m.csv", table, delimiter=",", header="travel_mm,force_kN", comments="")
    shown = CliRunner(mix_stderr=False).invoke(main, ["identify", str(scene_file), "--curve", "m.csv", "-o", "out"])
    assert shown.exit_code == 0, shown.stderr
    numbers = json.loads(Path("out/identification.json").read_text())
    assert numbers["value"] == pytest.approx(0.13, rel=0.03)
    assert numbers["standard_error"] > 0.0
    assert f"{COEFFICIENT} = 0.1" in shown.stdout
    assert {path.name for path in Path("out").iterdir()} == {
        "identification.json", "identification.png", "identified_curve.csv"
    }  # fmt: skip


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--key", "friction.options.micro"], "no option of friction provider 'uniform'"),
        (["--key", "wheel.bore"], "wheel.bore: no such key"),
        (["--key", "motion.increment"], "motion.increment: changes where forces are computed"),
        (["--key", "title"], "not a number"),
        (["--bounds", "1"], "write low,high"),
        (["--bounds", "0.2,0.1"], "the lower bound must be below"),
        (["--bounds", "0.01,0.02"], "at the upper bound 0.02"),
    ],
)
def test_a_mistake_is_one_line_and_code_2(scene_file, arguments, message):
    measured = curve(small_press(), points=20)
    head = "displacement_mm,force_N"
    np.savetxt("m.csv", np.column_stack([measured.displacement, measured.force]), delimiter=",", header=head)
    shown = CliRunner(mix_stderr=False).invoke(main, ["identify", str(scene_file), "--curve", "m.csv", *arguments])
    assert shown.exit_code == 2, shown.stderr
    assert message in shown.stderr
    assert shown.stderr.count("\n") == 1


def test_a_law_of_a_script_is_identified(scene_file: Path) -> None:
    """Its class, an option of which is sought; an object has no options left, but the scene has other keys."""
    micro = {"micro_friction": 0.06, "ripple": 0.0}
    measured = curve(small_press("friction.provider=rippled", "friction.options={micro_friction=0.06, ripple=0.0}"))
    found = identify(scene_file, measured, ["friction.options.ripple=0.0"], friction=rippled.Rippled)
    assert found.fit.value == pytest.approx(0.06, abs=1e-4)
    assert found.scene.friction.provider == "rippled:Rippled"
    given = rippled.Rippled(**micro)
    with pytest.raises(SceneError, match="rippled:Rippled: is an object whose options cannot be identified"):
        identify(scene_file, measured, friction=given)
    found = identify(scene_file, measured, key="wheel.bore_radius", bounds=(94.6, 94.9), friction=given)
    assert found.fit.value == pytest.approx(load_scene(scene_file).wheel.bore_radius, abs=1e-4)
