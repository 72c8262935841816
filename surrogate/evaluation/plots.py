"""Figures of an evaluation and of a prediction."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from macrofit.base.arrays import FloatArray
from macrofit.base.figure import BLUE, GREEN, ORANGE, PURPLE, SKY, VERMILION, save, sheet

from ..network.score import QUANTILE_90
from ..pair import PairPrediction
from .errors import relative_errors
from .measured import MeasuredPairs
from .predicted import PredictedPairs, constant_ratio

SHOWN = 0.07
"""Micro coefficient of the paper's figure."""


def draw_configurations(data: MeasuredPairs, predicted: PredictedPairs, target: Path) -> Path:
    """Actual against predicted by configuration, as in the paper: one micro coefficient, sorted by the actual one."""
    k = int(np.argmin(np.abs(data.micro - SHOWN)))
    figure, (axes,) = sheet(7.2, 3.6)
    order = np.argsort(data.meso[..., k].mean(1))
    mean = predicted.mean[order, :, k].mean(1)
    place = np.arange(len(order))
    if predicted.spread is not None:
        half = QUANTILE_90 * predicted.spread[order, :, k].mean(1)
        axes.fill_between(
            place, mean - half, mean + half,
            color=BLUE, alpha=0.18, lw=0, label="stated 90 % interval of one packing",
        )  # fmt: skip
    axes.plot(place, mean, color=BLUE, lw=1.2, label="predicted")
    for packing in range(data.packings):
        label = "actual, each packing" if packing == 0 else None
        axes.plot(place, data.meso[order, packing, k], ".", color=VERMILION, ms=3.5, alpha=0.7, label=label)
    axes.set_xlabel("configuration, by the rising mean over its packings")
    axes.set_ylabel(f"meso coefficient [-] at µ micro = {data.micro[k]:g}")
    axes.legend(frameon=False, fontsize=8)
    return save(figure, target)


def draw_scatter(data: MeasuredPairs, predicted: PredictedPairs, target: Path) -> Path:
    """Predicted over actual for all micro coefficients, and the same for b, the part that roughness alone gives."""
    figure, (left, right) = sheet(8.6, 4.2, columns=(1.0, 1.0))
    actual, guess = data.meso.mean(1), predicted.mean.mean(1)
    for k, colour in zip(range(len(data.micro)), (BLUE, GREEN, ORANGE, PURPLE, VERMILION, SKY), strict=False):
        left.plot(actual[:, k], guess[:, k], ".", ms=4, color=colour, label=f"{data.micro[k]:g}")
    left.legend(title="µ micro", frameon=False, fontsize=8, title_fontsize=8)
    left.set_xlabel(f"actual meso coefficient [-] (mean over {data.packings} packings)")
    left.set_ylabel("predicted meso coefficient [-]")
    b = [_intercept(data.micro, mu) for mu in (actual, guess)]
    right.plot(1e3 * b[0], 1e3 * b[1], ".", ms=4, color=BLUE)
    right.set_xlabel("actual 10³ b [-]")
    right.set_ylabel("predicted 10³ b [-]")
    for axes in (left, right):
        low, high = axes.get_xlim()
        axes.plot([low, high], [low, high], color="0.4", lw=0.8, zorder=0)
        axes.set_xlim(low, high)
    return save(figure, target)


def draw_errors(data: MeasuredPairs, predicted: PredictedPairs, others: list[PredictedPairs], target: Path) -> Path:
    """Mean relative error against one packing, with its standard error, beside baselines and the noise floor."""
    figure, (axes,) = sheet(6.4, 4.0)
    shown = [constant_ratio(data), *others, replace(predicted, name="this network")]
    colours = [*("0.55", ORANGE, PURPLE, GREEN, SKY, VERMILION)[: len(shown) - 1], BLUE]
    for one, colour in zip(shown, colours, strict=True):
        wrong = relative_errors(data, one)[0].mean(1)  # (n, k)
        axes.errorbar(
            data.micro, 100.0 * wrong.mean(0), 100.0 * wrong.std(0, ddof=1) / np.sqrt(len(wrong)),
            fmt="o-", ms=4, lw=1.4, capsize=2, color=colour, label=one.name,
        )  # fmt: skip
    if data.packings > 1:
        axes.plot(data.micro, 100.0 * data.noise_floor, "k--", lw=1.0, label="noise floor: the mean over all packings")
    axes.set_yscale("log")
    axes.set_yticks([0.5, 1, 2, 5, 10], labels=["0.5", "1", "2", "5", "10"])
    axes.minorticks_off()
    axes.set_xlabel("micro coefficient [-]")
    axes.set_ylabel("mean relative error against one packing [%]")
    axes.legend(frameon=False, fontsize=8)
    return save(figure, target)


def draw_prediction(pair: PairPrediction, target: Path) -> Path:
    """The two faces, and the law between the coefficients with its 90 % interval."""
    figure, (left, middle, right) = sheet(11.0, 3.2, columns=(1.0, 2.0, 1.4))
    scale = 1e3 * float(max(np.abs(pair.wheel).max(), np.abs(pair.axle).max()))
    for axes, face, title in ((left, pair.wheel, "wheel"), (middle, pair.axle, "axle")):
        extent = (0.0, (len(face) - 1) / (face.shape[1] - 1), 0.0, 1.0)
        image = axes.imshow(1e3 * face.T, origin="lower", extent=extent, cmap="RdBu_r", vmin=-scale, vmax=scale)
        axes.grid(visible=False)
        axes.set(title=title, xlabel="along the slide [mm]", ylabel="across [mm]")
    figure.colorbar(image, ax=[left, middle], label="height [µm]", shrink=0.7)
    if len(pair.micro) > 1:
        right.fill_between(
            pair.micro, pair.mean - pair.half, pair.mean + pair.half, color=BLUE, alpha=0.2, lw=0, label="90 % interval"
        )
    right.errorbar(pair.micro, pair.mean, pair.half, fmt="o-", ms=4, color=BLUE, capsize=2, label="predicted")
    right.plot(pair.micro, pair.micro, color="0.5", lw=0.8, ls="--", label="as micro")
    right.set(xlabel="micro coefficient [-]", ylabel="meso coefficient [-]")
    right.legend(frameon=False, fontsize=8)
    return save(figure, target)


def _intercept(micro: FloatArray, mu: FloatArray) -> FloatArray:
    slope = (mu[:, -1] - mu[:, 0]) / (micro[-1] - micro[0])
    return np.asarray(mu[:, 0] - slope * micro[0])
