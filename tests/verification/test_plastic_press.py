"""A press whose steel yields: energy, what a killed run goes on from, release, turns, zones, studies."""

from __future__ import annotations

import csv
import dataclasses
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from found import Found
from mpi4py import MPI
from small import YIELDING, small_path, small_press, solved
from verification.plane_stress_ring import Ring, shrink_fit
from verification.test_plastic_oracle import press_of
from verification.test_plastic_rings import COMPLIANCE, NU, A, E, ring
from verification.test_restart import Memory, failing

from macrofit.assembly import assemble
from macrofit.cli import main
from macrofit.contact.status import OPEN
from macrofit.errors import ConvergenceError
from macrofit.identify.fit import identify
from macrofit.identify.measured import Measured
from macrofit.plasticity.law import overshoot
from macrofit.results.doubts import doubts
from macrofit.results.summary import sentences, summary
from macrofit.scene import Scene, dump_scene, load_scene
from macrofit.scene.keys import Motion
from macrofit.solution import Solution, energy_balance
from macrofit.solve import solve

TO_40 = ("motion.travel=40",)
RELEASE = "motion.release=true"
YIELD_420 = ("yield_stress=420", "hardening.law=linear", "hardening.kinematic=5000")


def same(one: Solution, other: Solution) -> bool:
    """To the bit: forces, facets, stresses, zones, plastic work."""
    pairs = list(zip(one.increments, other.increments, strict=True))
    return (
        (one.force == other.force).all()
        and all(a.facets.pressure.tobytes() == b.facets.pressure.tobytes() for a, b in pairs)
        and all((a.plastic_work, a.plastic_iterations) == (b.plastic_work, b.plastic_iterations) for a, b in pairs)
        and one.max_von_mises == other.max_von_mises
        and one.flowed == other.flowed
        and one.energy_balance == other.energy_balance
    )


def test_a_step_in_which_nothing_flows_ends() -> None:
    """After some flow, without friction: rounding was left of the plastic strain, and no step was short enough."""
    steel = ("yield_stress=350", "hardening.law=linear", "hardening.kinematic=1e4")
    bodies = [f"{body}.material.{key}" for body in ("axle", "wheel") for key in steel]
    smooth = ("friction.provider=uniform", "friction.options={coefficient = 0.0}")
    scene = load_scene("rough-hub", [*bodies, *smooth, "motion.travel=6", "output.stress=false", "output.fields_at=[]"])
    records = solved(scene).increments
    assert max(record.plastic_strain for record in records) > 1e-5
    assert not any(record.cutbacks for record in records)


def test_no_point_that_was_left_out_is_beyond_yield() -> None:
    """Two points are missed at first in this press, and taken in at the end of a step: 2 MPa beyond yield if not."""
    press = press_of(small_press(*YIELDING, *TO_40))
    yielding = press.yielding
    assert yielding is not None
    for _, state in press.increments(press.rest()):
        for (name, body), loads in zip(yielding.bodies.items(), (state.seat_load, state.bore_load), strict=True):
            assert state.flow is not None
            flow = state.flow[name].state
            stress = body.stress(body.ended(flow, loads).displacement, flow.strain)
            assert overshoot(stress, flow, body.law)[flow.accumulated == 0.0].max() < 0.1


def test_flow_that_does_not_settle_is_said_as_such(monkeypatch: pytest.MonkeyPatch) -> None:
    """... and not as contact that does not; what was computed before stays."""
    monkeypatch.setattr("macrofit.plasticity.yielding.LIMIT", 3)
    kept = Memory([])
    with pytest.raises(ConvergenceError, match=r"between displacements 12\.5 and .* mm .*material\.hardening"):
        solve(small_press(*YIELDING, "motion.start=5", "motion.max_cutbacks=2"), MPI.COMM_SELF, journal=kept)
    assert len(kept.kept) == 2


@pytest.mark.parametrize(
    ("hardening", "limit", "said"),
    [
        ("", 40, r"try material\.hardening .* along the surface at 144 MPa, its limit load"),
        (", hardening={law='linear', isotropic=500}", 20, r"try a smaller motion\.increment, or material\.hardening"),
    ],
)
def test_a_limit_load_is_said_as_such(hardening: str, limit: int, said: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where friction holds more than the surface ever bears in shear, neither iterations nor shorter steps help."""
    monkeypatch.setattr("macrofit.plasticity.yielding.LIMIT", limit)
    keys = [f"{body}.material={{yield_stress=250{hardening}}}" for body in ("axle", "wheel")]
    scene = small_press(*keys, "friction.options.coefficient=0.6", *TO_40, "motion.max_cutbacks=2")
    with pytest.raises(ConvergenceError, match=said):
        solve(scene, MPI.COMM_SELF)


# what a killed run goes on from


@pytest.fixture(scope="module")
def journalled() -> tuple[Solution, Memory]:
    """A run that nobody interrupts, which ends with its release, and its journal."""
    whole = Memory([])
    scene = small_press(*YIELDING, *TO_40, RELEASE, "output.stress=true")
    return solve(scene, MPI.COMM_SELF, journal=whole), whole


@pytest.mark.parametrize("kept", [1, 2, 4, 6, 7])
def test_resumed_is_uninterrupted(kept: int, journalled: tuple[Solution, Memory]) -> None:
    """6 increments are there: with 6 kept the run lacks its release alone, with 7 nothing."""
    uninterrupted, whole = journalled
    assert len(whole.kept) == 7
    memory = Memory(whole.kept[:kept])
    assert same(solve(uninterrupted.scene, MPI.COMM_SELF, journal=memory), uninterrupted)
    assert len(memory.kept) == 7


@pytest.mark.parametrize("kept", [1, 3])
def test_resumed_after_cutbacks(kept: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """An increment of several steps leaves what all of them changed."""
    failing(monkeypatch, 2.5)
    whole = Memory([])
    scene = small_press(*YIELDING, *TO_40, "output.stress=true")
    uninterrupted = solve(scene, MPI.COMM_SELF, journal=whole)
    assert [record.cutbacks for record in uninterrupted.increments[1:]] == [1] * 5
    assert same(solve(scene, MPI.COMM_SELF, journal=Memory(whole.kept[:kept])), uninterrupted)


def test_cut_back_increments_count_the_work_of_their_steps(monkeypatch: pytest.MonkeyPatch) -> None:
    """Increments of 5 mm that are halved have the energy balance of those of 2.5 mm, for they are the same."""
    fine = solve(small_press(*YIELDING, *TO_40, "motion.increment=2.5"), MPI.COMM_SELF)
    failing(monkeypatch, 2.5)
    cut = solve(small_press(*YIELDING, *TO_40), MPI.COMM_SELF)
    ends = sum(record.work for record in fine.increments)
    assert sum(record.work for record in cut.increments) == pytest.approx(ends, rel=1e-3)
    assert cut.energy_balance == pytest.approx(fine.energy_balance, rel=5e-2)


def test_a_killed_run_goes_on_to_the_same_files(tmp_path: Path) -> None:
    """By the command, the journal on disk: fitting_curve.csv, but for its times, and summary's plastic strain."""
    path = tmp_path / "scene.toml"
    path.write_text(dump_scene(small_press(*YIELDING, *TO_40, RELEASE, "output.stress=true")))
    kill = (
        "import os, signal, sys\nfrom macrofit.cli import main\nimport macrofit.press as press\n"
        "old, count = press.accepted, 0\ndef accepted(*words):\n    global count\n    count += 1\n"
        "    if count > 4: os.kill(os.getpid(), signal.SIGKILL)\n    return old(*words)\n"
        "press.accepted = accepted\nmain(sys.argv[1:])"
    )
    words = ["run", str(path), "--quiet", "-o"]
    killed = [sys.executable, "-c", kill, *words, str(tmp_path / "killed")]
    done = subprocess.run(killed, stdin=subprocess.DEVNULL, capture_output=True, check=False)
    assert done.returncode == -9
    runner = CliRunner()
    assert runner.invoke(main, [*words, str(tmp_path / "killed"), "--resume"]).exit_code == 0
    assert runner.invoke(main, [*words, str(tmp_path / "whole")]).exit_code == 0
    found = []
    for name in ("killed", "whole"):
        with (tmp_path / name / "fitting_curve.csv").open() as file:
            rows = [{key: value for key, value in row.items() if key != "wall_s"} for row in csv.DictReader(file)]
        found.append((rows, json.loads((tmp_path / name / "summary.json").read_text())["plastic_strain"]))
    assert len(found[0][0]) == 7
    assert found[0] == found[1]


# energy


def test_energy_closes_with_the_plastic_work(found: Found) -> None:
    """1 mm increments on 2 mm facets from first contact on; without the plastic work 3 % would be missing."""
    coarse = ("mesh.seat_facet=2", "mesh.coarse=40", "motion.travel=60")
    scene = load_scene("wheelset", [*YIELDING, *coarse, "output.stress=false", "output.fields_at=[]"])
    solution = solved(scene)
    assert found("energy balance of a press that yields, 2 mm facets, 1 mm increments", solution.energy_balance, 1e-3)
    assert all(record.plastic_work >= 0.0 for record in solution.increments)
    without = [dataclasses.replace(record, plastic_work=0.0) for record in solution.increments]
    assert energy_balance(without) > 1e-2


# release


@pytest.mark.parametrize("formulation", ["nitsche", "penalty"])
@pytest.mark.parametrize("steel", [(), YIELDING], ids=["elastic", "yielding"])
def test_the_press_lets_go(steel: tuple[str, ...], formulation: str, found: Found) -> None:
    """No force is left, all forces balance; friction turned at an end and balances the rest; pressure stays."""
    solution = solved(small_press(*steel, RELEASE, f"contact.formulation={formulation}", fields=True))
    held, free = solution.increments[-2:]
    assert found("release: force over the peak", abs(free.force) / solution.force.max(), 1e-9)
    assert solution.force_balance is not None
    assert found("release: balance of forces", solution.force_balance, 1e-12)
    assert held.displacement == 60.0
    assert 59.8 < free.displacement < 60.0
    touching = np.flatnonzero(free.facets.status != OPEN)
    assert (held.facets.traction[touching] >= 0.0).all()
    # turned at an end, held elsewhere: by 15 MPa and more, 14.8 on the mesh of another gmsh
    assert free.facets.traction.min() < -14.0 < 14.0 < free.facets.traction.max()
    bound = free.facets.friction * free.facets.pressure
    assert (np.abs(free.facets.traction) <= bound + 1e-9 * bound.max()).all()
    assert 0.9 < free.normal_force / held.normal_force < 1.0
    assert list(solution.fields) == [free.displacement]
    assert solution.energy_balance < 1e-2


@pytest.mark.parametrize(("name", "bar"), [("contact-patch", 1e-4), ("hertz-sphere", 5e-3)])
def test_discs_that_are_let_go_just_touch(name: str, bar: float) -> None:
    """They are back where they touched, for they are elastic: no force, no way beyond, all work given back."""
    solution = solved(load_scene(name, [RELEASE, "output.stress=false", "output.fields_at=[]"]))
    assert solution.increments[-1].force == 0.0
    deepest = solution.displacement[:-1].max()
    assert abs(solution.displacement[-1]) < 1e-3 * deepest
    assert solution.energy_balance < bar


def test_a_fit_in_place_has_nothing_to_let_go() -> None:
    """Its force is 0 already, or that of a mesh: no search, no further increment."""
    for friction in ("0.0", "0.11"):
        keys = (RELEASE, "output.stress=false", "output.fields_at=[]", f"friction.options.coefficient={friction}")
        assert len(solved(load_scene("lame-rings", keys)).increments) == 1


def test_without_friction_nothing_holds_the_wheel() -> None:
    """A wheel on its seat's taper slides off where nothing holds it: what was pressed stays, and a doubt says so."""
    keys = ("friction.options.coefficient=0", "motion.travel=60", RELEASE, "output.stress=false", "output.fields_at=[]")
    scene = small_press(*keys)
    with pytest.warns(UserWarning, match=r"motion\.release: "):
        solution = solve(scene, MPI.COMM_SELF)
    assert len(solution.increments) == len(scene.displacements)
    assert [doubt for doubt in doubts(solution) if doubt.startswith("not released: ")]
    assert not [doubt for doubt in doubts(solved(small_press("motion.travel=40", RELEASE))) if "not released" in doubt]


def test_release_of_partial_slip_closes_the_balance() -> None:
    """Slip turns along the whole shaft of `push-out` as its press lets go; no doubt is left."""
    scene = load_scene("push-out", [RELEASE, "mesh.seat_facet=4", "output.stress=false", "output.fields_at=[]"])
    solution = solve(scene, MPI.COMM_SELF)
    assert solution.energy_balance < 1e-4  # 0.07, were the whole of the last friction taken for the work
    assert not doubts(solution)


def test_pulled_off_after_a_plastic_press_fit(found: Found) -> None:
    """`press-and-pull` of 420 MPa: pulled off, mu N of what the fit still presses with; free of force as let go.

    What is beyond mu N is the slope of the interface, which hinders the press by what it helps to pull. On its way back
    the force is 0 where `motion.release` finds it, with the same normal force.
    """
    steel = [f"{body}.material.{key}" for body in ("axle", "wheel") for key in YIELD_420]
    keys = [*steel, "mesh.seat_facet=2", "output.stress=false", "output.fields_at=[]"]
    pulled = solved(load_scene("press-and-pull", keys))
    records, turn = pulled.increments, int(pulled.displacement.argmax())
    back = records[turn + 12 :]
    assert records[turn].force > 9e5
    assert records[turn].plastic_strain > 0.01
    slope = records[turn].force - 0.11 * records[turn].normal_force
    assert 0.0 < slope < 0.03 * records[turn].force
    assert all(record.force < 0.0 for record in back)
    assert all(record.sticking_facets == 0 for record in back)
    for record in back:
        assert record.friction_force == pytest.approx(-0.11 * record.normal_force, rel=1e-3)
        assert record.force + 0.11 * record.normal_force == pytest.approx(slope, rel=0.2)
    assert found("energy balance of a plastic press-fit that is pulled off", pulled.energy_balance, 1e-3)
    assert not doubts(pulled)
    released = solved(load_scene("wheelset", [*keys, "motion.travel=60", RELEASE])).increments[-1]
    k = next(k for k in range(turn, len(records)) if records[k].force < 0.0)
    share = records[k - 1].force / (records[k - 1].force - records[k].force)

    def free(values: list[float]) -> float:
        return values[0] + share * (values[1] - values[0])

    assert free([r.displacement for r in records[k - 1 : k + 1]]) == pytest.approx(released.displacement, abs=5e-3)
    assert free([r.normal_force for r in records[k - 1 : k + 1]]) == pytest.approx(released.normal_force, rel=2e-3)


# turns


def test_the_largest_stress_that_is_left_is_said() -> None:
    """It is that of the fields at the end, which are at the nodes; a press that holds on has none."""
    solution = solved(small_press(*YIELDING, RELEASE, "output.stress=true", fields=True))
    left, fields = solution.residual, solution.fields[solution.increments[-1].displacement]
    for body in ("axle", "wheel"):
        assert left[body].displacement_mm == solution.increments[-1].displacement
        assert left[body].value == pytest.approx(fields[body].von_mises.max(), rel=0.1)
        assert 0.0 < left[body].value < solution.max_von_mises[body].value
    numbers = summary(solution)
    assert numbers["residual_von_mises_MPa"]["axle"]["value"] == left["axle"].value
    assert any(line.startswith("Once released   ") for line in sentences(numbers))
    assert not solved(small_press(*YIELDING, "output.stress=true", fields=True)).residual


def test_pulled_back_after_it_yielded() -> None:
    """Pressed, pulled and pressed again: friction turns the force, strain never goes back, energy closes."""
    there, back = np.arange(15.0, 40.5).tolist(), np.arange(39.0, 34.5, -1.0).tolist()
    path = [*there, 39.98, 39.95, 39.9, 39.8, 39.5, *back, 35.1, 35.5, 36.0, 37.0]
    solution = solved(small_path(path, *YIELDING))
    force, strain = solution.force, np.array([record.plastic_strain for record in solution.increments])
    turn, pulled = path.index(40.0), path.index(39.8) + 1 + 1
    assert force[turn] > 5e5
    assert path[pulled] == 39.0
    assert force[pulled] < -4e5
    assert force[-1] > 4e5
    assert (np.diff(strain) >= 0.0).all()
    elastic = solved(small_path(path))
    assert force[turn] < 0.9 * elastic.force[turn]
    assert solution.energy_balance < 5e-3
    assert not any(record.cutbacks for record in solution.increments)


def test_counters_count_the_plastic_steps() -> None:
    """Two solves a body in every iteration at least; bodies that are given are not factored again."""
    scene = small_press(*YIELDING, "motion.travel=30", "output.stress=true")
    assembly = assemble(scene, MPI.COMM_SELF)
    first, second = (solve(scene, MPI.COMM_SELF, assembly=assembly) for _ in range(2))
    iterations = sum(record.plastic_iterations for record in first.increments)
    assert iterations > 10
    assert first.counters["back_substitutions"] > 4 * iterations
    assert first.counters["factorisations"] == 2  # those for solves; assembling took the others
    assert second.counters["factorisations"] == 0
    assert second.counters["back_substitutions"] == first.counters["back_substitutions"]
    assert assembly.work()["factorisations"] == 4


def test_default_fields_are_of_the_end() -> None:
    """... also where the motion came by the same displacement before, with less behind it."""
    solution = solved(small_path([15.0, 30.0, 35.0, 20.0, 30.0], *YIELDING, fields=True))
    before = solved(small_path([15.0, 30.0], *YIELDING, fields=True))
    assert list(solution.fields) == [30.0]
    strain, less = (s.fields[30.0]["wheel"].plastic_strain for s in (solution, before))
    assert strain is not None
    assert less is not None
    assert np.abs(strain - less).max() > 0.1 * less.max()


# zones


def test_the_plastic_zone_is_the_rings(found: Found) -> None:
    """Radius, area and largest strain of what flowed, against the one-dimensional ring; h = 0.5 mm."""
    solution = solved(ring(152.0, 0.25, "output.stress=true", "mesh.seat_facet=0.5", "mesh.coarse=0.5"))
    bore = A - 0.25
    reference = Ring(bore, 152.0, E, NU, 355.0, elements=800)
    shrink_fit(reference, A, COMPLIANCE, 0.25, steps=1)
    radius = float(reference.middle[reference.accumulated > 0.0][-1])
    zone = solution.flowed["wheel"]
    assert 10.0 < radius - bore < 40.0
    assert found("plastic radius of a ring, in facets", abs(zone.depth_mm - (radius - bore)), 1.0)
    assert zone.area_mm2 == pytest.approx(2.0 * (radius - bore), rel=0.06)
    assert zone.value == pytest.approx(np.interp(zone.r_mm, reference.middle, reference.accumulated), rel=1e-3)
    assert bore < zone.r_mm < bore + 0.5
    assert set(solution.flowed) == {"wheel"}


# engines, studies, identification


def test_both_engines_yield_alike() -> None:
    scenes = (small_press(*YIELDING, "motion.travel=30", f"solver={name}") for name in ("condensed", "monolithic"))
    condensed, whole = map(solved, scenes)
    assert condensed.force == pytest.approx(whole.force, abs=1e-9 * condensed.force.max())


@pytest.fixture
def scene_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The small press that yields, in the current folder."""
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "small.toml"
    path.write_text(dump_scene(small_press(*YIELDING, "motion.travel=30", "output.stress=true")))
    return path


def test_a_study_has_the_bits_of_single_runs(scene_file: Path) -> None:
    """Of yield stresses, which share no bodies, and of coefficients, which do: nothing of one run stays in the next."""
    words = ["study", str(scene_file), "-o", "out", "--vary", "wheel.material.yield_stress=300,400",
             "--vary", "friction.options.coefficient=0.1,0.2"]  # fmt: skip
    done = CliRunner(mix_stderr=False).invoke(main, words)
    assert done.exit_code == 0, done.stderr
    with (scene_file.parent / "out" / "study.csv").open() as file:
        rows = list(csv.DictReader(file))
    peaks = [float(row["peak_force_N"]) for row in rows]
    flowed = [(float(row["wheel_plastic_strain"]), float(row["plastic_work_N_mm"])) for row in rows]

    def single(stress: int, mu: float) -> Solution:
        changes = [f"wheel.material.yield_stress={stress}", f"friction.options.coefficient={mu}"]
        return solved(load_scene(scene_file, changes))

    def alone(stress: int, mu: float) -> float:
        return float(single(stress, mu).force.max())

    last = single(400, 0.2)
    work = sum(record.plastic_work for record in last.increments)
    assert flowed[-1] == (last.flowed["wheel"].value, work)
    assert peaks == [alone(stress, mu) for stress in (300, 400) for mu in (0.1, 0.2)]
    assert len(set(peaks)) == 4


def test_identify_finds_the_friction_of_a_fit_that_yields(scene_file: Path) -> None:
    """... and is let go, which no measured curve of an insertion knows."""
    key = "friction.options.coefficient"
    solution = solved(load_scene(scene_file, [f"{key}=0.14", "motion.increment=2.5"]))
    start = [f"{key}=0.1", "motion.increment=2.5", RELEASE]
    found = identify(scene_file, Measured(solution.displacement, solution.force), start)
    assert found.fit.value == pytest.approx(0.14, rel=2e-3)


# what an elastic scene pays

ELASTIC = """
import json, sys
from macrofit.cli import main
main(["run", "contact-patch", "-o", sys.argv[1], "--quiet", *sys.argv[2:]], standalone_mode=False)
print("\\n" + json.dumps([name for name in sys.modules if name.startswith("macrofit.plasticity")]))
"""


def test_an_elastic_run_loads_no_plasticity(tmp_path: Path) -> None:
    """... of steel that is told to stay elastic; where it may yield, it is."""
    loaded = []
    for k, extra in enumerate(([], ["axle.material.elastic=false"])):
        steel = ["axle.material.grade=EA1N", "axle.material.elastic=true", *extra]
        words = [word for change in steel for word in ("--set", change)]
        done = subprocess.run(
            [sys.executable, "-c", ELASTIC, str(tmp_path / str(k)), *words],
            stdin=subprocess.DEVNULL, capture_output=True, text=True, check=True,
        )  # fmt: skip
        loaded.append("macrofit.plasticity.body" in json.loads(done.stdout.splitlines()[-1]))
    assert loaded == [False, True]


def test_an_elastic_scene_makes_no_plastic_body() -> None:
    from macrofit.assembly import assemble, yielding_of

    for steel, bodies in (((), set()), (YIELDING[:3], {"axle"}), (YIELDING, {"axle", "wheel"})):
        scene: Scene = small_press(*steel)
        assembly = assemble(scene, MPI.COMM_SELF)
        yielding = yielding_of(scene, assembly)
        assert (yielding is None) == (not bodies)
        assert set(assembly.plastic) == bodies
    assert Motion().release is False
