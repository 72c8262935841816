"""Training: samples in, a network with its provenance and loss curves out.

What is minimised, and from which start, see `objectives`. Training stops early: the state with the lowest loss on the
validation pairs is kept. Then the stated spread is scaled until 90 % of the validation pairs lie within the mean -+
1.645 standard deviations.

The validation pairs choose the epoch and the spread, so the errors on them flatter the network a little; `evaluate`
uses pairs that had no part in either.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path

import msgspec
import numpy as np
import safetensors
import torch

from macrofit.base.arrays import FloatArray, IntArray

from ..data.plates import Faces, Plates
from ..data.samples import Samples, content_hash, joined_samples, select_samples
from ..errors import TrainingError
from .checkpoint import Architecture, CNNOptions, Control, EnsembleOptions, Model, Provenance
from .dataset import STEEL, Pairs, joined, pair_tensors, split_by_family
from .descent import Curves, Descent, Watch, descend
from .devices import chosen_device
from .model import FoundationEnsemble, LallemanCNN, LallemanEnsemble
from .objectives import cnn_descent, ensemble_descent
from .resume import TrainingState
from .score import Scores, calibrate_spread, measure_residual, score_network

STIFFNESS: dict[Faces, list[float]] = {"generated": [3e4, 1e5], "envelope": [3e5, 1.2e6]}
"""Stiffnesses of the foundations [N/mm3]; envelopes of spheres touch at fewer points, and stand on stiffer ones."""
EPOCHS: dict[Architecture, int] = {"energy": 2000, "paper": 80}
"""Upper bound of the epochs."""
PATIENCE: dict[Architecture, int] = {"energy": 200, "paper": 15}
"""Epochs without a lower validation loss before training stops."""
FEWEST_PAIRS = 20
"""Pairs from which anything is learned."""


@dataclass(frozen=True, kw_only=True)
class Trained:
    """A trained network, how it came about, and how well it does."""

    model: Model
    provenance: Provenance
    curves: Curves
    """Loss by epoch; of the first member, where several were trained one after the other."""
    scores: Scores
    """Scores on the validation pairs."""
    others: tuple[Curves, ...] = ()
    """Curves of the other members."""


def train_network(
    samples: Samples,
    architecture: Architecture = "energy",
    faces: Faces = "generated",
    seed: int = 0,
    *,
    plates: Plates = STEEL,
    beside: Sequence[tuple[Samples, Plates]] = (),
    members: int = 8,
    width: int = 24,
    constant: bool | None = None,
    seeds: int = 1,
    points: int | None = None,
    epochs: int | None = None,
    device: str | None = None,
    resume: Path | None = None,
    watch: Watch | None = None,
) -> Trained:
    """Train a network on 70 % of the samples, by families of surfaces; the same seed gives the same bits.

    Args:
        samples: friction tests of a database.
        architecture: "energy" or "paper".
        faces: surfaces as generated, or as the envelopes of their spheres.
        seed: chooses the split, the starting values and the order of the samples.
        plates: plates of the friction tests, from the header of the database.
        beside: samples of more databases with their plates, of other pressures or held otherwise while sliding.
        members: networks in the ensemble, of `energy`.
        width: hidden units of its perceptrons.
        constant: `energy` has a constant in b; by default for plates with a speed.
        seeds: networks of `paper`, one after the other from `seed`, `seed` + 1 and so on; several make an ensemble.
        points: points of a wheel's face along its edge, a part of those of the samples; see `pair_tensors`.
        epochs: upper bound.
        device: device of torch; a GPU where there is one and it is left out.
        resume: file for the state of the training, from which the same one goes on to the same bits.
        watch: told epoch, training and validation loss as they come.

    Raises:
        SurrogateError: nothing can be learned from the samples, or there is no such device.
    """
    sources = _sources(((samples, plates), *beside))
    samples = joined_samples([some for some, _ in sources])
    fit, validation = _split_pairs(samples, sources, faces, points, seed)
    epochs, device = EPOCHS[architecture] if epochs is None else epochs, chosen_device(device)
    options: EnsembleOptions | CNNOptions = CNNOptions(fit.wheel.shape[1], members=seeds)
    if architecture == "energy":
        options = _ensemble_options(fit, faces, sources, members=members, width=width, constant=constant)
    provenance = _provenance(samples, options, faces, plates, seed, (fit, validation))
    provenance = _widened(msgspec.structs.replace(provenance, device=device), samples, sources)
    states = _states(resume, f"{faces} {points} {provenance.database} {device} {torch.__version__}", options, seed)
    there = fit.to(device), validation.to(device)
    with torch.random.fork_rng(devices=[device] if device.startswith("cuda") else []):
        trained = [_descended(options, there, seed + k, epochs, state, watch) for k, state in enumerate(states)]
    model = _gathered(options, [member for member, _ in trained])
    scores = _judge(model, validation)
    for state in states:
        state.remove()
    provenance = msgspec.structs.replace(provenance, validation_error=scores.error, validation_r2=scores.r2)
    curves, *others = (loss for _, loss in trained)
    return Trained(model=model, provenance=provenance, curves=curves, scores=scores, others=tuple(others))


def _descended(
    options: EnsembleOptions | CNNOptions,
    pairs: tuple[Pairs, Pairs],
    seed: int,
    epochs: int,
    state: TrainingState,
    watch: Watch | None,
) -> tuple[Model, Curves]:
    """What is trained at a time from a seed: an ensemble on foundations, or one convolutional network."""
    torch.manual_seed(seed)
    one = msgspec.structs.replace(options, members=1) if isinstance(options, CNNOptions) else options
    model: Model = one.build_network().to(pairs[0].wheel.device)
    architecture: Architecture = "paper" if isinstance(options, CNNOptions) else "energy"
    return model, descend(model, _descent(model, *pairs), epochs, PATIENCE[architecture], state, watch)


def _gathered(options: EnsembleOptions | CNNOptions, models: Sequence[Model]) -> Model:
    """The network of the options, of the members that were trained."""
    if len(models) == 1:
        return models[0].requires_grad_(False).eval().to("cpu")
    whole = options.build_network()
    assert isinstance(whole, LallemanEnsemble)
    for member, trained in zip(whole.members, models, strict=True):
        member.load_state_dict(trained.state_dict())
    return whole.requires_grad_(False).eval()


def _judge(model: Model, validation: Pairs) -> Scores:
    """Scale the stated spread by the pairs held back, and score the network on them."""
    if isinstance(model, LallemanEnsemble):
        measure_residual(model, validation)
    calibrate_spread(model, validation)
    return score_network(model, validation)


def _states(resume: Path | None, key: str, options: EnsembleOptions | CNNOptions, seed: int) -> list[TrainingState]:
    """The state of the training of each member."""
    count = options.members if isinstance(options, CNNOptions) else 1
    named = str(options).replace(", trapezoid=False", "")  # as before there were others: those trainings go on
    key = f"{named} {seed} {key}"
    return [TrainingState(_state_file(resume, number), f"{key} {number}") for number in range(count)]


def _state_file(resume: Path | None, number: int) -> Path | None:
    """The file for the state of a member's training."""
    return resume if resume is None or not number else resume.with_name(f"{resume.name}.{number}")


def _descent(model: Model, fit: Pairs, validation: Pairs) -> Descent:
    """The descent of an architecture."""
    if isinstance(model, FoundationEnsemble):
        return ensemble_descent(model, fit, validation)
    assert isinstance(model, LallemanCNN)
    return cnn_descent(model, fit, validation)


def _sources(databases: Sequence[tuple[Samples, Plates]]) -> list[tuple[Samples, Plates]]:
    """The samples to learn from, with their plates; without those whose answer is doubtful.

    Raises:
        TrainingError: plates that no network takes, or that do not go together.
    """
    first = databases[0][1]
    for samples, plates in databases:
        if (plates.edge, plates.slide) != (1.0, 1.0):
            raise TrainingError(f"plates of {plates.edge:g} mm slid by {plates.slide:g} mm: networks take 1 mm of both")
        others = first.unlike(msgspec.structs.replace(plates, pressure=first.pressure, control=first.control))
        if others:
            raise TrainingError(f"the databases do not go together: {'; '.join(others)}")
        if samples.micro_friction.shape[1] != databases[0][0].micro_friction.shape[1]:
            raise TrainingError("the databases do not go together: take as many micro coefficients per pair in all")
    return [(select_samples(samples, np.flatnonzero(samples.remark == b"")), plates) for samples, plates in databases]


def _is_wide(sources: Sequence[tuple[Samples, Plates]]) -> bool:
    """Whether pairs differ in pressure, or in what was held while sliding."""
    return len(sources) > 1 or len(np.unique(sources[0][0].pressure)) > 1


def _split_pairs(
    samples: Samples, sources: Sequence[tuple[Samples, Plates]], faces: Faces, points: int | None, seed: int
) -> tuple[Pairs, Pairs]:
    """The pairs for training and for validation, of all sources together."""
    data = joined([pair_tensors(some, faces, points, plates) for some, plates in sources])
    _check_pairs(data)
    rows, held_back = split_by_family(samples, seed=seed)
    fit, validation = data.take(rows), data.take(held_back)
    if not len(validation) or len(fit) < 2:
        raise TrainingError(f"{len(data)} samples share too few surfaces' seeds to be split; generate more pairs")
    return fit, validation


def _check_pairs(data: Pairs) -> None:
    """Raise an error where nothing can be learned from the pairs."""
    if len(data) < FEWEST_PAIRS:
        raise TrainingError(f"{len(data)} samples are too few to learn from; generate at least {FEWEST_PAIRS}")
    if data.micro.shape[1] < 2:
        raise TrainingError("samples have one micro coefficient each: b needs two; generate with --micro-friction 2")
    for name in ("wheel", "axle", "micro", "meso"):
        bad = ~torch.isfinite(getattr(data, name).flatten(1)).all(1)
        if bool(bad.any()):
            raise TrainingError(f"sample {int(bad.nonzero()[0, 0])}: {name} is not finite; make the database anew")


def _ensemble_options(
    fit: Pairs,
    faces: Faces,
    sources: Sequence[tuple[Samples, Plates]],
    *,
    members: int,
    width: int,
    constant: bool | None,
) -> EnsembleOptions:
    """Options of the ensemble on foundations; an error where the points of a face do not divide a slide equally."""
    plates, wide = sources[0][1], _is_wide(sources)
    constant = plates.dynamic if constant is None else constant
    options = EnsembleOptions(
        stiffness=STIFFNESS[faces],
        load=plates.load,
        members=members,
        width=width,
        constant=constant,
        wide=wide,
        trapezoid=wide,
    )
    points = fit.wheel.shape[1]
    if (points - 1) % (options.positions - 1):
        raise TrainingError(f"faces of {points} points have no {options.positions} equal places of a slide")
    return options


def _provenance(
    samples: Samples,
    options: EnsembleOptions | CNNOptions,
    faces: Faces,
    plates: Plates,
    seed: int,
    parts: tuple[Pairs, Pairs],
) -> Provenance:
    """Where the weights will come from; the scores are not known yet."""
    fit, validation = parts
    return Provenance(
        options=options,
        faces=faces,
        database=content_hash(samples),
        seed=seed,
        training=len(fit),
        validation=len(validation),
        points=fit.wheel.shape[1],
        plates=plates,
        surface_seeds=_seeds(samples.wheel_seed, samples.axle_seed),
        packing_seeds=_seeds(samples.packing_seed),
        max_height=_range(samples.max_height),
        levels=tuple(int(n) for n in np.unique(samples.levels)),
        hurst_exponent=_range(samples.hurst_exponent),
        micro_friction=_range(samples.micro_friction),
        validation_error={},
        validation_r2=float("nan"),
        versions={
            "macrofit": version("macrofit"),
            "torch": str(torch.__version__),
            "safetensors": safetensors.__version__,
        },
    )


def _widened(provenance: Provenance, samples: Samples, sources: Sequence[tuple[Samples, Plates]]) -> Provenance:
    """The provenance with all that pairs of a wide design differ in; as it is for others."""
    if not _is_wide(sources):
        return provenance
    pressures: dict[Control, list[FloatArray]] = {}
    for some, plates in sources:
        pressures.setdefault(msgspec.convert(plates.control, Control), []).append(some.pressure)
    forms = samples.form.astype(str)
    seeds = {
        str(form): _seeds(samples.wheel_seed[forms == form], samples.axle_seed[forms == form])
        for form in np.unique(forms)
    }
    return msgspec.structs.replace(
        provenance,
        pressures={control: _range(np.concatenate(some)) for control, some in sorted(pressures.items())},
        forms=tuple(seeds),
        lays=tuple(np.unique(samples.lay.astype(str)).tolist()),
        seeds_of_form=seeds,
    )


def _range(values: FloatArray) -> tuple[float, float]:
    """Smallest and largest value."""
    return float(values.min()), float(values.max())


def _seeds(*seeds: IntArray) -> tuple[int, int]:
    """Smallest and largest seed of all the arrays."""
    return min(int(some.min()) for some in seeds), max(int(some.max()) for some in seeds)
