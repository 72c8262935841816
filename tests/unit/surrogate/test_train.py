"""Training and checkpoints: on pairs whose coefficient follows a known law, and on files that are not what they say."""

from __future__ import annotations

import pickle
from collections.abc import Callable
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
import safetensors.torch
import torch
from click.testing import CliRunner

from surrogate.cli import main
from surrogate.data.database import Header, Samples
from surrogate.data.samples import Plates
from surrogate.errors import CheckpointError, TrainingError
from surrogate.evaluation.curves import write_curves
from surrogate.network.checkpoint import (
    ENTRY,
    LARGEST_FILE,
    Architecture,
    CNNOptions,
    EnsembleOptions,
    checkpoint_digest,
    load_checkpoint,
    outside_training,
    save_checkpoint,
)
from surrogate.network.dataset import LOWEST_ENVELOPE, pair_tensors, split_by_family, split_into_folds
from surrogate.network.descent import Curves
from surrogate.network.foundation import Foundation
from surrogate.network.model import FoundationEnsemble, LallemanCNN, LallemanEnsemble
from surrogate.network.objectives import SMOOTH, contact_threshold, ridge_weights
from surrogate.network.score import predict_pairs
from surrogate.network.train import Trained, _states, train_network

HEADER = Header(design="", settings="", code="", version="0", micro_frictions=2, squares=2, points=9)
NOISE = 0.1
"""Standard deviation of the packings over that of b."""


def made(count: int, seed: int = 0) -> Samples:
    """Pairs of smooth random faces; b is that of a foundation of 3e4 N/mm3, and noise."""
    rng = np.random.default_rng(seed)
    rows = np.zeros(count, HEADER.row())
    rows["pressure"] = 170.0
    rows["id"], rows["packing_seed"] = np.arange(count), np.arange(count) // 4
    rows["wheel_seed"], rows["axle_seed"] = np.arange(count) // 2, 1000 + np.arange(count)
    rows["levels"], rows["hurst_exponent"] = 3, rng.uniform(0.5, 1.0, count)
    rows["max_height"] = 0.005 * 8.0 ** rng.random(count)
    for name in ("wheel", "axle"):
        rows[name] = rng.uniform(-0.5, 0.5, rows[name].shape) * rows["max_height"][:, None, None]
        rows[f"{name}_envelope"] = -1.0
    rows["micro_friction"] = np.stack([rng.uniform(0.01, 0.05, count), rng.uniform(0.05, 0.09, count)], axis=1)
    with torch.no_grad():
        slopes, _ = Foundation([3e4], 170.0)(
            torch.from_numpy(rows["wheel"].copy()), torch.from_numpy(rows["axle"].copy())
        )
    b = slopes[:, 0].numpy() * (1.0 + NOISE * rng.standard_normal(count))
    rows["meso_friction"] = 1.03 * rows["micro_friction"] + b[:, None]
    return Samples(**{field.name: rows[field.name].copy() for field in fields(Samples)})


SAMPLES = made(200)


def test_databases_of_many_pressures_make_a_wide_network(monkeypatch: pytest.MonkeyPatch) -> None:
    """One at constant force and one at constant height; smooth faces weigh no more than those of `SMOOTH` roughness."""
    forms = np.where(np.arange(40) < 15, b"strip", b"tiles")
    free = replace(made(40), pressure=np.geomspace(20.0, 500.0, 40), form=forms.astype("S8"))
    smooth = replace(made(40, 1), wheel=0.01 * free.wheel, axle=0.01 * free.axle)
    weights: list[torch.Tensor] = []

    def spied(slopes: torch.Tensor, b: torch.Tensor, weight: torch.Tensor) -> torch.Tensor:
        weights.append(weight)
        return ridge_weights(slopes, b, weight)

    monkeypatch.setattr("surrogate.network.objectives.ridge_weights", spied)
    how: dict[str, Any] = {"epochs": 1, "members": 1, "plates": Plates(control="force")}
    about = train_network(free, beside=[(smooth, Plates())], **how).provenance
    assert isinstance(about.options, EnsembleOptions)
    assert about.options.trapezoid
    assert about.wide
    assert about.pressures == {"displacement": (170.0, 170.0), "force": (pytest.approx(20.0), pytest.approx(500.0))}
    assert set(about.seeds_of_form) == set(about.forms) == {"strip", "tiles", ""}
    assert 0.5 / SMOOTH**2 < float(weights[0].max()) <= 1.0 / SMOOTH**2
    assert not train_network(made(40), epochs=1, members=1).provenance.wide
    for other, told in (
        ((made(40), Plates(spheres=400)), "do not go together: plates.spheres"),
        ((replace(smooth, micro_friction=smooth.micro_friction[:, :1]), Plates()), "as many micro coefficients"),
        ((smooth, Plates(slide=0.5)), "networks take 1 mm"),
    ):
        with pytest.raises(TrainingError, match=told):
            train_network(free, beside=[other], **how)


@pytest.fixture(scope="module")
def trained() -> Trained:
    return train_network(SAMPLES, epochs=100, members=3)


def test_energy_finds_the_law_on_pairs_held_back(trained: Trained) -> None:
    # the noise takes NOISE^2 = 0.01 of the variance of b, at most about three times that with 60 pairs
    assert trained.scores.r2 > 0.95
    validation = pair_tensors(SAMPLES).take(split_by_family(SAMPLES)[1])
    constant = ((1.03 * validation.micro - validation.meso) / validation.meso).abs().mean()
    mean, _ = predict_pairs(trained.model, validation)
    assert ((mean - validation.meso) / validation.meso).abs().mean() < constant / 3.0
    assert 0.88 <= trained.scores.coverage <= 0.95  # scaled on these pairs to 90 %


def test_training_lowers_the_loss_and_keeps_the_best_epoch(trained: Trained) -> None:
    curves = trained.curves
    assert len(curves.training) == len(curves.validation) == 101
    assert curves.best == int(np.argmin(curves.validation)) > 0


def test_shuffled_answers_train_to_no_skill() -> None:
    order = np.random.default_rng(3).permutation(len(SAMPLES))
    shuffled = replace(
        SAMPLES, meso_friction=SAMPLES.meso_friction[order], micro_friction=SAMPLES.micro_friction[order]
    )
    assert train_network(shuffled, epochs=100, members=3).scores.r2 <= 0.1


def test_a_seed_gives_the_same_bytes_and_leaves_the_global_generator(tmp_path: Path) -> None:
    torch.manual_seed(5)
    before = torch.get_rng_state()
    for number, seed in enumerate((1, 1, 2)):
        result = train_network(SAMPLES, seed=seed, epochs=10, members=2)
        save_checkpoint(tmp_path / f"{number}.safetensors", result.model, result.provenance)
    assert torch.equal(before, torch.get_rng_state())
    first, again, other = ((tmp_path / f"{number}.safetensors").read_bytes() for number in range(3))
    assert first == again != other


@pytest.mark.parametrize("seed", range(5))
def test_no_surface_and_no_packing_is_on_both_sides(seed: int) -> None:
    training, validation = split_by_family(SAMPLES, seed=seed)
    assert sorted([*training, *validation]) == list(range(len(SAMPLES)))
    assert 0.25 <= len(validation) / len(SAMPLES) <= 0.35
    parts = [(training, validation)]
    parts += [
        (np.setdiff1d(training, fold), np.intersect1d(training, fold)) for fold in split_into_folds(SAMPLES, 4, seed)
    ]
    for left, right in parts:
        for seeds in (SAMPLES.wheel_seed, SAMPLES.axle_seed, SAMPLES.packing_seed):
            assert not set(seeds[left]) & set(seeds[right])


def test_paper_trains(tmp_path: Path) -> None:
    result = train_network(SAMPLES, "paper", epochs=3)
    assert min(result.curves.validation[1:]) < result.curves.validation[0]
    assert np.all(np.isfinite(list(result.scores.error.values())))
    save_checkpoint(tmp_path / "p.safetensors", result.model, result.provenance)
    model, provenance = load_checkpoint(tmp_path / "p.safetensors")
    assert isinstance(model, LallemanCNN)
    assert provenance.architecture == "paper"


def test_round_trip(trained: Trained, tmp_path: Path) -> None:
    path = tmp_path / "m.safetensors"
    save_checkpoint(path, trained.model, trained.provenance)
    model, provenance = load_checkpoint(path)
    assert provenance == trained.provenance
    data = pair_tensors(SAMPLES)
    for one, other in zip(
        predict_pairs(model, data),
        predict_pairs(trained.model, data),
        strict=True,
    ):
        assert torch.equal(one, other)
    assert [file.name for file in tmp_path.iterdir()] == ["m.safetensors"]


def test_a_coarser_grid_is_every_second_row_of_the_samples(tmp_path: Path) -> None:
    coarse = replace(SAMPLES, wheel=SAMPLES.wheel[:, ::2, ::2].copy(), axle=SAMPLES.axle[:, ::2, ::2].copy())
    given, taken = (
        train_network(samples, width=6, members=2, points=points, epochs=3)
        for samples, points in ((coarse, None), (SAMPLES, 5))
    )
    assert given.provenance.points == taken.provenance.points == 5
    assert isinstance(taken.model, FoundationEnsemble)
    assert taken.model.first.shape[::2] == (2, 6)
    expected, weights = given.model.state_dict(), taken.model.state_dict()
    assert all(torch.equal(weights[name], value) for name, value in expected.items())
    save_checkpoint(tmp_path / "coarse.safetensors", taken.model, taken.provenance)
    assert load_checkpoint(tmp_path / "coarse.safetensors")[1].points == 5


@pytest.mark.parametrize("points", [1, 3, 4, 17])
def test_points_that_the_samples_or_the_slide_do_not_have_are_refused(points: int) -> None:
    with pytest.raises(TrainingError, match="points"):
        train_network(SAMPLES, points=points, epochs=1)


def test_outside_names_what_was_not_seen(trained: Trained) -> None:
    assert outside_training(trained.provenance, max_height=0.02, levels=3, micro_friction=0.05) == []
    (said,) = outside_training(trained.provenance, max_height=0.08, hurst_exponent=0.7)
    assert said.startswith("max_height = 0.08 is outside 0.005")
    assert outside_training(trained.provenance, micro_friction=float("nan"))


class Trap:
    """Unpickled, it would fail the test."""

    def __reduce__(self) -> tuple[Callable[..., Any], tuple[Any, ...]]:
        return pytest.fail, ("it was unpickled",)


def changed(path: Path, **tensors: torch.Tensor) -> None:
    """Other tensors with the old metadata."""
    with safetensors.safe_open(path, framework="pt") as file:
        kept, about = {name: file.get_tensor(name) for name in file.keys()}, file.metadata()  # noqa: SIM118
    path.write_bytes(safetensors.torch.save(kept | tensors, about))


def truncate(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:-100])


def put_pickle(path: Path) -> None:
    path.write_bytes(pickle.dumps(Trap()))


def put_torch(path: Path) -> None:
    torch.save({"trap": Trap()}, path)


def put_foreign(path: Path) -> None:
    path.write_bytes(safetensors.torch.save({"first": torch.zeros(3)}))


def alter_tensor(path: Path) -> None:
    changed(path, widening=torch.tensor(0.1))


def alter_metadata(path: Path) -> None:
    text = path.read_bytes()
    assert text.count(b"generated") == 1
    path.write_bytes(text.replace(b"generated", b"envelope "))


def alter_range(path: Path) -> None:
    text = path.read_bytes()
    assert text.count(b'\\"seed\\":0') == 1
    path.write_bytes(text.replace(b'\\"seed\\":0', b'\\"seed\\":7'))


@pytest.mark.parametrize(
    ("damage", "says"),
    [
        (truncate, "damaged"), (put_pickle, "nothing else is ever loaded"), (put_torch, "nothing else is ever loaded"),
        (put_foreign, "do not say what it is"), (alter_tensor, "digest differs"),
        (alter_metadata, "provenance cannot be read"), (alter_range, "digest differs"), (Path.unlink, "no such file"),
    ],
)  # fmt: skip
def test_what_is_no_checkpoint_is_refused(
    trained: Trained, tmp_path: Path, damage: Callable[[Path], None], says: str
) -> None:
    path = tmp_path / "m.safetensors"
    save_checkpoint(path, trained.model, trained.provenance)
    damage(path)
    with pytest.raises(CheckpointError, match=says) as caught:
        load_checkpoint(path)
    assert path.name in str(caught.value)


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (CNNOptions(9), "no network 'paper'"),
        (EnsembleOptions(stiffness=[1e4], load=170.0, members=3), "no network 'energy'"),
        (EnsembleOptions(stiffness=[3e4, 1e5], load=170.0, members=3, positions=1), "cannot be built|no network|fit"),
    ],
)  # fmt: skip
def test_weights_of_another_network_are_refused(
    trained: Trained, tmp_path: Path, options: EnsembleOptions | CNNOptions, says: str
) -> None:
    path = tmp_path / "m.safetensors"
    save_checkpoint(path, trained.model, msgspec.structs.replace(trained.provenance, options=options))  # a true digest
    with pytest.raises(CheckpointError, match=says):
        load_checkpoint(path)


@pytest.mark.parametrize(
    "change", [{"positions": 100}, {"positions": 7}, {"positions": 1}, {"load": -1.0}, {"load": float("inf")}]
)
def test_options_that_do_not_fit_the_faces_are_refused(
    trained: Trained, tmp_path: Path, change: dict[str, float]
) -> None:
    options = msgspec.structs.replace(trained.provenance.options, **change)
    save_checkpoint(
        tmp_path / "m.safetensors", trained.model, msgspec.structs.replace(trained.provenance, options=options)
    )
    with pytest.raises(CheckpointError, match=r"do not fit|cannot be read"):
        load_checkpoint(tmp_path / "m.safetensors")


def test_weights_that_are_not_finite_are_refused(trained: Trained, tmp_path: Path) -> None:
    tensors = trained.model.state_dict() | {"widening": torch.tensor(float("nan"))}
    about = msgspec.json.encode(trained.provenance)
    digest = checkpoint_digest({name: value.numpy() for name, value in tensors.items()}, about)
    entry = msgspec.json.encode({"provenance": msgspec.Raw(about), "sha256": digest}).decode()
    (tmp_path / "m.safetensors").write_bytes(safetensors.torch.save(tensors, {ENTRY: entry}))
    with pytest.raises(CheckpointError, match="widening has values that are not finite"):
        load_checkpoint(tmp_path / "m.safetensors")


def test_a_huge_file_is_not_read(tmp_path: Path) -> None:
    with (tmp_path / "m.safetensors").open("wb") as file:
        file.truncate(LARGEST_FILE + 1)
    with pytest.raises(CheckpointError, match="larger than 200 MB"):
        load_checkpoint(tmp_path / "m.safetensors")


def test_samples_nothing_can_be_learned_from() -> None:
    with pytest.raises(TrainingError, match="5 samples are too few"):
        train_network(made(5))
    bad = made(40)
    bad.axle[7, 0, 0] = np.nan
    with pytest.raises(TrainingError, match="sample 7: axle is not finite"):
        train_network(bad)
    with pytest.raises(TrainingError, match="share too few surfaces"):
        train_network(replace(SAMPLES, wheel_seed=np.zeros_like(SAMPLES.wheel_seed)))


def test_envelopes_are_clamped_from_below() -> None:
    assert float(pair_tensors(SAMPLES, "envelope").wheel.min()) == pytest.approx(LOWEST_ENVELOPE)


class Stop(Exception):
    """What ends a training in the middle."""


@pytest.mark.parametrize(("architecture", "epochs"), [("energy", 30), ("paper", 4)])
def test_a_killed_training_goes_on_to_the_same_bits(
    architecture: Architecture, epochs: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("surrogate.network.resume.SAVE_PERIOD_S", 0.0)
    state = tmp_path / "m.state.safetensors"
    seen: list[int] = []

    def run(resume: Path | None, last: int | None = None, seed: int = 0) -> Trained:
        def watch(epoch: int, training: float, validation: float) -> None:
            seen.append(epoch)
            if epoch == last:
                raise Stop

        return train_network(
            SAMPLES, architecture, seed=seed, members=2, epochs=epochs, device="cpu", resume=resume, watch=watch
        )

    whole = run(None)
    for last in (epochs // 2, epochs - 1):
        with pytest.raises(Stop):
            run(state, last)
        assert state.exists()
    seen.clear()
    resumed = run(state)
    assert seen == [epochs]
    assert list(tmp_path.iterdir()) == []
    for number, result in enumerate((whole, resumed)):
        save_checkpoint(tmp_path / f"{number}.safetensors", result.model, result.provenance)
    assert (tmp_path / "0.safetensors").read_bytes() == (tmp_path / "1.safetensors").read_bytes()
    np.testing.assert_array_equal(whole.curves.training, resumed.curves.training)
    assert whole.curves.validation == resumed.curves.validation


def test_a_training_of_before_the_trapezoid_rule_goes_on() -> None:
    """Its state has the key that it had; the rule is another training."""
    before = EnsembleOptions(stiffness=[3e4, 1e5], load=170.0, constant=True)
    named = "EnsembleOptions(stiffness=[30000.0, 100000.0], load=170.0, members=8, width=24, positions=5, "
    keys = [
        _states(None, "k", options, 7)[0].key for options in (before, msgspec.structs.replace(before, trapezoid=True))
    ]
    assert keys == [f"{named}constant=True, wide=False{rule}) 7 k 0" for rule in ("", ", trapezoid=True")]


def shifted(constant: float) -> Samples:
    """The same pairs, with as much more friction for all of them."""
    return replace(SAMPLES, meso_friction=SAMPLES.meso_friction + constant)


def test_a_constant_in_b_is_found_by_the_network_that_has_one(tmp_path: Path) -> None:
    """0.042, as of plates at their resonance; without the constant the foundations' slopes cannot make it up."""
    swinging = Plates(engine="explicit", speed=1e4)
    found = train_network(shifted(0.042), plates=swinging, epochs=100, members=3)
    lacking = train_network(shifted(0.042), plates=swinging, epochs=100, members=3, constant=False)
    assert (found.scores.r2 > 0.95, lacking.scores.r2 < 0.5) == (True, True)
    assert 0.88 <= found.scores.coverage <= 0.95
    save_checkpoint(tmp_path / "c.safetensors", found.model, found.provenance)
    model, about = load_checkpoint(tmp_path / "c.safetensors")
    assert isinstance(model, FoundationEnsemble)
    assert (model.constant, about.plates) == (True, swinging)
    data = pair_tensors(SAMPLES)
    expected, _ = predict_pairs(found.model, data)
    assert torch.equal(predict_pairs(model, data)[0], expected)


def test_slow_plates_have_no_constant(trained: Trained) -> None:
    """Nor has a file of an earlier version, which does not name it."""
    assert isinstance(trained.model, FoundationEnsemble)
    assert trained.model.last_bias.shape == (3, 4)
    old = msgspec.json.decode(b'{"architecture":"energy","stiffness":[1.0],"load":1.0}', type=EnsembleOptions)
    assert not old.constant


def test_several_seeds_of_the_papers_network_are_an_ensemble(tmp_path: Path) -> None:
    """Each member is the network of its own seed on the common split; the mean is theirs, the spread was measured."""
    whole = train_network(SAMPLES, "paper", epochs=3, seeds=3)
    assert len(whole.others) == 2
    assert len({curves.validation[-1] for curves in (whole.curves, *whole.others)}) == 3
    save_checkpoint(tmp_path / "e.safetensors", whole.model, whole.provenance)
    model, about = load_checkpoint(tmp_path / "e.safetensors")
    assert isinstance(model, LallemanEnsemble)
    assert (about.architecture, len(model.members)) == ("paper", 3)
    data = pair_tensors(SAMPLES)
    mean, spread = predict_pairs(model, data)
    alone = train_network(SAMPLES, "paper", epochs=3).model
    members = torch.stack([predict_pairs(m, data)[0] for m in model.members])
    assert torch.equal(members[0], predict_pairs(alone, data)[0])
    torch.testing.assert_close(mean, members.mean(0))
    validation = data.take(split_by_family(SAMPLES)[1])
    about_mean, stated = predict_pairs(model, validation)
    inside = ((about_mean - validation.meso).abs() <= 1.645 * stated).float().mean()
    assert 0.88 <= float(inside) <= 0.95
    assert float(spread.std()) > 0.0  # larger where the members differ


def test_a_killed_training_of_several_goes_on_to_the_same_bits(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("surrogate.network.resume.SAVE_PERIOD_S", 0.0)
    state = tmp_path / "m.state.safetensors"
    seen: list[int] = []

    def stop(epoch: int, training: float, validation: float) -> None:
        seen.append(epoch)
        if len(seen) == 4:  # in the second epoch of the second member
            raise Stop

    with pytest.raises(Stop):
        train_network(SAMPLES, "paper", seeds=2, epochs=2, resume=state, watch=stop)
    resumed = train_network(SAMPLES, "paper", seeds=2, epochs=2, resume=state, watch=stop)
    assert seen == [1, 2, 1, 2]
    assert list(tmp_path.iterdir()) == []
    whole = train_network(SAMPLES, "paper", seeds=2, epochs=2)
    weights = resumed.model.state_dict()
    assert all(torch.equal(weights[name], value) for name, value in whole.model.state_dict().items())


def test_the_state_of_another_training_or_a_damaged_one_is_left_aside(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("surrogate.network.resume.SAVE_PERIOD_S", 0.0)
    state = tmp_path / "m.state.safetensors"
    seen: list[int] = []

    def stop(epoch: int, training: float, validation: float) -> None:
        seen.append(epoch)
        raise Stop

    for seed in (0, 0, 1):
        with pytest.raises(Stop):
            train_network(SAMPLES, seed=seed, members=2, epochs=5, resume=state, watch=stop)
    assert seen == [1, 2, 1]
    truncate(state)
    with pytest.raises(Stop), pytest.warns(UserWarning, match="is damaged"):
        train_network(SAMPLES, seed=1, members=2, epochs=5, resume=state, watch=stop)
    assert seen[-1] == 1


def test_the_load_of_the_database_counts() -> None:
    pressed = {load: replace(SAMPLES, pressure=np.full(len(SAMPLES), load)) for load in (50.0, 170.0)}
    light, heavy = (
        train_network(samples, plates=Plates(pressure=load), epochs=0, members=2) for load, samples in pressed.items()
    )
    assert isinstance(light.provenance.options, EnsembleOptions)
    assert light.provenance.options.load == 50.0
    assert not torch.equal(light.model.state_dict()["last_bias"], heavy.model.state_dict()["last_bias"])


def test_threshold_catches_nine_of_ten_that_lose_contact() -> None:
    least = torch.linspace(0.0, 1.0, 101)
    in_contact = torch.arange(101) > 50  # those up to 0.5 lose it
    assert float(contact_threshold(least, in_contact)) == pytest.approx(0.45)
    assert float(contact_threshold(least, torch.ones(101, dtype=torch.bool))) == 0.0


def test_gradient_reaches_every_trained_parameter() -> None:
    torch.manual_seed(0)
    data = pair_tensors(SAMPLES).take(np.arange(10))
    for model in (FoundationEnsemble([1e4, 1e5], 170.0, members=2), LallemanCNN(9)):
        if isinstance(model, FoundationEnsemble):
            torch.nn.init.normal_(model.last, std=0.1)  # at zero it hides the layer before it
        else:
            model.low[0], model.range[0] = float(data.wheel.min()), float(data.wheel.max() - data.wheel.min())
        mean, spread = model(data.wheel, data.axle, data.micro)
        (mean.sum() + spread.log().sum()).backward()
        for name, parameter in model.named_parameters():
            if parameter.requires_grad:
                assert parameter.grad is not None, name
                assert bool(torch.isfinite(parameter.grad).all()), name
                assert float(parameter.grad.abs().max()) > 0.0, name


def test_a_reversed_slide_gives_back_the_energy() -> None:
    """Mirrored in x, start and end change places: b changes sign where both carry the load at the same height.

    Exact only there, for the height is set at the start. Here the faces overlap by d everywhere at the start, and by
    2 d on half of the nodes at the end: the same load and twice the energy, less the row both have in common.
    """
    stiffness, load = 1e4, 170.0
    d = load / stiffness
    wheel, axle = torch.zeros(1, 5, 5), torch.zeros(1, 9, 5)
    axle[0, 5:] = d * torch.tensor([1.0, -1.0] * 10).reshape(4, 5)
    foundation = Foundation([stiffness], load, 5)
    with torch.no_grad():
        there, loads = foundation(wheel, axle)
        back, loads_back = foundation(wheel.flip(1), axle.flip(1))
    # single precision: 1e-7 of energies of order b
    torch.testing.assert_close(back, -there, rtol=1e-5, atol=0.0)
    torch.testing.assert_close(loads, loads_back, rtol=1e-5, atol=0.0)
    change = 0.5 * stiffness * d**2 * (4.0 * 10 + 5 - 25) / 25
    assert float(there) == pytest.approx(change / (float(loads) * load), rel=1e-5)


def test_loss_curves_as_table_and_figure(trained: Trained, tmp_path: Path) -> None:
    table, picture = write_curves(trained.curves, tmp_path / "m", "loss")
    lines = table.read_text().splitlines()
    assert lines[0] == "epoch,training,validation"
    assert len(lines) == 102
    assert picture.read_bytes().startswith(b"\x89PNG")


def test_loss_curves_of_several_seeds(tmp_path: Path) -> None:
    """Two columns each; one that ended before the others leaves its cells empty."""
    short, long = Curves([float("nan"), 2.0], [4.0, 3.0], 1), Curves([float("nan"), 1.0, 0.5], [5.0, 2.5, 1.5], 2)
    table, picture = write_curves(short, tmp_path / "m", "loss", [long])
    assert table.read_text().splitlines() == [
        "epoch,training_1,validation_1,training_2,validation_2", "0,,4,,5", "1,2,3,1,2.5", "2,,,0.5,1.5",
    ]  # fmt: skip
    assert picture.read_bytes().startswith(b"\x89PNG")


def test_command_says_a_mistake_on_one_line(tmp_path: Path) -> None:
    said = CliRunner().invoke(main, ["train", str(tmp_path / "no.h5"), "-o", str(tmp_path / "m.safetensors")])
    assert said.exit_code == 2
    assert "there is no such database" in said.output
    assert CliRunner().invoke(main, ["train", "no.h5", "-o", "m.pt"]).exit_code == 2
