"""The command `macrofit-surrogate`. What is heavy is imported inside the commands, so that help comes at once."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from macrofit.base.commands import FILE, INTERRUPTED, SETTINGS, Commands, complain, few_threads, set_option
from macrofit.base.files import keep_inputs
from macrofit.base.progress import announce, launched
from meso.measured.options import asked_scan, refuse_idle_seed, scan_options, take_options
from meso.presets import DEFAULT, PRESETS, on_preset, presets_line

if TYPE_CHECKING:
    from click.shell_completion import CompletionItem
    from mpi4py import MPI

    from macrofit.base.farm import Farm
    from meso.measured.keys import ScanKeys

    from .network.checkpoint import Control
    from .network.shipped import Shipped


LOADING, LOADING_NETWORK = "Network         loading torch", "Network         loading"
"""What is said before anything heavy is loaded."""


@click.group("macrofit-surrogate", cls=Commands, context_settings=SETTINGS)
@click.version_option(package_name="macrofit", prog_name="macrofit-surrogate")
def main() -> None:
    """The network that replaces the rough plates, and the data it learns from.

    Lengths are in mm, forces in N.
    """
    few_threads()


def completes_key(context: click.Context, parameter: click.Parameter, incomplete: str) -> list[CompletionItem]:
    """Keys of the plates' settings and their values, for a shell."""
    from macrofit.base.completion import keys_and_values
    from macrofit.base.keys import dotted_keys
    from meso.settings import Settings

    return keys_and_values(dotted_keys(Settings), incomplete)


preset_option = click.option(
    "--preset", type=click.Choice(list(PRESETS)), default=DEFAULT, show_default=True,
    help=f"The plates. {presets_line()}.",
)  # fmt: skip
network_option = click.option(
    "-n", "--network", default="energy", show_default=True, metavar="FILE.safetensors|energy|cnn",
    help="A network, or one of the two that come with the program for the preset.",
)  # fmt: skip


device_option = click.option(
    "--device", metavar="cpu|cuda", help="Where torch computes [a GPU where there is one].",
)  # fmt: skip


on_device_option = click.option(
    "--device", default="cpu", show_default=True, metavar="cpu|cuda", help="Where torch computes.",
)  # fmt: skip


def network_file(network: str, shipped: Shipped) -> Path:
    """The file of a network that is named, or is a file."""
    return {"energy": shipped.energy, "cnn": shipped.cnn}.get(network, Path(network))


def numbers(kind: type[int] | type[float], most: int | None = None) -> Callable[..., Any]:
    """A callback for numbers between commas, `most` at most; None where nothing is given."""

    def read(context: click.Context, option: click.Parameter, text: str | None) -> tuple[Any, ...] | None:
        if text is None:
            return None
        try:
            given = tuple(kind(part) for part in text.split(","))
        except ValueError:
            whole = "whole numbers" if kind is int else "numbers"
            raise click.BadParameter(f"'{text}': give {whole} between commas") from None
        if most is not None and len(given) > most:
            raise click.BadParameter(f"'{text}': give one number, or the lower and the upper one")
        return given

    return read


def count_or_coefficients(context: click.Context, option: click.Parameter, text: str) -> int | tuple[float, ...]:
    """A whole number, or numbers between commas."""
    given: int | tuple[float, ...] = int(text) if text.isdecimal() else numbers(float)(context, option, text)
    return given


@main.command()
@click.option("-o", "--output", "path", type=FILE, required=True, metavar="FILE.h5", help="The database.")
@click.option("--pairs", type=click.IntRange(1), required=True, help="Of surfaces, counted from the first.")
@click.option("--seed", type=int, default=0, show_default=True, help="Of the design's scrambling.")
@preset_option
@click.option(
    "--design", type=click.Choice(["narrow", "wide"]), default="narrow", show_default=True,
    help="Ranges: R 5-40 µm at one pressure; or R 1-100 µm, 20-520 MPa, tiles and strips, a third with a lay, micro "
    "coefficients to 0.3, at constant force.",
)  # fmt: skip
@click.option("--spheres", type=int, help="In both plates together, instead of the preset's.")
@set_option("the plates' settings", completes_key)
@click.option(
    "--micro-friction", callback=count_or_coefficients, default="2", show_default=True, metavar="K|MU[,MU...]",
    help="How many coefficients per pair, one in each part of the range; or the coefficients themselves.",
)  # fmt: skip
@click.option(
    "--max-height", callback=numbers(float, 2), metavar="LOW,HIGH",
    help="Range R of the random heights [mm], log-uniform [0.005,0.04, or the preset's].",
)  # fmt: skip
@click.option(
    "--levels", callback=numbers(int), metavar="N[,N...]",
    help="Subdivisions: 2^n + 1 points along 1 mm [3,4, or the preset's].",
)  # fmt: skip
@click.option(
    "--hurst", callback=numbers(float, 2), metavar="LOW,HIGH",
    help="Hurst exponent, uniform [0.5,1.0, or the preset's].",
)  # fmt: skip
@click.option(
    "--pressure", callback=numbers(float, 2), metavar="LOW,HIGH",
    help="Range of the pressure before the slide [MPa], log-uniform [the plates', or 20,520 of the wide design].",
)  # fmt: skip
@click.option("--packings", type=int, default=1, show_default=True, help="Of the same pair of surfaces.")
@click.option("--first-surface", type=int, default=0, show_default=True, help="Seed of the first pair's surfaces.")
@click.option("--first-packing", type=int, default=0, show_default=True, help="First of the 256 seeds of packings.")
@click.option("--jobs", type=click.IntRange(1), help="Processes; all cores where it is left out. Not under mpirun.")
@click.option("--quiet", is_flag=True, help="Say nothing but errors.")
def generate(
    path: Path,
    overrides: tuple[str, ...],
    preset: str,
    design: str,
    spheres: int | None,
    jobs: int | None,
    quiet: bool,
    max_height: tuple[float, ...] | None,
    hurst: tuple[float, ...] | None,
    pressure: tuple[float, ...] | None,
    pairs: int,
    **options: Any,
) -> None:
    """Fill a database with friction tests of random pairs of rough plates.

    Whatever ends it, the same command goes on: samples that are there are not computed again, and more --pairs add to
    them. Under mpirun all ranks compute, and the first one writes.
    """
    announce("Plates          loading their engines", quiet=quiet)
    with farm(jobs) as workers:
        if workers is None:
            return
        from .data.database import describe_database
        from .data.design import SETTINGS_OF_DESIGN
        from .data.generate import generate_samples as fill
        from .data.monitor import on_screen
        from .data.sample import design_on_preset, plate_settings

        ranges = {"max_height": max_height, "hurst_exponent": hurst, "pressure": pressure}
        both = {name: given and (given[0], given[-1]) for name, given in ranges.items()}
        drawn = design_on_preset(preset, design, **both, **options)
        changes = [*SETTINGS_OF_DESIGN[design], *([] if spheres is None else [f"plates.spheres={spheres}"]), *overrides]
        settings = plate_settings(changes, preset, drawn)
        try:
            fill(path, drawn, settings, pairs, workers, on_screen(quiet=quiet))
        except KeyboardInterrupt:
            complain(f"interrupted; what was computed is kept beside {path}, and the same command goes on")
            if (comm := ranks()) is not None:
                comm.Abort(INTERRUPTED)
            click.get_current_context().exit(INTERRUPTED)
        for line in [] if quiet else describe_database(path):
            click.echo(line)


@contextmanager
def farm(jobs: int | None) -> Iterator[Farm | None]:
    """Who computes: the ranks of mpirun, or processes of this machine; None on a rank that has helped the first one."""
    from macrofit.base.farm import MpiFarm, ProcessFarm, SerialFarm

    comm = ranks()
    if comm is None:
        jobs = jobs or len(os.sched_getaffinity(0))
        yield SerialFarm() if jobs == 1 else ProcessFarm(jobs)
        return
    if jobs is not None:
        raise click.UsageError("--jobs: leave it out under mpirun, whose ranks do the work")
    with MpiFarm(comm) as workers:
        if comm.rank == 0:
            yield workers
        else:
            signal.signal(signal.SIGINT, signal.SIG_IGN)  # the first rank ends all
            signal.signal(signal.SIGTERM, signal.SIG_DFL)
            workers.help()
            yield None


def ranks() -> MPI.Comm | None:
    """The ranks of mpirun; None where this process is alone."""
    if not launched():
        return None
    from mpi4py import MPI

    return MPI.COMM_WORLD if MPI.COMM_WORLD.size > 1 else None


@main.command()
@click.argument("databases", type=FILE, nargs=-1, required=True, metavar="DB.h5|TABLE.csv...")
@click.option("-o", "--output", "path", type=FILE, required=True, metavar="FILE.safetensors", help="The network.")
@click.option(
    "--architecture", type=click.Choice(["energy", "paper"]), default="energy", show_default=True,
    help="Shaped like the physics, or as Lalleman et al. describe it.",
)  # fmt: skip
@click.option(
    "--faces", type=click.Choice(["generated", "envelope"]), default="generated", show_default=True,
    help="Learn from surfaces as generated, or as the envelopes of their spheres.",
)  # fmt: skip
@click.option("--seed", type=click.IntRange(0, 2**32 - 1), default=0, show_default=True, help="Of split and start.")
@click.option("--members", type=click.IntRange(1, 64), default=8, show_default=True, help="Of the ensemble (energy).")
@click.option("--width", type=click.IntRange(1, 1024), default=24, show_default=True, help="Of its perceptrons.")
@click.option(
    "--constant/--no-constant", default=None,
    help="b has a constant besides (energy) [where the plates have a speed].",
)  # fmt: skip
@click.option(
    "--seeds", type=click.IntRange(1, 64), default=1, show_default=True,
    help="Networks from this seed on; several are an ensemble, with an uncertainty (paper).",
)  # fmt: skip
@click.option("--points", type=click.IntRange(5), help="Of a face along 1 mm, such as 17 [those of the database].")
@click.option("--epochs", type=click.IntRange(0), help="At most; training stops early by itself.")
@device_option
@click.option("--quiet", is_flag=True, help="Say nothing but errors.")
def train(databases: tuple[Path, ...], path: Path, quiet: bool, **options: Any) -> None:
    """Train the network on a database, or on several; 30 % of the surfaces are held back.

    Beside FILE.safetensors it writes the loss curves of both parts, FILE.loss.csv and FILE.loss.png.
    """
    started = time.perf_counter()
    announce(LOADING, quiet=quiet)
    from .data.table import open_samples
    from .errors import TrainingError
    from .evaluation.curves import write_curves
    from .network.checkpoint import save_checkpoint
    from .network.train import train_network as fit

    if path.suffix != ".safetensors":
        raise click.UsageError(f"--output {path}: give a name that ends in .safetensors")
    if not path.resolve().parent.is_dir():
        raise TrainingError(f"{path}: there is no directory {path.resolve().parent}")
    found, *more = (open_samples(database) for database in databases)
    beside = [(other.samples, other.header.plates) for other in more]
    resume = path.with_suffix(".state.safetensors")
    trained = fit(found.samples, plates=found.header.plates, beside=beside, resume=resume, **options)
    save_checkpoint(path, trained.model, trained.provenance)
    label = "negative log-likelihood" if options["architecture"] == "energy" else "mean squared error, scaled"
    written = [path, *write_curves(trained.curves, path.with_suffix(""), label, trained.others)]
    if quiet:
        return
    about, scores = trained.provenance, trained.scores
    click.echo(
        f"Learned from    {about.training} pairs, {about.validation} held back; kept epoch "
        f"{', '.join(str(curves.best) for curves in (trained.curves, *trained.others))}"
    )
    for low, high, count, error in scores.by_bin:
        click.echo(
            f"  micro {low:.2f} ... {high:.2f}   {count:5d} samples   mean error over mean {100.0 * error:.2f} %"
        )
    at = ", ".join(f"{100.0 * error:.2f} % at {micro}" for micro, error in scores.error.items())
    click.echo(f"Relative error  {at} (on the line through both)")
    click.echo(f"R2 of b         {scores.r2:.3f}; {100.0 * scores.coverage:.0f} % inside the stated 90 % interval")
    click.echo(f"Wrote           {', '.join(map(str, written))} in {time.perf_counter() - started:.0f} s")


@main.command()
@click.argument("database", type=FILE, required=False, metavar="[DB.h5|TABLE.csv]")
@preset_option
@network_option
@click.option(
    "--beside", type=FILE, multiple=True, metavar="FILE.safetensors",
    help="Another network to show beside it; several may be given.",
)  # fmt: skip
@click.option(
    "-o", "--output", "folder", type=FILE, default="evaluation", show_default=True, help="For what it writes."
)
@on_device_option
def evaluate(
    database: Path | None, preset: str, network: str, beside: tuple[Path, ...], folder: Path, device: str
) -> None:
    """Judge a network by friction tests of surfaces it has never seen.

    Writes evaluation.json and three figures. Without a database it takes the hundred configurations that come with the
    program for the preset; without any network, the shipped one with the paper's architecture beside it.
    """
    announce(LOADING, quiet=False)
    from .evaluation.report import evaluation_lines
    from .evaluation.run import evaluate_network
    from .network.shipped import SHIPPED

    shipped = SHIPPED[preset]
    if network == "energy" and not beside:
        beside = (shipped.cnn,)
    judged, by = network_file(network, shipped), database or shipped.evaluation
    result, written = evaluate_network(by, judged, beside, folder, device)
    for line in evaluation_lines(result):
        click.echo(line)
    click.echo(f"Wrote           {', '.join(map(str, written))}")


@main.command()
@preset_option
@network_option
@click.option("--wheel", type=FILE, metavar="FILE", help="Measured face of the wheel, 1 x 1 mm (docs/surfaces.md).")
@click.option("--axle", type=FILE, metavar="FILE", help="Measured face of the axle, 2 x 1 mm.")
@scan_options
@click.option(
    "--set-wheel", multiple=True, metavar="KEY=VALUE", help="For the wheel's file alone, such as spacing=0.01."
)
@click.option("--set-axle", multiple=True, metavar="KEY=VALUE", help="For the axle's file alone, such as unit=um.")
@click.option("--wheel-seed", type=click.IntRange(0), help="Of a generated face, or the place on a strip [1].")
@click.option("--axle-seed", type=click.IntRange(0), help="Of a generated face, or the place on a strip [2].")
@click.option("--max-height", type=float, help="Range R of the random heights [mm] [0.02, or the preset's].")
@click.option("--levels", type=int, help="Subdivisions: 2^n + 1 points along 1 mm [3, or the preset's].")
@click.option("--hurst-exponent", type=float, help="From 0 (rough) to 1 (smooth) [0.8, or the preset's].")
@click.option(
    "--form", type=click.Choice(["strip", "tiles", "levelled"]),
    help="Pieces of a strip, tiles by themselves, or those without their mean plane [strip, or the preset's].",
)  # fmt: skip
@click.option(
    "--micro-friction", callback=numbers(float), default="0.03,0.05,0.07,0.09", show_default=True,
    metavar="MU[,MU...]", help="Coefficients of sphere on sphere.",
)  # fmt: skip
@click.option("--pressure", type=click.FloatRange(min=0.0, min_open=True), help="Before the slide, on steel [MPa].")
@click.option("--control", type=click.Choice(["displacement", "force"]), help="What is held while sliding.")
@on_device_option
@click.option("-o", "--output", "target", type=FILE, metavar="FILE.png|FILE.csv", help="Figure, or a table.")
def predict(
    preset: str,
    network: str,
    target: Path | None,
    micro_friction: tuple[float, ...],
    pressure: float | None,
    control: Control | None,
    wheel: Path | None,
    axle: Path | None,
    set_wheel: tuple[str, ...],
    set_axle: tuple[str, ...],
    device: str,
    **surface: Any,
) -> None:
    """Predict the meso coefficient of a pair of rough faces, from their seeds or from files.

    The same seeds and keys as in `macrofit-meso run`, which computes what is predicted here.
    """
    announce(LOADING_NETWORK, quiet=False)
    from msgspec.structs import replace

    from meso.settings import decode

    from .evaluation.prediction import prediction_lines, write_prediction
    from .network.predict import Predictor
    from .network.shipped import SHIPPED
    from .pair import predict_pair

    if target is not None and target.suffix.lower() not in (".png", ".csv"):
        raise click.UsageError(f"--output {target}: give a name that ends in .png or .csv")
    keep_inputs([target] if target else [], [file for file in (axle, wheel) if file is not None])
    scan = take_options(surface, "--axle or --wheel", bool(axle or wheel), not (axle and wheel))
    given = {"axle": (axle, set_axle), "wheel": (wheel, set_wheel)}
    files = {"axle" if body == "axle" else "bore": _own_keys(body, *given[body], scan, surface) for body in given}
    tables = on_preset(preset, {"surface": {key: value for key, value in surface.items() if value is not None}})
    keys = replace(decode({"surface": tables["surface"]}).surface, **files)
    predictor = Predictor(network_file(network, SHIPPED[preset]), device)
    pair = predict_pair(predictor, micro_friction, keys, pressure, control)
    for warning in pair.outside:
        complain(f"warning: {warning}; the network has not seen such a case")
    for doubt in pair.doubts:
        complain(f"warning: {doubt}")
    for line in prediction_lines(pair):
        click.echo(line)
    if target is not None:
        write_prediction(pair, target)
        click.echo(f"Wrote           {target}")


def _own_keys(
    body: str, file: Path | None, own: tuple[str, ...], shared: dict[str, Any], surface: dict[str, Any]
) -> ScanKeys | None:
    """The keys of a body's file, those of both files and its own; None where its face is generated."""
    if file is None:
        if own:
            raise click.UsageError(f"--set-{body}: is for the file of the {body}: leave it out, or give --{body}")
        return None
    keys = asked_scan(file, shared, own, f"--set-{body}")
    refuse_idle_seed(keys, f"--{body}-seed", surface[f"{body}_seed"])
    return keys


@main.command()
@click.argument("database", type=FILE, metavar="DB.h5")
@click.option("-o", "--output", "path", type=FILE, required=True, metavar="TABLE.csv", help="The table.")
def table(database: Path, path: Path) -> None:
    """Write a database as a table of text: all but the heights, which follow from the seeds."""
    from .data.database import read_database
    from .data.table import TABLES, is_table, write_table

    if not is_table(path):
        raise click.UsageError(f"--output {path}: give a name that ends in {' or '.join(TABLES)}")
    found = read_database(database)
    write_table(found, path)
    click.echo(f"Wrote           {path}: {len(found.whole_pairs)} samples, {path.stat().st_size / 1e3:.0f} kB")
