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
from macrofit.identify.fit import IdentificationError, fit_parameter, identify, neighbour_correlation
from macrofit.identify.measured import Measured, read_measured
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
        ("1,2\n1,3\n", "line 2: displacement 1 after 1; they must ascend"),
        ("1,2\n3,3\n2,3\n", "line 3: displacement 2 after 3"),
        ("1\n2\n", "line 1: has no two columns"),
    ],
)
def test_a_curve_that_cannot_be_used_is_said(tmp_path, text, message):
    with pytest.raises(OutputError) as caught:
        read_measured(written(tmp_path, text))
    assert message in str(caught.value)


# the fit alone


@pytest.mark.parametrize("head", ["travel_mm,force_lbf", "travel [mm],force [daN]", "travel (inch),force (kN)"])
def test_a_unit_that_is_not_known_is_refused(tmp_path, head):
    with pytest.raises(OutputError, match="in its header is not known"):
        read_measured(written(tmp_path, head + "\n" + "".join(f"{k},{k}\n" for k in range(9))))


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


def test_a_trial_that_is_refused_is_taken_nearer():
    """The first guess for the forces of 0.118, 0.24, is refused by a network that knows up to 0.12."""

    def forward(p: float) -> np.ndarray:
        if p > 0.12:
            raise ProviderError("seen up to 0.12 only")
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
        (["--key", "title"], "not a number"),
        (["--bounds", "1"], "write low,high"),
        (["--bounds", "0.2,0.1"], "the lower bound must be below"),
        (["--bounds", "0.01,0.02"], "at the upper bound 0.02"),
    ],
)
def test_a_mistake_is_one_line_and_code_2(scene_file, arguments, message):
    measured = curve(small_press(), points=20)
    np.savetxt("m.csv", np.column_stack([measured.displacement, measured.force]), delimiter=",")
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
