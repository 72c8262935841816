"""Predictions: bits that depend on nothing else, the exact properties of the foundation, and what is refused."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
import torch
from scipy.integrate import trapezoid
from torch import Tensor

from surrogate.data.samples import Plates
from surrogate.errors import PredictionError
from surrogate.network import foundation, inference, slides
from surrogate.network.checkpoint import CNNOptions, EnsembleOptions, Model, Provenance, save_checkpoint
from surrogate.network.foundation import Foundation, SlideResponse
from surrogate.network.inference import TrainedEnsemble, ensemble_shapes
from surrogate.network.model import PAIRS_PER_CHUNK, FoundationEnsemble, LallemanCNN, LallemanEnsemble, upper_roughness
from surrogate.network.predict import Prediction, Predictor
from surrogate.network.slides import node_shares

POINTS, WHEELS, AXLES = 17, 7, 11
LOAD = 170.0
PROVENANCE = {
    "plates": Plates(), "surface_seeds": (0, 999), "packing_seeds": (0, 255),
    "faces": "generated", "database": "", "seed": 0, "training": 1, "validation": 1, "points": POINTS,
    "max_height": (0.0, 1.0), "levels": (3,), "hurst_exponent": (0.0, 1.0), "micro_friction": (0.0, 1.0),
    "validation_error": {}, "validation_r2": 1.0, "versions": {},
}  # fmt: skip


def stored(path: Path, model: Model, options: EnsembleOptions | CNNOptions) -> Path:
    save_checkpoint(path, model, Provenance(options=options, **PROVENANCE))  # type: ignore[arg-type]
    return path


def network(architecture: str) -> tuple[Model, EnsembleOptions | CNNOptions]:
    """Random weights: every layer counts."""
    torch.manual_seed(0)
    seeds = {"paper": 1, "seeds": 3}
    options: EnsembleOptions | CNNOptions = EnsembleOptions(stiffness=[3e4, 1e5], load=LOAD)
    if architecture != "energy":
        options = CNNOptions(POINTS, members=seeds[architecture])
    model = options.build_network()
    if isinstance(model, FoundationEnsemble):
        for parameter in model.parameters():
            torch.nn.init.normal_(parameter, std=0.3)
        model.lost.fill_(0.1)
        model.scale.fill_(0.5)
    for member in [model] if isinstance(model, LallemanCNN) else getattr(model, "members", []):
        member.low[0], member.range[0] = -0.02, 0.04
    return model, options


@pytest.fixture(scope="module", params=["energy", "paper", "seeds"])
def predictor(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Predictor:
    with torch.random.fork_rng(devices=[]):
        model, options = network(request.param)
    return Predictor(stored(tmp_path_factory.mktemp("network") / "m.safetensors", model, options))


def faces() -> tuple[np.ndarray[tuple[int, ...], np.dtype[np.float32]], ...]:
    rng = np.random.default_rng(1)
    rms = rng.uniform(0.002, 0.012, WHEELS)[:, None, None]
    wheels = rng.standard_normal((WHEELS, POINTS, POINTS)) * rms
    axles = rng.standard_normal((AXLES, 2 * POINTS - 1, POINTS)) * 0.004
    return wheels.astype(np.float32), axles.astype(np.float32)


WHEEL, AXLE = (grid.ravel() for grid in np.meshgrid(np.arange(WHEELS), np.arange(AXLES), indexing="ij"))
COEFFICIENTS = np.linspace(0.03, 0.09, len(WHEEL))


def same(one: Prediction, other: Prediction, rows: object = slice(None)) -> bool:
    return all(
        np.array_equal(getattr(one, name)[rows], getattr(other, name)) for name in ("mean", "spread", "in_contact")
    )


def test_bits_of_a_pair_depend_on_no_other(predictor: Predictor) -> None:
    wheels, axles = faces()
    assert len(WHEEL) % PAIRS_PER_CHUNK  # the last chunk is not full
    whole = predictor(wheels, axles, WHEEL, AXLE, COEFFICIENTS)
    assert len(np.unique(whole.mean)) > 50
    rng = np.random.default_rng(2)
    orders = [rng.permutation(len(WHEEL)), np.tile(rng.permutation(len(WHEEL)), 9), rng.permutation(len(WHEEL))[:13]]
    for rows in [*orders, *np.arange(len(WHEEL))[:, None]]:
        part = predictor(wheels, axles, WHEEL[rows], AXLE[rows], COEFFICIENTS[rows])
        assert same(whole, part, rows)
    for wheel, axle in zip(WHEEL[::5], AXLE[::5], strict=True):  # nor on the surfaces that come with it
        row = wheel * AXLES + axle
        alone = predictor(
            wheels[[wheel]], axles[[axle]], np.zeros(1, np.int64), np.zeros(1, np.int64), COEFFICIENTS[[row]]
        )
        assert same(whole, alone, [row])


@pytest.mark.parametrize("architecture", ["paper", "seeds"])
def test_parts_of_faces_make_the_papers_network(architecture: str) -> None:
    """The same numbers but for rounding."""
    model, _ = network(architecture)
    assert isinstance(model, LallemanCNN | LallemanEnsemble)
    wheels, axles = (torch.from_numpy(heights) for heights in faces())
    rows, micro = torch.arange(5), torch.linspace(0.03, 0.09, 5)[:, None]
    with torch.inference_mode():
        mean, spread = model(wheels[rows], axles[rows], micro)
        parts = [
            torch.stack([model.face_part(body, face) for face in some[rows]])  # type: ignore[arg-type]
            for body, some in (("wheel", wheels), ("axle", axles))
        ]
        joined, stated = model.join_parts(*parts, micro)
    assert float(mean.std()) > 1e-4
    torch.testing.assert_close(joined, mean, rtol=1e-4, atol=1e-6)
    torch.testing.assert_close(stated, spread, rtol=1e-3, atol=1e-6)


def test_kept_laws_give_the_same_bits(tmp_path: Path) -> None:
    """Whatever their order, and for each of the micro coefficients that they are asked for in turn."""
    predictor = Predictor(stored(tmp_path / "m.safetensors", *network("energy")))
    assert isinstance(predictor.model, TrainedEnsemble)
    slopes, features = predictor.model.prepare(*faces(), WHEEL, AXLE)
    laws, flags = predictor.model.affine_laws(slopes, features), predictor.model.flags(features)
    rows = np.random.default_rng(3).permutation(len(WHEEL))[:50]
    for micro in (0.03, 0.09):
        whole = predictor(*faces(), WHEEL, AXLE, micro)
        assert same(whole, predictor.answer(laws, flags, micro))
        assert same(whole, predictor.answer(laws[rows], flags[rows], np.full(50, micro)), rows)
    with pytest.raises(PredictionError, match="micro coefficient is not finite"):
        predictor.answer(laws, flags, np.inf)


@pytest.mark.parametrize(
    "more", [{}, {"constant": True, "positions": 9}, {"wide": True}, {"wide": True, "trapezoid": True}]
)
def test_answers_are_those_of_torch(more: dict[str, Any]) -> None:
    """But for rounding of single precision, of loads and pairs at constant force too where the network is wide."""
    options = EnsembleOptions(stiffness=[3e4, 1e5], load=LOAD, **more)
    torch.manual_seed(5)
    model = options.build_network().requires_grad_(requires_grad=False)
    assert isinstance(model, FoundationEnsemble)
    for name, value in model.state_dict().items():
        torch.nn.init.normal_(value, 0.5 if name in ("scale", "highest") else 0.0, std=0.1)
    state = {name: value.numpy() for name, value in model.state_dict().items()}
    assert {name: value.shape for name, value in state.items()} == ensemble_shapes(options)
    rng, trained = np.random.default_rng(6), TrainedEnsemble(options, state)
    load = rng.uniform(60.0, 400.0, len(WHEEL)).astype(np.float32) if options.wide else None
    free = rng.random(len(WHEEL)) < 0.5 if options.wide else None
    slopes, features = trained.prepare(*faces(), WHEEL, AXLE, load=load, constant_force=free)
    mean, spread = trained.evaluate_laws(trained.affine_laws(slopes, features), COEFFICIENTS)
    wheels, axles = faces()
    given = [None if each is None else torch.from_numpy(each) for each in (wheels[WHEEL], axles[AXLE], load, free)]
    expected = model.prepare(*given)  # type: ignore[arg-type]
    answers = model.predict_prepared(*expected, torch.from_numpy(COEFFICIENTS)[:, None])
    assert np.allclose(slopes, expected[0], rtol=1e-5, atol=1e-7)
    assert np.allclose(features, expected[1], rtol=2e-5, atol=1e-7)
    laws = torch.stack([*model.member_laws(*map(torch.from_numpy, (slopes, features)))])
    assert np.allclose(trained.member_laws(slopes, features), laws, rtol=1e-4, atol=1e-7)
    assert np.allclose(mean, answers[0][:, 0], rtol=1e-5, atol=1e-6)
    assert np.allclose(spread, answers[1][:, 0], rtol=1e-4, atol=1e-6)


def test_a_pair_that_hardly_touches_has_no_boundless_slope() -> None:
    """Contact is lost after the first of 17 places: the mean load is 3 % of that at the start, and counts as 5 %."""
    options = EnsembleOptions(stiffness=[1e5], load=LOAD, positions=17)
    arrays = {name: np.zeros(shape, np.float32) for name, shape in ensemble_shapes(options).items()}
    wheel, axle = np.zeros((1, 17, 17), np.float32), np.zeros((1, 33, 17), np.float32)
    axle[0, 1:] = -0.05
    wheel[0, 1:] = -0.05
    one = np.zeros(1, np.int64)
    slopes, _ = TrainedEnsemble(options, arrays).prepare(wheel, axle, one, one)
    overlap = 17.0 * LOAD / 1e5  # on one row of 17
    assert slopes[0, 0] == pytest.approx(-0.5 * LOAD * overlap / (0.05 * LOAD), rel=1e-4)
    known = Foundation([1e5], LOAD, 17).slide(torch.from_numpy(wheel), torch.from_numpy(axle))
    assert slopes[0, 0] == pytest.approx(float(known.b), rel=1e-5)


def test_roughness_that_is_known_is_not_measured_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    model = Predictor(stored(tmp_path / "m.safetensors", *network("energy"))).model
    assert isinstance(model, TrainedEnsemble)
    (wheels, axles), pairs = faces(), (WHEEL, AXLE)
    slopes, features = model.prepare(wheels, axles, *pairs)
    known = tuple(inference.upper_roughness(some) for some in (wheels, axles))
    monkeypatch.setattr(inference, "upper_roughness", lambda face: pytest.fail("it was measured"))
    again, unchanged = model.prepare(wheels, axles, *pairs, roughness=known)
    assert np.array_equal(again, slopes)
    assert np.array_equal(unchanged, features)
    _, rougher = model.prepare(wheels, axles, *pairs, roughness=(2.0 * known[0], 2.0 * known[1]))
    assert np.array_equal(rougher[:, :2], 2.0 * features[:, :2])


@pytest.mark.parametrize("wide", [False, True])
def test_flags_tell_lost_contact_and_pairs_unlike_any(wide: bool) -> None:
    """At constant force contact is never lost; a feature may lie outside by a tenth of the range learned from."""
    options = EnsembleOptions(stiffness=[3e4, 1e5], load=LOAD, wide=wide)
    arrays = {name: np.zeros(shape, np.float32) for name, shape in ensemble_shapes(options).items()}
    arrays |= {"lost": np.float32(0.1)} | ({"highest": np.ones_like(arrays["highest"])} if wide else {})
    features = np.full((5, len(arrays["centre"])), 0.5, np.float32)
    features[:, inference.CONSTANT_FORCE] = [0.0, 0.0, 1.0, 0.0, 0.0]
    features[:, -1] = [0.5, 0.05, 0.05, 0.5, 0.5]
    features[3:, 0] = [1.09, -0.11]
    kept, seen = TrainedEnsemble(options, arrays).flags(features).T
    assert kept.tolist() == [True, False, wide, True, True]
    assert seen.tolist() == [True, True, True, True, not wide]


def test_none_asked_none_answered(predictor: Predictor) -> None:
    empty = np.zeros(0, np.int64)
    assert len(predictor(*faces(), empty, empty, 0.07).in_contact) == 0


@pytest.mark.parametrize("pairs", [([WHEELS], [0]), ([-1], [0]), ([0], [AXLES]), ([0, 1], [0])])
def test_pairs_of_surfaces_that_are_not_there(predictor: Predictor, pairs: tuple[list[int], list[int]]) -> None:
    wheel, axle = (np.array(which) for which in pairs)
    with pytest.raises(PredictionError, match="not there"):
        predictor(np.zeros((WHEELS, POINTS, POINTS)), np.zeros((AXLES, 2 * POINTS - 1, POINTS)), wheel, axle, 0.07)


def test_global_state_is_left(predictor: Predictor) -> None:
    before, threads = torch.get_rng_state(), torch.get_num_threads()
    predictor(*faces(), WHEEL, AXLE, 0.07)
    assert torch.equal(before, torch.get_rng_state())
    assert torch.get_num_threads() == threads
    assert torch.is_grad_enabled()


def test_affine_in_the_micro_coefficient(tmp_path: Path) -> None:
    predictor = Predictor(stored(tmp_path / "m.safetensors", *network("energy")))
    at = {micro: predictor(*faces(), WHEEL, AXLE, micro).mean for micro in (0.0, 0.05, 1.0)}
    # double precision throughout: coefficients of order 1
    np.testing.assert_allclose(at[0.05], 0.05 * at[1.0] + 0.95 * at[0.0], atol=1e-15, rtol=0.0)


def test_lost_contact_is_flagged(tmp_path: Path) -> None:
    predictor = Predictor(stored(tmp_path / "m.safetensors", *network("energy")))
    wheels, axles = np.zeros((1, POINTS, POINTS)), np.zeros((2, 2 * POINTS - 1, POINTS))
    axles[1, POINTS + 3 :] = -0.05  # the wheel, held at its height, ends over a hollow but for four rows
    said = predictor(wheels, axles, np.zeros(2, np.int64), np.arange(2), 0.07)
    assert said.in_contact.tolist() == [True, True]
    axles[1, POINTS:] = -0.05  # but for one row of 17, and the share that holds is 0.1
    assert predictor(wheels, axles, np.zeros(2, np.int64), np.arange(2), 0.07).in_contact.tolist() == [True, False]


def test_wrong_grids_and_values_are_refused(predictor: Predictor) -> None:
    wheels, axles = faces()
    one = np.zeros(1, np.int64)
    with pytest.raises(PredictionError, match=r"wheel have the shape \(7, 9, 9\), not \(any, 17, 17\)"):
        predictor(wheels[:, ::2, ::2], axles, one, one, 0.07)
    with pytest.raises(PredictionError, match=r"axle have the shape \(11, 17, 17\)"):
        predictor(wheels, axles[:, :17], one, one, 0.07)
    with pytest.raises(PredictionError, match=r"wheel have the shape \(17, 17\)"):
        predictor(wheels[0], axles, one, one, 0.07)
    with pytest.raises(PredictionError, match="micro coefficient is not finite"):
        predictor(wheels, axles, one, one, np.array([np.nan]))
    axles[4, 3, 2] = np.inf
    with pytest.raises(PredictionError, match="surface 4 of the axle has heights that are not finite"):
        predictor(wheels, axles, one, one, 0.07)


def doubles(count: int = 3, points: int = 9, seed: int = 0) -> tuple[Tensor, Tensor]:
    rng = np.random.default_rng(seed)
    wheel, axle = rng.standard_normal((count, points, points)), rng.standard_normal((count, 2 * points - 1, points))
    return torch.from_numpy(0.004 * wheel), torch.from_numpy(0.004 * axle)


@pytest.mark.parametrize("rule", [False, True])
def test_foundation_against_bisection(rule: bool) -> None:
    """Sums over the nodes are means, or with the trapezoid rule integrals over the face."""

    def mean(values: npt.NDArray[Any]) -> Any:
        return trapezoid(trapezoid(values, dx=0.125), dx=0.125) if rule else values.mean((-2, -1))

    wheel, axle = doubles()
    stiffness = [2e4, 1e5]
    slide = Foundation(stiffness, LOAD, 5, trapezoid=rule).slide(wheel, axle)
    for pair in range(3):
        sums = np.stack([(wheel[pair] + axle[pair, s : s + 9]).numpy() for s in (0, 2, 4, 6, 8)])
        for k, K in enumerate(stiffness):
            low, high = -1.0, 1.0
            for _ in range(60):
                z = 0.5 * (low + high)
                low, high = (z, high) if K * mean(np.clip(sums[0] - z, 0.0, None)) > LOAD else (low, z)
            overlap = np.clip(sums - low, 0.0, None)
            load, energy = K * mean(overlap), 0.5 * K * mean(overlap**2)
            carried, stored = trapezoid(load, dx=0.25), trapezoid(energy, dx=0.25)
            # a step of less than 1e-5 of the overlap is the last one, and Newton's next would be far smaller
            expected = ((energy[-1] - energy[0]) / carried, carried / LOAD, load.min() / LOAD, stored / carried)
            assert [float(column[pair, k]) for column in slide] == pytest.approx(expected, rel=1e-5)


@pytest.mark.parametrize("touching", ["all nodes", "a corner"])
def test_newton_knows_what_its_nodes_stand_for(touching: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where the same nodes touch all the while the overlap is linear: a single step, in numpy and in torch."""
    sums = np.zeros((2, 81), dtype=np.float32) if touching == "all nodes" else np.eye(1, 81, dtype=np.float32)
    shares, calls = node_shares(9, 9), []
    asked = 1.0 / 64.0 if touching == "all nodes" else 0.25 / 64.0 * 0.5
    expected, below = (-asked, -1.0) if touching == "all nodes" else (0.5, 0.25)
    touch, summed = slides.touched, foundation.sum_of_nodes

    def counted(function: Any) -> Any:
        return lambda *given: (calls.append(function), function(*given))[1]

    monkeypatch.setattr(slides, "touched", counted(touch))
    monkeypatch.setattr(foundation, "sum_of_nodes", counted(summed))
    overlap, start, work = np.full(len(sums), asked), np.full(len(sums), below), np.empty_like(sums)
    found = slides.contact_height(sums, overlap, touch(sums, start, work, shares), work, shares)
    both = (torch.from_numpy(values)[:, None] for values in (overlap, start))
    torched = foundation.contact_height(torch.from_numpy(sums), *both, torch.from_numpy(shares))
    assert found.height == pytest.approx(expected, rel=1e-6)
    assert torched.ravel().tolist() == pytest.approx([expected] * len(sums), rel=1e-6)
    assert (calls.count(touch), calls.count(summed)) == (1, 4)  # in torch two sums in the step, two to see it is done


@pytest.mark.parametrize("control", ["height", "force"])
def test_by_the_trapezoid_rule_strips_of_a_face_carry_what_it_does(control: str) -> None:
    """Faces as wide as two periods, and as one: each node of a border stands for half a cell.

    With whole cells the border that the narrow face has more would count, and its share is not the same in both.
    """
    wheel, axle = doubles(1, 9)
    wheel, axle = (torch.cat([part, part.flip(2)[:, :, 1:]], dim=2) for part in (wheel, axle))  # mirrored across
    free = torch.tensor([control == "force"])
    for rule in (True, False):
        foundation = Foundation([2e4, 1e5], LOAD, 5, trapezoid=rule)
        narrow = foundation.slide(wheel[:, :, :9], axle[:, :, :9], torch.tensor([LOAD]), free)
        whole = foundation.slide(wheel, axle, torch.tensor([LOAD]), free)
        alike = all(torch.allclose(one, other, rtol=1e-4, atol=1e-9) for one, other in zip(narrow, whole, strict=True))
        assert alike == rule


def test_gradient_of_the_foundation() -> None:
    """Central differences in double precision; random heights have no two nodes at the rest height."""
    foundation = Foundation([2e4, 1e5], LOAD, 3)
    given = tuple(heights.requires_grad_() for heights in doubles(1, 5))

    def slide(wheel: Tensor, axle: Tensor) -> tuple[Tensor, ...]:
        return tuple(1e3 * column if at == 3 else column for at, column in enumerate(foundation.slide(wheel, axle)))

    assert torch.autograd.gradcheck(slide, given, eps=1e-8, atol=1e-3, rtol=1e-3)  # heights of 4e-3


def test_scaled_heights_on_a_softer_foundation() -> None:
    """c times higher on K/c: the same pressures, c times the energies."""
    wheel, axle = doubles()
    one, other = (
        Foundation([2e4, 1e5], LOAD).slide(wheel, axle),
        Foundation([1e4, 5e4], LOAD).slide(2.0 * wheel, 2.0 * axle),
    )
    expected = SlideResponse(2.0 * one.b, one.load, one.least, 2.0 * one.depth)
    torch.testing.assert_close(tuple(other), tuple(expected), rtol=1e-9, atol=0.0)


def test_a_plane_more_or_less_changes_nothing() -> None:
    wheel, axle = doubles()
    foundation = Foundation([2e4, 1e5], LOAD)
    raised = foundation.slide(wheel + 0.01, axle - 0.02)
    torch.testing.assert_close(tuple(raised), tuple(foundation.slide(wheel, axle)), rtol=1e-9, atol=1e-15)


def test_reversed_slide_changes_the_sign_of_b_alone() -> None:
    """An axle whose second half repeats the first but for a mirrored, lowered half of its nodes: see below.

    The height is set at the start; where the start and the end carry the load at the same height, the reversed slide
    is the same one backwards: b changes sign, and all features stay.
    """
    stiffness = 1e4
    d = LOAD / stiffness
    wheel, axle = torch.zeros(1, 5, 5), torch.zeros(1, 9, 5)
    axle[0, 5:] = d * torch.tensor([1.0, -1.0] * 10).reshape(4, 5)
    model = FoundationEnsemble([stiffness], LOAD)
    slopes, features = model.prepare(wheel, axle)
    back, unchanged = model.prepare(wheel.flip(1), axle.flip(1))
    assert abs(float(slopes)) > 1e-3
    torch.testing.assert_close(back, -slopes, rtol=1e-5, atol=0.0)
    torch.testing.assert_close(unchanged, features, rtol=1e-5, atol=0.0)


def test_exchanged_sides_change_nothing() -> None:
    """Mirrored across the slide."""
    wheel, axle = doubles()
    model = FoundationEnsemble([2e4, 1e5], LOAD).double()
    for one, other in zip(
        model(wheel, axle, torch.full((3, 1), 0.07)), model(wheel.flip(2), axle.flip(2), torch.full((3, 1), 0.07)),
        strict=True,
    ):  # fmt: skip
        torch.testing.assert_close(one, other, rtol=1e-9, atol=0.0)


def test_roughness_sees_the_upper_half_alone() -> None:
    face = torch.tensor([[0.0, 0.0, 3.0], [0.0, 0.0, 3.0], [-7.0, 0.0, 0.0]])
    # two of nine nodes are 3 high; of six steps along and six across, one and two are of 3
    torch.testing.assert_close(upper_roughness(face), torch.tensor([2.0**0.5, (27.0 / 12.0) ** 0.5]))


@pytest.mark.parametrize(("stiffness", "positions"), [([1e5, 3e4], 5), ([], 5), ([-1.0], 5), ([1e5], 1)])
def test_foundations_that_are_none(stiffness: list[float], positions: int) -> None:
    with pytest.raises(ValueError, match="rise from above 0"):
        Foundation(stiffness, LOAD, positions)
