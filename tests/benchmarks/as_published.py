"""Plates as published, their networks and the fit on them: what comes out, beside its bars and the paper?

    python -m tests.benchmarks as_published [--quick]

The preset `as-published` is one reading of the paper (Lalleman, Gosselet, Hubert, Salengro and Magnier): plates of 1000
spheres on beams as printed, slid near the resonance of these beams. First the plates themselves, 30 pairs of tiles with
two packings each and five micro coefficients, computed now. Then the two networks that learned from them, on the
friction tests of pairs that neither has seen. Then `wheelset` on them.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np
from mpi4py import MPI

from macrofit.assembly import Assembly, assemble
from macrofit.base.arrays import FloatArray
from macrofit.base.farm import SerialFarm
from macrofit.identify.fit import fit_parameter
from macrofit.scene import load_scene
from surrogate.data.database import read_database
from surrogate.data.generate import generate_samples
from surrogate.data.sample import design_on_preset, plate_settings
from surrogate.data.table import open_samples
from surrogate.evaluation.measured import MeasuredPairs, arrange_tests
from surrogate.evaluation.predicted import predict_tests
from surrogate.evaluation.run import evaluate_network
from surrogate.network.checkpoint import load_checkpoint
from surrogate.network.model import LallemanEnsemble
from surrogate.network.shipped import SHIPPED

from ._measure import head, lines, row
from .paper import TINY, run, span

PRESET = "as-published"
MICRO = (0.01, 0.03, 0.05, 0.07, 0.09)
FIRST = 20_000
"""Number of the first pair of the plates that are run, which no network has seen."""
CHAIN = ("friction.provider=surrogate", f"friction.options.plates='{PRESET}'", "friction.options.fallback=warning")


class Bar(NamedTuple):
    """What a number should be."""

    low: float
    high: float
    unit: str = ""
    scale: float = 1.0  # of the number as it is printed
    digits: int = 2

    def row(self, what: str, value: float, paper: str = "", more: str = "") -> str:
        """A row of the table: the number beside its bar."""
        low, high, found = (f"{self.scale * number:.{self.digits}f}" for number in (self.low, self.high, value))
        bar = f"<= {high}" if self.low == -np.inf else f">= {low}" if self.high == np.inf else f"{low} to {high}"
        kept = "yes" if self.low <= value <= self.high else "no"
        return row(what, f"{bar}{self.unit}", paper, f"{found}{self.unit}{more}", kept)


def percent(low: float, high: float) -> Bar:
    """A bar in per cent."""
    return Bar(low / 100.0, high / 100.0, " %", 100.0, 1)


def plates(pairs: int, packings: int) -> tuple[MeasuredPairs, float]:
    """Friction tests of the plates, computed now, and their CPU time for a slide [s]."""
    design = design_on_preset(PRESET, first_surface=FIRST, packings=packings, micro_friction=MICRO)
    with TemporaryDirectory() as folder:
        path = Path(folder) / "plates.h5"
        started = time.process_time()
        generate_samples(path, design, plate_settings((), PRESET), pairs, SerialFarm())
        spent = time.process_time() - started
        data = arrange_tests(read_database(path).whole_pairs)
    return data, spent / data.meso.size


def band(data: MeasuredPairs, cpu_s: float) -> Iterator[str]:
    """What the plates give at 0.07, and how straight their law is."""
    k = data.micro.tolist().index(0.07)
    at = data.meso[..., k]  # (pairs, packings)
    mean, packing = float(at.mean()), float(at.var(axis=1, ddof=1).mean())
    surfaces = max(0.0, float(at.mean(1).var(ddof=1)) - packing / data.packings)
    rows = data.meso.reshape(-1, len(data.micro))
    a, b = np.polyfit(data.micro, rows.T, 1)
    off = (rows - a[:, None] * data.micro - b[:, None]) / rows.mean(1, keepdims=True)
    yield Bar(0.107, 0.116, digits=4).row("plates: mean coefficient at micro 0.07", mean, "0.11")
    means = ", ".join(f"{value:.4f}" for value in data.meso.mean(axis=(0, 1)))
    yield row(f"the same at {', '.join(f'{micro:g}' for micro in data.micro)}", "", "", means, "")
    yield row("its law", "", "", f"mu = {a.mean():.3f} mu_micro + {b.mean():.4f}", "")
    yield percent(8.5, 11.5).row("scatter of a pair at 0.07", np.sqrt(surfaces + packing) / mean)
    yield Bar(0.35, 0.6).row("share of the surfaces in its variance", surfaces / (surfaces + packing))
    yield percent(-np.inf, 1.5).row("straight line over the coefficients, rms", float(np.sqrt(np.mean(off**2))))
    yield row("CPU time of a slide", "", "5 hours", f"{cpu_s:.2f} s", "")


def networks() -> Iterator[str]:
    """Both networks on pairs that they have not seen."""
    shipped = SHIPPED[PRESET]
    with TemporaryDirectory() as folder:
        said, _ = evaluate_network(shipped.evaluation, shipped.energy, (shipped.cnn,), Path(folder))
    key, mean = "mean_relative_error", "mean_relative_error_all_packings"
    three = f" ({said['pairs']} pairs, {said['packings']} packings each)"
    for micro, points in (("0.07", 0.7), ("0.03", 1.2)):
        one = said["by_micro_friction"][micro]
        floor = 100.0 * one["noise_floor"]
        yield percent(-np.inf, floor + points).row(
            f"network, error at {micro} against one packing", one[key], "", f", floor {floor:.1f} %{three}"
        )
    at = said["by_micro_friction"]["0.07"]
    yield percent(-np.inf, 4.2).row("the same at 0.07 against the mean of the packings", at[mean])
    yield Bar(0.55, np.inf).row("R2 at 0.07 against the mean of the packings", at["r2_all_packings"])
    yield percent(86.0, 94.0).row("inside the stated 90 %", said["coverage_90"])
    yield row("mean line of these very pairs, error at 0.07", "", "", f"{100 * at['mean line'][key]:.1f} %", "")
    cnn, floor = at["paper"], 100.0 * at["noise_floor"]
    yield row(
        "paper's network, error at 0.07, all seeds together", "", "6.31 %",
        f"{100 * cnn[key]:.1f} %, floor {floor:.1f} %; {100 * cnn[mean]:.1f} % against the mean of the packings", "",
    )  # fmt: skip
    yield row("the same, each seed by itself", "", "", f"{span(seed_errors(), 1, 100.0)} %", "")


def seed_errors() -> list[float]:
    """Error at 0.07 against one packing of each member of the paper's network [-]."""
    model, about = load_checkpoint(SHIPPED[PRESET].cnn)
    data = arrange_tests(open_samples(SHIPPED[PRESET].evaluation).samples)
    k = data.micro.tolist().index(0.07)
    members: list[Any] = list(model.members) if isinstance(model, LallemanEnsemble) else [model]
    said = [predict_tests(member, about, data).mean[..., k] for member in members]
    return [float(np.mean(np.abs(one - data.meso[..., k]) / data.meso[..., k])) for one in said]


def force_at(assembly: Assembly, small: Sequence[str], micro: float, *more: str) -> FloatArray:
    """Forces [N] of `wheelset` on the network at a micro coefficient."""
    changes = [*small, *CHAIN, f"friction.options.micro_friction={float(micro)!r}", "output.stress=false"]
    return run(assembly, [*changes, "output.fields_at=[]", *more]).force


def chain(small: Sequence[str]) -> Iterator[str]:
    """`wheelset` on the plates as published, beside uniform friction."""
    assembly = assemble(load_scene("wheelset", small), MPI.COMM_SELF)
    uniform = run(assembly, [*small, "output.stress=false", "output.fields_at=[]"]).force
    one = force_at(assembly, small, 0.07)
    yield row("force at the end, uniform 0.11", "", "", f"{uniform[-1] / 1e6:.3f} MN", "")
    yield Bar(2.66e6, 2.80e6, " MN", 1e-6, 3).row("force at the end, micro 0.07", one[-1], "2.678 to 2.908 MN")
    off = float(np.sqrt(np.mean((one - uniform) ** 2)) / uniform.max())
    yield percent(-np.inf, 1.5).row("its curve against uniform 0.11, rms over the peak", off)
    ends = ", ".join(f"{force_at(assembly, small, micro)[-1] / 1e6:.3f}" for micro in MICRO)
    yield row(f"force at the end, micro {', '.join(map(str, MICRO))}", "", "", f"{ends} MN", "")
    found = fit_parameter(partial(force_at, assembly, small), uniform, 0.07, (0.0, 0.5))
    yield Bar(0.066, 0.074, digits=4).row("micro coefficient that matches uniform 0.11", float(found.value), "0.07")
    forces = [force_at(assembly, small, 0.07, f"friction.options.seed={seed}")[-1] for seed in range(1, 6)]
    width = float(np.ptp(forces) / np.mean(forces))
    told = f" ({span(forces, 3, 1e-6)} MN)"
    yield percent(0.6, 2.5).row("five surfaces, range of the force over its mean", width, "8 %", told)
    cnn = force_at(assembly, small, 0.07, "friction.options.network='cnn'")
    yield row("force at the end on the paper's network", "", "", f"{cnn[-1] / 1e6:.3f} MN", "")


def main(words: Sequence[str]) -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks as_published", description=__doc__)
    parser.add_argument("--quick", action="store_true", help="three pairs of plates, a coarse mesh, a short way")
    parser.add_argument("--pairs", type=int, default=30, help="of plates")
    options = parser.parse_args(words)
    print(head("", "bar", "Lalleman et al.", "here", "kept"))
    lines(band(*plates(3 if options.quick else options.pairs, 2)))
    lines(networks())
    lines(chain(TINY if options.quick else ()))
    return 0
