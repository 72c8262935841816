"""How do the database, the training and the predictions of the network grow with the number of pairs?

    python -m tests.benchmarks surrogate_scaling [--quick] [--figure docs/surrogate_scaling.png]

Databases of 100 to 5000 pairs with made-up answers, which no cost depends on: CPU times of filling one, of adding one
pair to it, of reading it with all checks, of the hash of its content, and of a training: what comes before the first
epoch, and an epoch. Peak memory is that of a process of its own that reads and trains, beyond one that does it with 40
pairs. Then pairs predicted from their faces, and friction tests of small plates made by the farm in one process, in a
cache of its own. The exponent k of cost ~ pairs^k stands below each column: 1 is proportional.
"""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import torch

from macrofit.base.farm import SerialFarm
from meso.settings import FaceKeys
from surrogate.data.database import Samples, content_hash, open_database, read_database
from surrogate.data.design import Design
from surrogate.data.faces import generated_face
from surrogate.data.generate import generate_samples
from surrogate.data.sample import plate_settings
from surrogate.evaluation.measured import select_samples
from surrogate.network.predict import Predictor

from ._database import TOY, made_up
from ._measure import alone, cpu, growth, head, row, save

PAIRS = (100, 300, 1000, 3000, 5000)
PREDICTED = (1_000, 10_000, 100_000)
GENERATED = (25, 50, 100)
EPOCHS = 30
FEWEST = 40
"""Pairs of the process whose memory counts as none."""
STEEP = 1.1
"""An exponent that is no longer proportional."""
Columns = dict[str, list[float]]

TRAINING = """
import time, torch
from pathlib import Path
import numpy as np
from surrogate.data.database import read_database
from surrogate.evaluation.measured import select_samples
from surrogate.network.train import train_network
torch.set_num_threads(1)

def cpu(samples, epochs):
    begin = time.process_time()
    train_network(samples, epochs=epochs)
    return time.process_time() - begin

samples = read_database(Path({path!r})).samples
cpu(select_samples(samples, np.arange({fewest})), 1)
setup = cpu(samples, 0)
print(setup, (cpu(samples, {epochs}) - setup) / {epochs})
"""


def fill(path: Path, samples: Samples) -> None:
    """Append the samples to a database, one after the other as a farm does."""
    rows = np.zeros(len(samples), TOY.row())
    for name in TOY.row().names or ():
        rows[name] = getattr(samples, name)
    with open_database(path, TOY) as (writer, done):
        for one in rows:
            if int(one["id"]) not in done:
                writer.append(one.tobytes())


def databases(every: Samples, sizes: Sequence[int], folder: Path, repeats: int) -> Iterator[dict[str, float]]:
    """What databases of these sizes cost, a row each; one sample of `every` is left for each to be added."""
    least = folder / "least.h5"
    fill(least, select_samples(every, np.arange(FEWEST)))
    bare = float(alone(TRAINING.format(path=str(least), epochs=1, fewest=FEWEST))[-1])
    for size in sizes:
        path, samples = folder / f"{size}.h5", select_samples(every, np.arange(size))
        written, _ = cpu(partial(fill, path, samples), repeats=1, warm=0)
        setup, epoch, peak = map(float, alone(TRAINING.format(path=str(path), epochs=EPOCHS, fewest=FEWEST)))
        size_mb = path.stat().st_size / 1e6
        reading, _ = cpu(partial(read_database, path), repeats)
        hashing, _ = cpu(partial(content_hash, samples), repeats)
        one = select_samples(every, np.array([len(every) - 1]))
        added, _ = cpu(partial(fill, path, one), repeats=1, warm=0)
        path.unlink()
        yield {
            "file MB": size_mb,
            "filling CPU s": written.median,
            "adding one CPU s": added.median,
            "reading CPU s": reading.median,
            "hash CPU s": hashing.median,
            "before training CPU s": setup,
            "epoch CPU s": epoch,
            "memory MiB": max(peak - bare, 1.0),
        }


def predictions(sizes: Sequence[int], repeats: int) -> Iterator[dict[str, float]]:
    """CPU time of pairs of the fewest surfaces that have as many."""
    predictor = Predictor()
    points = predictor.provenance.points
    for size in sizes:
        faces = int(np.ceil(np.sqrt(size)))
        wheels, axles = (
            np.stack([generated_face(body, 65536 * k, FaceKeys(), points) for k in range(faces)])
            for body in ("wheel", "axle")
        )
        wheel, axle = np.divmod(np.arange(size), faces)
        taken, _ = cpu(partial(predictor, wheels, axles, wheel, axle, 0.07), repeats)
        yield {"CPU s": taken.median, "CPU µs of a pair": 1e6 * taken.median / size}


def generations(sizes: Sequence[int], folder: Path) -> Iterator[dict[str, float]]:
    """CPU time of whole databases of small plates, after a warm one."""
    settings = plate_settings(["plates.spheres=600"])
    with own_cache(folder / "warm"):
        generate_samples(folder / "warm.h5", Design(), settings, 1, SerialFarm())
    for size in sizes:
        path = folder / f"farm{size}.h5"
        with own_cache(folder / f"cache{size}"):
            began = time.process_time()
            generate_samples(path, Design(), settings, size, SerialFarm())
            taken = time.process_time() - began
        found = read_database(path)
        if len(found.samples) + len(found.failures) != size:
            raise RuntimeError(f"{size} pairs were asked for, {len(found.samples)} are there")
        yield {"CPU s": taken, "pairs per CPU s": size / taken}


@contextmanager
def own_cache(folder: Path) -> Iterator[None]:
    """Packings are made anew, and kept where nobody finds them."""
    before = os.environ.get("MACROFIT_CACHE")
    os.environ["MACROFIT_CACHE"] = str(folder)
    try:
        yield
    finally:
        os.environ.pop("MACROFIT_CACHE")
        if before is not None:
            os.environ["MACROFIT_CACHE"] = before


def table(what: str, sizes: Sequence[int], rows: Iterator[dict[str, float]]) -> Columns:
    """Print rows as they come, and the exponents below; gives the columns."""
    columns: Columns = {}
    for size, found in zip(sizes, rows, strict=True):
        if not columns:
            print(head(what, *found))
        for name, value in found.items():
            columns.setdefault(name, []).append(value)
        print(row(size, *(f"{value:.3g}" for value in found.values())), flush=True)
    print(row("exponent", *(f"{growth(sizes, values):.2f}" for values in columns.values())) + "\n")
    return columns


def main(words: Sequence[str]) -> int:
    """Print the tables, draw the figure."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks surrogate_scaling", description=__doc__)
    parser.add_argument("--quick", action="store_true", help="Few pairs: to see that it runs.")
    parser.add_argument("--figure", type=Path)
    options = parser.parse_args(words)
    torch.set_num_threads(1)
    quick: bool = options.quick
    stored, asked, made = ((50, 100), (100, 300), (1, 2)) if quick else (PAIRS, PREDICTED, GENERATED)
    repeats = 1 if quick else 3
    every = made_up(stored[-1] + 1, np.random.default_rng(0))
    with TemporaryDirectory() as name:
        folder = Path(name)
        database = table("pairs in the database", stored, databases(every, stored, folder, repeats))
        del every
        predicted = table("pairs predicted", asked, predictions(asked, repeats))
        generated = table("friction tests of 600 spheres", made, generations(made, folder))
    series = {name.removesuffix(" CPU s"): (stored, values) for name, values in database.items() if "CPU s" in name}
    series |= {"predicting": (asked, predicted["CPU s"]), "making friction tests": (made, generated["CPU s"])}
    steep = [name for name, (sizes, costs) in series.items() if growth(sizes, costs) > STEEP]
    print(f"Faster than proportional (exponent above {STEEP:g}): {', '.join(steep) or 'nothing'}.")
    if options.figure:
        draw(series, options.figure)
    return 0


def draw(series: dict[str, tuple[Sequence[float], Sequence[float]]], target: Path) -> None:
    """CPU time against the number of pairs."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.0, 4.2), dpi=150, layout="constrained")
    axes = figure.subplots()
    for name, (sizes, costs) in series.items():
        axes.loglog(sizes, costs, "o-", ms=4, lw=1.2, label=f"{name}, exponent {growth(sizes, costs):.2f}")
    axes.set_xlabel("pairs")
    axes.set_ylabel("CPU time [s]")
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), frameon=False, fontsize=8)
    save(figure, target)
