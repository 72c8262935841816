"""What do the network's size, its ensemble and its grid cost, and what do they buy?

    python -m tests.benchmarks surrogate_work [--quick] [--figure docs/surrogate_work.png]

Error by block cross-validation: whole families of surfaces in each fold, every choice learns from the same pairs and
is judged on the same fold. Mean over the folds and its standard error, at micro 0.07 and over 0.03, 0.05, 0.07, 0.09;
beside it the mean difference from the default, fold by fold. Costs are CPU times: of a training, and of the pairs of
tiles that meet while a hub is pressed over a seat of 190 tiles, their faces given. What the number of pairs does to
the error is the question of `surrogate_learning`.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch

from meso.settings import FaceKeys
from surrogate.data.database import Samples, read_database
from surrogate.data.faces import generated_face
from surrogate.evaluation.measured import select_samples
from surrogate.network.checkpoint import EnsembleOptions
from surrogate.network.dataset import pair_tensors, split_into_folds
from surrogate.network.inference import TrainedEnsemble
from surrogate.network.score import score_network
from surrogate.network.train import Trained, train_network

from ._database import default_database, made_up
from ._measure import Cost, cpu, frontier, head, row, save

FOLDS = 4
TILES = 190
DEFAULT = "8 members of width 24, 33 points"
CHOICES: list[tuple[str, str, dict[str, Any]]] = [
    ("default", DEFAULT, {}),
    *[("hidden width", f"width {width}", {"width": width}) for width in (6, 12, 48, 96)],
    *[("members", f"{n} member{'s' * (n > 1)}", {"members": n}) for n in (1, 2, 4, 16)],
    *[("points of a face", f"{n} points", {"points": n}) for n in (9, 17)],
    ("nothing but the baseline", "linear combination of foundations", {"epochs": 0}),
    ("several", "17 points, 4 members of width 12", {"points": 17, "members": 4, "width": 12}),
]

COLUMNS = (
    "choice", "error at 0.07", "mean over 0.03 ... 0.09", "from the default", "parameters", "epochs kept",
    "training CPU s", "predicting CPU s",
)  # fmt: skip


@dataclass(frozen=True)
class Row:
    """One choice, and what came of it; errors by fold (folds, 2): at 0.07 and over the four micro coefficients [-]."""

    series: str
    label: str
    errors: np.ndarray
    training: Cost
    predicting: Cost
    parameters: int
    epochs: int

    @property
    def mean(self) -> np.ndarray:
        """Over the folds [%]."""
        return 100.0 * np.asarray(self.errors.mean(0))


def standard_error(by_fold: np.ndarray) -> np.ndarray:
    """Of the mean over the folds, as a percentage."""
    return 100.0 * np.asarray(by_fold.std(0, ddof=1)) / np.sqrt(len(by_fold))


def judged(samples: Samples, dealt: Sequence[np.ndarray], **options: Any) -> tuple[np.ndarray, Cost, list[Trained]]:
    """Errors by fold, CPU time of the trainings, and what they gave."""
    errors, seconds, networks = [], [], []
    for fold in dealt:
        others = select_samples(samples, np.setdiff1d(np.arange(len(samples)), fold))
        started = time.process_time()
        networks.append(train_network(others, **options))
        seconds.append(time.process_time() - started)
        found = score_network(
            networks[-1].model, pair_tensors(select_samples(samples, fold), points=options.get("points"))
        ).error
        errors.append((found["0.07"], np.mean(list(found.values()))))
    return np.array(errors), Cost(tuple(seconds)), networks


class Seat:
    """The pairs of tiles that meet, and what it costs to predict them."""

    def __init__(self, tiles: int, repeats: int) -> None:
        self.wheels, self.axles = (
            np.stack([generated_face(body, 100_000 + k, FaceKeys()) for k in range(tiles)])
            for body in ("wheel", "axle")
        )
        bore, seat = np.divmod(np.arange(tiles * tiles), tiles)
        meets = bore + seat < tiles  # the bore's tiles are counted from its leading edge, the seat's from its end
        self.bore, self.seat = bore[meets], seat[meets]
        self.repeats = repeats
        self._prepared: dict[int, tuple[Cost, Any]] = {}

    def predicting(self, model: TrainedEnsemble, points: int) -> Cost:
        """CPU time of all pairs; the foundations, which are the same for all networks of a grid, are timed once."""
        step = (self.wheels.shape[1] - 1) // (points - 1)
        wheels, axles = (np.ascontiguousarray(faces[:, ::step, ::step]) for faces in (self.wheels, self.axles))
        micro = np.full(len(self.bore), 0.07)
        if points not in self._prepared:
            self._prepared[points] = cpu(
                lambda: model.prepare(wheels, axles, self.bore, self.seat), repeats=self.repeats
            )
        faces, prepared = self._prepared[points]
        laws, _ = cpu(lambda: model.evaluate_laws(model.affine_laws(*prepared), micro), repeats=self.repeats)
        return Cost(tuple(a + b for a, b in zip(faces.seconds, laws.seconds, strict=True)))


def as_it_answers(trained: Trained) -> TrainedEnsemble:
    """The network without torch, as a press-fit asks it."""
    options = trained.provenance.options
    assert isinstance(options, EnsembleOptions)
    return TrainedEnsemble(options, {name: value.numpy() for name, value in trained.model.state_dict().items()})


def main(words: Sequence[str]) -> int:
    """Print the tables, draw the figure."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks surrogate_work", description=__doc__)
    parser.add_argument("database", type=Path, nargs="?", help="build/bench/train.h5 by default")
    parser.add_argument("--quick", action="store_true", help="Few made-up pairs, few choices, few epochs.")
    parser.add_argument("--figure", type=Path)
    options = parser.parse_args(words)
    torch.set_num_threads(1)
    quick: bool = options.quick
    samples = made_up(60) if quick else read_database(options.database or default_database()).samples
    dealt = split_into_folds(samples, FOLDS)[: 2 if quick else FOLDS]
    seat = Seat(20 if quick else TILES, repeats=1 if quick else 3)
    train_network(select_samples(samples, np.arange(40)), epochs=2)  # warm
    print(
        f"{len(samples)} pairs, {len(dealt)} of {FOLDS} folds; {len(seat.bore)} pairs of tiles predicted. Errors in %, "
        f"± one standard error over the folds. The default has {DEFAULT}.\n"
    )
    print(head(*COLUMNS))
    rows: list[Row] = []
    for series, label, one in CHOICES[:: 5 if quick else 1]:
        errors, training, networks = judged(samples, dealt, **({"epochs": 3} if quick else {}) | one)
        model = networks[0].model
        rows.append(
            Row(
                series,
                label,
                errors,
                training,
                seat.predicting(as_it_answers(networks[0]), networks[0].provenance.points),
                sum(p.numel() for p in model.parameters()),
                int(np.median([trained.curves.best for trained in networks])),
            )
        )
        print(told(rows[-1], rows[0]), flush=True)
    print("\n" + conclusion(rows))
    if options.figure:
        draw(rows, options.figure)
    return 0


def told(one: Row, default: Row) -> str:
    """Its line of the table."""
    wide = standard_error(one.errors)
    apart = one.errors - default.errors
    return row(
        one.label,
        *(f"{value:.3f} ± {error:.3f}" for value, error in zip(one.mean, wide, strict=True)),
        "" if one is default else f"{100.0 * apart[:, 1].mean():+.3f} ± {standard_error(apart)[1]:.3f}",
        one.parameters,
        one.epochs,
        one.training,
        one.predicting,
    )


def conclusion(rows: Sequence[Row]) -> str:
    """The frontiers, and the cheapest choices that the folds cannot tell from the default, or find better."""
    default, errors = rows[0], [one.mean[1] for one in rows]
    said = []
    for what, costs in (
        ("training", [one.training.median for one in rows]),
        ("predicting", [one.predicting.median for one in rows]),
    ):
        best = [rows[k].label for k in frontier(costs, errors)]
        as_good = [
            k
            for k, one in enumerate(rows)
            if 100.0 * (one.errors - default.errors)[:, 1].mean()
            <= 2.0 * standard_error(one.errors - default.errors)[1]
        ]
        cheapest = min(as_good, key=lambda k: costs[k])
        said.append(
            f"Efficient in {what}: {'; '.join(best)}. The cheapest that is at most two standard errors worse than the "
            f"default: {rows[cheapest].label}, {costs[cheapest] / costs[0]:.2g} times its cost."
        )
    return "\n\n".join(said)


def draw(rows: Sequence[Row], target: Path) -> None:
    """Error against the CPU time of training and of predicting, the frontiers dashed.

    The bars are one standard error of the difference from the default.
    """
    from matplotlib.figure import Figure
    from matplotlib.ticker import FormatStrFormatter, LogLocator, NullFormatter

    colours = ("#000000", "#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00")
    figure = Figure(figsize=(10.0, 4.4), dpi=150, layout="constrained")
    panels = zip(figure.subplots(1, 2, sharey=True), ("training", "predicting"), strict=True)
    for axes, what in panels:
        costs = [getattr(one, what).median for one in rows]
        errors = [float(one.mean[1]) for one in rows]
        wide = [float(standard_error(one.errors - rows[0].errors)[1]) for one in rows]
        for name, colour in zip(dict.fromkeys(one.series for one in rows), colours, strict=False):
            own = [k for k, one in enumerate(rows) if one.series == name]
            x, y, bar = ([values[k] for k in own] for values in (costs, errors, wide))
            axes.errorbar(x, y, bar, fmt="o", ms=5, lw=0.8, color=colour, label=name)
        best = frontier(costs, errors)
        axes.plot(
            [costs[k] for k in best], [errors[k] for k in best], "--", lw=1, color="0.5", zorder=0, label="frontier"
        )
        for place, k in enumerate(best):
            below = (-4, -14) if place % 2 else (7, 5)
            axes.annotate(rows[k].label, (costs[k], errors[k]), textcoords="offset points", xytext=below, fontsize=7)
        axes.set_xscale("log")
        axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axes.xaxis.set_major_formatter(FormatStrFormatter("%g"))
        axes.xaxis.set_minor_formatter(NullFormatter())
        axes.set_xlabel(f"CPU time of {what} [s]")
        axes.spines[["top", "right"]].set_visible(False)
        axes.tick_params(labelsize=8)
        if what == "training":
            axes.set_ylabel("mean relative error, 0.03 ... 0.09 [%]")
        else:
            axes.legend(frameon=False, fontsize=8)
    save(figure, target)
