"""Training: samples in, a network with its provenance and loss curves out.

`energy` starts at its baseline: the weights of b are those of a ridge regression on the foundations' slopes, weighted
by one over the squared roughness of both faces. From there Adam lowers the negative log-likelihood of all members at
once, each with its own weights of the pairs (a Bayesian bootstrap). `paper` lowers the mean squared error. Both stop
early: the state with the lowest loss on the validation pairs is kept. Then the stated spread is scaled until 90 % of
the validation pairs lie within the mean -+ 1.645 standard deviations.

The validation pairs choose the epoch and the spread, so the errors on them flatter the network a little; `evaluate`
uses pairs that had no part in either.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, fields
from importlib.metadata import version
from itertools import pairwise
from pathlib import Path
from typing import TypeAlias

import numpy as np
import safetensors
import torch
from torch import Tensor

from macrofit.base.arrays import IntArray

from ..data.database import Samples, content_hash
from ..data.samples import Plates
from ..errors import TrainingError
from .checkpoint import Architecture, EnergyOptions, Model, PaperOptions, Provenance
from .dataset import Faces, Pairs, pairs, split
from .model import Energy, Paper, chunks
from .resume import Saved, packed, unpack

Watch: TypeAlias = Callable[[int, float, float], None]
"""Told epoch, training and validation loss."""

STIFFNESS: dict[Faces, list[float]] = {"generated": [3e4, 1e5], "envelope": [3e5, 1.2e6]}
"""Of the foundations [N/mm3]; envelopes of spheres touch at fewer points, and stand on a stiffer one."""
EPOCHS: dict[Architecture, int] = {"energy": 2000, "paper": 80}
PATIENCE: dict[Architecture, int] = {"energy": 200, "paper": 15}
"""Epochs without a lower validation loss before training stops."""
RATE: dict[Architecture, float] = {"energy": 6e-3, "paper": 1e-3}
"""Learning rate of Adam."""
DECAY = 3e-3
"""Weight decay of the perceptrons of `energy`, towards the baseline."""
RIDGE = 1e-3
"""Of the trace of the normal equations."""
QUANTILE = 1.645
"""Standard deviations of a normal distribution that hold 90 % between them."""
CAUGHT = 0.9
"""Of the pairs that lose contact, the share that the flag shall catch."""
STEEL = Plates()
"""The plates of the default design."""
FEWEST = 20
"""Pairs from which anything is learned."""
REPORTED = (0.03, 0.05, 0.07, 0.09)
"""Micro coefficients of the report."""
BINS = (0.01, 0.03, 0.05, 0.07, 0.09)
"""Edges of the bins of micro coefficients of the report."""
AT_ONCE = 64
"""Pairs that are predicted together: bounds the memory."""
BATCH = 32
"""Pairs in a step of `paper`."""


@dataclass
class Curves:
    """Loss by epoch; the first row is before training."""

    training: list[float] = field(default_factory=list)
    validation: list[float] = field(default_factory=list)
    best: int = 0
    """Epoch whose state was kept."""


@dataclass(frozen=True)
class Descent:
    """What an architecture brings to `_descend`."""

    optimiser: torch.optim.Optimizer
    steps: Callable[[], Iterator[float]]
    """One epoch; gives the losses."""
    validate: Callable[[], float]
    """The loss on the validation pairs."""


@dataclass(frozen=True)
class Scores:
    """What a network makes of pairs with known answers."""

    error: dict[str, float]
    """Mean relative error [-] at each of `REPORTED`, against the straight line through what was measured."""
    r2: float
    """R2 of b [-]."""
    by_bin: list[tuple[float, float, int, float]]
    """Micro coefficient from, to, samples, and their mean error over their mean coefficient [-].

    (Not the mean of the relative errors: rough pairs of little friction have coefficients near zero.)
    """
    coverage: float
    """Share inside the stated 90 % interval [-]."""


@dataclass(frozen=True)
class Trained:
    """What `train` gives."""

    model: Model
    provenance: Provenance
    curves: Curves
    scores: Scores
    """Of the validation pairs."""


def train(
    samples: Samples,
    architecture: Architecture = "energy",
    faces: Faces = "generated",
    seed: int = 0,
    *,
    plates: Plates = STEEL,
    members: int = 8,
    width: int = 24,
    points: int | None = None,
    epochs: int | None = None,
    device: str | None = None,
    resume: Path | None = None,
    watch: Watch | None = None,
) -> Trained:
    """Train a network on 70 % of the samples, by families of surfaces; the same seed gives the same bits.

    (On the same machine, with the same number of threads. The global generator of torch is left as it was.)

    Args:
        samples: of a database.
        architecture: "energy" or "paper".
        faces: surfaces as generated, or as the envelopes of their spheres.
        seed: of the split, the starting values and the order of the samples.
        plates: of the friction tests, from the header of the database.
        members: of the ensemble, of `energy`.
        width: of its perceptrons.
        points: of a wheel's face along its edge, a part of those of the samples; see `dataset.pairs`.
        epochs: at most.
        device: of torch; a GPU where there is one and it is left out.
        resume: file for the state of the training, `resume.EVERY` seconds apart, which goes on from it if it is there
            and of the same training, to the same bits. Removed at the end.
        watch: told epoch, training and validation loss as they come.

    Raises:
        TrainingError: there are too few samples, values that are not finite, plates that are not of 1 mm, or
            `points` that do not suit the samples.
    """
    if (plates.edge, plates.slide) != (1.0, 1.0):
        raise TrainingError(f"plates of {plates.edge:g} mm slid by {plates.slide:g} mm: networks take 1 mm of both")
    data = pairs(samples, faces, points)
    _check(data)
    rows, held_back = split(samples, seed=seed)
    fit, validation = data.take(rows), data.take(held_back)
    if not len(validation) or len(fit) < 2:
        raise TrainingError(f"{len(data)} samples share too few surfaces' seeds to be split; generate more pairs")
    across, limit = data.wheel.shape[1], EPOCHS[architecture] if epochs is None else epochs
    device = device or ("cuda" if torch.cuda.is_available() else "cpu")
    options = (
        EnergyOptions(STIFFNESS[faces], plates.load, members, width)
        if architecture == "energy"
        else PaperOptions(across)
    )
    if isinstance(options, EnergyOptions) and (across - 1) % (options.positions - 1):
        raise TrainingError(f"faces of {across} points have no {options.positions} equal places of a slide")
    database = content_hash(samples)
    saved = Saved(resume, f"{options} {faces} {points} {seed} {database} {device} {torch.__version__}")
    with torch.random.fork_rng(devices=[device] if device.startswith("cuda") else []):
        torch.manual_seed(seed)
        model = options.build().to(device)
        there = _on(device, fit), _on(device, validation)
        descent = _fit_energy(model, *there) if isinstance(model, Energy) else _fit_paper(model, *there)
        curves = _descend(model, descent, limit, PATIENCE[architecture], saved, watch)
    model.requires_grad_(False).eval().to("cpu")
    _widen(model, validation)
    scores = score(model, validation)
    provenance = Provenance(
        options=options,
        faces=faces,
        database=database,
        seed=seed,
        training=len(fit),
        validation=len(validation),
        points=across,
        plates=plates,
        surface_seeds=_seeds(samples.wheel_seed, samples.axle_seed),
        packing_seeds=_seeds(samples.packing_seed),
        max_height=_range(samples.max_height),
        levels=tuple(int(n) for n in np.unique(samples.levels)),
        hurst_exponent=_range(samples.hurst_exponent),
        micro_friction=_range(samples.micro_friction),
        validation_error=scores.error,
        validation_r2=scores.r2,
        versions={
            "macrofit": version("macrofit"),
            "torch": str(torch.__version__),
            "safetensors": safetensors.__version__,
        },
    )
    saved.remove()
    return Trained(model, provenance, curves, scores)


def _on(device: str, data: Pairs) -> Pairs:
    """The pairs on a device."""
    return Pairs(*(getattr(data, part.name).to(device) for part in fields(Pairs)))


def predict(model: Model, wheel: Tensor, axle: Tensor, micro: Tensor) -> tuple[Tensor, Tensor]:
    """Mean and standard deviation (pairs, k) each, some pairs at a time."""
    with torch.inference_mode():
        parts = [
            model(*(part[start : start + AT_ONCE] for part in (wheel, axle, micro)))
            for start in range(0, len(micro), AT_ONCE)
        ]
    return torch.cat([mean for mean, _ in parts]), torch.cat([spread for _, spread in parts])


def score(model: Model, data: Pairs) -> Scores:
    """Errors, R2 of b, and coverage on pairs with known answers."""
    mean, spread = predict(model, data.wheel, data.axle, data.micro)
    a, b = data.line()
    span = data.micro[:, -1] - data.micro[:, 0]
    slope = (mean[:, -1] - mean[:, 0]) / span
    intercept = mean[:, 0] - slope * data.micro[:, 0]
    error = {}
    for micro in REPORTED:
        measured = a * micro + b
        error[f"{micro:g}"] = float(((slope * micro + intercept - measured) / measured).abs().mean())
    wrong = (mean - data.meso).abs()
    by_bin = []
    for low, high in pairwise(BINS):
        inside = (data.micro >= low) & (data.micro < high)
        if bool(inside.any()):
            by_bin.append((low, high, int(inside.sum()), float(wrong[inside].sum() / data.meso[inside].abs().sum())))
    return Scores(
        error=error,
        r2=float(1.0 - (b - intercept).square().sum() / (b - b.mean()).square().sum()),
        by_bin=by_bin,
        coverage=float((wrong <= QUANTILE * spread).float().mean()),
    )


def _check(data: Pairs) -> None:
    """Whether anything can be learned from the pairs."""
    if len(data) < FEWEST:
        raise TrainingError(f"{len(data)} samples are too few to learn from; generate at least {FEWEST}")
    if data.micro.shape[1] < 2:
        raise TrainingError("samples have one micro coefficient each: b needs two; generate with --micro-friction 2")
    for name in ("wheel", "axle", "micro", "meso"):
        bad = ~torch.isfinite(getattr(data, name).flatten(1)).all(1)
        if bool(bad.any()):
            raise TrainingError(f"sample {int(bad.nonzero()[0, 0])}: {name} is not finite; make the database anew")


def _range(values: np.ndarray[tuple[int, ...], np.dtype[np.float64]]) -> tuple[float, float]:
    return float(values.min()), float(values.max())


def _seeds(*seeds: IntArray) -> tuple[int, int]:
    return min(int(some.min()) for some in seeds), max(int(some.max()) for some in seeds)


def _fit_energy(model: Energy, fit: Pairs, validation: Pairs) -> Descent:
    """From the baseline down the negative log-likelihood, all pairs in each step."""
    slopes, features = prepared(model, fit)
    checked = prepared(model, validation)
    model.centre.copy_(features.mean(0))
    model.scale.copy_(features.std(0).clamp_min(1e-3))
    model.lost.copy_(threshold(features[:, -1], fit.held))
    weight = torch.empty(len(model.first), len(fit)).exponential_().to(slopes.device)  # (M, P)
    weight /= weight.mean(1, keepdim=True)
    if len(weight) == 1:
        weight.fill_(1.0)
    with torch.no_grad():
        model.last_bias[:, : slopes.shape[1]] = ridge(slopes, fit.line()[1], weight / features[:, 0].square())
    optimiser = torch.optim.AdamW(
        [
            {"params": [model.first, model.first_bias, model.last], "weight_decay": DECAY / RATE["energy"]},
            {"params": [model.last_bias], "weight_decay": 0.0},
        ],
        lr=RATE["energy"],
    )

    def steps() -> Iterator[float]:
        mean, spread = model.members(slopes, features, fit.micro)  # (M, P, k)
        loss = (weight * likelihood(mean, spread, fit.meso).mean(2)).mean()
        optimiser.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call,unused-ignore]
        optimiser.step()
        yield float(loss.detach())

    def validate() -> float:
        with torch.no_grad():
            return float(likelihood(*model.gathered(*checked, validation.micro), validation.meso).mean())

    return Descent(optimiser, steps, validate)


def _fit_paper(model: Paper, fit: Pairs, validation: Pairs) -> Descent:
    """Down the mean squared error of scaled coefficients, in batches."""
    heights = torch.cat([fit.wheel.flatten(), fit.axle.flatten()])
    low = torch.stack([heights.min(), fit.micro.min(), fit.meso.min()])
    high = torch.stack([heights.max(), fit.micro.max(), fit.meso.max()])
    model.low.copy_(low)
    model.range.copy_((high - low).clamp_min(1e-9))
    optimiser = torch.optim.Adam(model.parameters(), lr=RATE["paper"])

    def steps() -> Iterator[float]:
        order = torch.randperm(len(fit)).to(fit.micro.device)
        for rows in chunks(order, BATCH):
            mean, _ = model(fit.wheel[rows], fit.axle[rows], fit.micro[rows])
            loss = ((mean - fit.meso[rows]) / model.range[2]).square().mean()
            optimiser.zero_grad()
            loss.backward()
            optimiser.step()
            yield float(loss.detach())

    def validate() -> float:
        mean, _ = predict(model, validation.wheel, validation.axle, validation.micro)
        return float(((mean - validation.meso) / model.range[2]).square().mean())

    return Descent(optimiser, steps, validate)


def _descend(model: Model, descent: Descent, epochs: int, patience: int, saved: Saved, watch: Watch | None) -> Curves:
    """Epochs until the validation loss has not fallen for `patience` of them; the best state is put back."""
    state = saved.read()
    if state is None:
        kept = {name: value.clone() for name, value in model.state_dict().items()}
        curves = Curves([float("nan")], [descent.validate()])
    else:
        kept = unpack(state, model, descent.optimiser)
        curves = Curves(state["training"].tolist(), state["validation"].tolist(), int(state["best"]))
    for epoch in range(len(curves.training), epochs + 1):
        if epoch - 1 - curves.best >= patience:
            break
        curves.training.append(float(np.mean(list(descent.steps()))))
        curves.validation.append(descent.validate())
        if curves.validation[-1] < curves.validation[curves.best]:
            curves.best = epoch
            kept = {name: value.clone() for name, value in model.state_dict().items()}
        if saved.due():
            losses = {"training": curves.training, "validation": curves.validation}
            numbers = {name: torch.tensor(values, dtype=torch.float64) for name, values in losses.items()}
            saved.write(packed(model, descent.optimiser, kept) | numbers | {"best": torch.tensor(curves.best)})
        if watch is not None:
            watch(epoch, curves.training[-1], curves.validation[-1])
    model.load_state_dict(kept)
    return curves


def prepared(model: Energy, data: Pairs) -> tuple[Tensor, Tensor]:
    """Slopes and features of all pairs, which training does not change."""
    each = torch.arange(len(data), device=data.wheel.device)
    with torch.no_grad():
        return model.prepare(data.wheel, data.axle, each, each)


def ridge(slopes: Tensor, b: Tensor, weight: Tensor) -> Tensor:
    """Weights g of b = sum over k of g_k b_k for every member, (members, K); weight (members, pairs)."""
    X, w = slopes.double(), weight.double()
    normal = torch.einsum("pk,mp,pl->mkl", X, w, X)
    size = normal.shape[1]
    mean = normal.diagonal(dim1=1, dim2=2).mean(1).clamp_min(torch.finfo(torch.float64).tiny)
    normal = normal + RIDGE * size * mean[:, None, None] * torch.eye(size, dtype=torch.float64, device=X.device)
    solution: Tensor = torch.linalg.solve(normal, torch.einsum("pk,mp,p->mk", X, w, b.double()))
    return solution.to(slopes.dtype)


def threshold(least: Tensor, held: Tensor) -> Tensor:
    """The smallest load [-], (), above which contact counts as held; `CAUGHT` of the pairs that lose it have less."""
    return torch.quantile(least[~held], CAUGHT) if not bool(held.all()) else least.new_zeros(())


def likelihood(mean: Tensor, spread: Tensor, measured: Tensor) -> Tensor:
    """Negative logarithm of the normal density, but for a constant."""
    return 0.5 * ((mean - measured) / spread).square() + spread.log()


def _widen(model: Model, validation: Pairs) -> None:
    """Scale the stated spread so that 90 % of the pairs lie within, with the correction for a finite number."""
    model.widening.fill_(1.0)
    mean, spread = predict(model, validation.wheel, validation.axle, validation.micro)
    ratio = ((mean - validation.meso).abs() / spread).flatten()
    level = min(0.9 * (1.0 + 1.0 / len(validation)), 1.0)
    model.widening.fill_(float(torch.quantile(ratio, level)) / QUANTILE)
