"""The commands of `macrofit`. What is heavy is imported inside the commands, so that help comes at once."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from .. import __version__
from ..base.caches import RANKS
from ..base.commands import FILE, SETTINGS, Commands, complain, few_threads
from ..base.progress import announce
from ..base.ranks import ending
from .options import POSITIVE, changes, completes_key, reads_curves, scene_argument, standard_option

if TYPE_CHECKING:
    from ..acceptance import Standard
    from ..scene import Scene


@click.group("macrofit", cls=Commands, context_settings=SETTINGS)
@click.version_option(__version__, prog_name="macrofit")
def main() -> None:
    """Press a railway wheel onto its axle: fitting curve, stresses, pressure along the seat.

    SCENE is the name of a built-in scene (see `macrofit scenes`) or a TOML file.
    """
    few_threads()
    if not any(name in os.environ for name in RANKS):
        # Alone, Open MPI would start a daemon for children that nobody will spawn, and look for fast networks: 0.2 s.
        os.environ.setdefault("OMPI_MCA_ess_singleton_isolated", "1")
        os.environ.setdefault("OMPI_MCA_mtl", "^psm,psm2,ofi")


@main.command()
@scene_argument
@click.option(
    "-o",
    "--output",
    "folder",
    type=FILE,
    help="Folder of the results [the scene's name].",
)
@changes
@standard_option
@click.option("--resume", is_flag=True, help="Continue the run in the folder after its last increment.")
@click.option("--strict", is_flag=True, help="Take a doubt about the run for an error (its results are kept).")
@click.option("--quiet", is_flag=True, help="Say nothing but errors and doubts.")
def run(
    scene: str,
    folder: Path | None,
    overrides: tuple[str, ...],
    standard: str | None,
    resume: bool,
    strict: bool,
    quiet: bool,
) -> None:
    """Compute SCENE and write curve, stresses and figures into a folder; also under mpirun.

    A folder with results of a run is replaced. A folder with anything else in it is refused, and so is one
    with an unfinished run of the same scene, which --resume continues.
    """
    announce(loading(scene), quiet=quiet)
    from mpi4py import MPI

    comm, target = MPI.COMM_WORLD, folder or Path(Path(scene).stem)
    with ending(comm, target):
        from ..base.ranks import made_by_first
        from ..scene import idle_keys, load_scene

        resolved, rules = made_by_first(comm, lambda: (load_scene(scene, overrides), asked_standard(standard)))
        for line in idle_keys(resolved) if comm.rank == 0 else []:
            complain(f"warning: {line}")
        import_mesher_for(resolved, comm.rank)
        from ..run import carry_out

        lines = carry_out(resolved, comm, target, resume=resume, quiet=quiet, strict=strict, standard=rules)
        say_lines(lines, quiet=quiet)


def asked_standard(named: str | None) -> Standard | None:
    """The standard of `--standard`; None where there is none. Raises StandardError."""
    if named is None:
        return None
    from ..acceptance import load_standard

    return load_standard(named)


@main.command()
@scene_argument
@click.option(
    "--vary",
    multiple=True,
    required=True,
    metavar="KEY=V1,V2,...",
    shell_complete=completes_key,
    help="Values of a key of the scene, or a range first:last:step, 0.1:0.5:0.1. More than one: every combination.",
)
@click.option(
    "--reference",
    "references",
    multiple=True,
    metavar="uniform=MU",
    help="One more run to compare with; also KEY=VALUE,KEY=VALUE,... as for --set.",
)
@changes
@standard_option
@click.option("-o", "--output", "folder", type=FILE, help="Folder [the scene's name]-study.")
@click.option("--resume", is_flag=True, help="Compute only the runs that the folder does not hold yet.")
@click.option("--keep", is_flag=True, help="Write the whole folder of each run, in runs/.")
@click.option(
    "--service",
    is_flag=True,
    help="Turn each wheelset under its loads too, see `macrofit service`: slip, friction work, criteria.",
)
@click.option("--quiet", is_flag=True, help="Say nothing but errors.")
def study(
    scene: str,
    vary: tuple[str, ...],
    references: tuple[str, ...],
    overrides: tuple[str, ...],
    standard: str | None,
    folder: Path | None,
    resume: bool,
    keep: bool,
    service: bool,
    quiet: bool,
) -> None:
    """Run SCENE with several values of its keys; under mpirun the runs are dealt to the ranks.

    Bodies are factored once for all runs. Writes study.csv, curves.csv, study.json and figures into a folder;
    stress fields only where the scene has output.fields_at.

    \b
    macrofit study wheelset --set friction.provider=surrogate --reference uniform=0.11 \\
        --vary friction.options.micro_friction=0.01,0.03,0.05,0.07,0.09
    mpirun -n 2 macrofit study wheelset --set friction.provider=surrogate --vary friction.options.seed=1:200
    macrofit study wheelset --service --vary friction.options.coefficient=0.1:0.6:0.1
    """  # noqa: D301 - click wants the character
    announce(loading(scene), quiet=quiet)
    from mpi4py import MPI

    comm, target = MPI.COMM_WORLD, folder or Path(f"{Path(scene).stem}-study")
    with ending(comm, target):
        from ..base.ranks import made_by_first
        from ..errors import StandardError
        from ..study.plan import Plan, plan_study
        from ..study.run import carry_out_study

        def planned() -> Plan:
            if service and standard is not None:
                raise StandardError(f"--standard: {standard} judges presses, not their service; leave it out")
            return plan_study(scene, vary, overrides, references, standard=asked_standard(standard))

        plan = made_by_first(comm, planned)
        carry_out = carry_out_study
        if service:
            from ..service.study import carry_out_service_study as carry_out
        say_lines(carry_out(plan, comm, target, resume=resume, keep=keep, quiet=quiet), quiet=quiet)


@main.command()
@scene_argument
@click.option(
    "--curve",
    required=True,
    type=FILE,
    help="Measured curve: text with columns of displacement and force; units by the header, mm and N without one.",
)
@reads_curves
@click.option("--free-shift", is_flag=True, help="Seek such a shift too, for a record that began late.")
@click.option(
    "--key",
    metavar="KEY",
    shell_complete=completes_key,
    help="What is sought [the provider's coefficient or micro_friction].",
)
@click.option("--bounds", metavar="LOW,HIGH", help="Values it may have.")
@changes
@click.option("-o", "--output", "folder", type=FILE, help="Folder [the scene's name]-identified.")
@click.option("--quiet", is_flag=True, help="Say nothing but errors.")
def identify(
    scene: str,
    curve: Path,
    key: str | None,
    bounds: str | None,
    overrides: tuple[str, ...],
    folder: Path | None,
    quiet: bool,
    columns: str | None,
    free_shift: bool,
    **of_curve: Any,
) -> None:
    """Find the friction of SCENE for which its fitting curve matches a measured one, with its standard error.

    Writes identification.json, identified_curve.csv and a figure into a folder.
    """
    announce(loading(scene), quiet=quiet)
    from mpi4py import MPI

    comm, target = MPI.COMM_WORLD, folder or Path(f"{Path(scene).stem}-identified")
    with ending(comm, target, resumes=False):
        from ..identify.measured import Reading, interval, two_columns
        from ..identify.output import carry_out_identification

        reading = Reading(columns=two_columns(columns), **of_curve)
        lines = carry_out_identification(
            scene,
            curve,
            comm,
            target,
            overrides=overrides,
            key=key,
            bounds=interval(bounds),
            quiet=quiet,
            reading=reading,
            free_shift=free_shift,
        )
        say_lines(lines, quiet=quiet)


@main.command()
@click.argument("curve", type=FILE)
@click.option("--diameter", type=POSITIVE, metavar="MM", help="Diameter of the seat.")
@click.option("--length", type=POSITIVE, metavar="MM", help="Length that seat and bore have in common at the end.")
@click.option("--interference", type=float, metavar="MM", help="Measured interference, on the diameter.")
@standard_option
@click.option("--wheel", metavar="TYPE", help="Type of wheel in the standard, for its window of the final force.")
@reads_curves
@click.option("-o", "--output", "target", type=FILE, help="Write the verdict to this file too, as JSON.")
@click.option("--json", "as_json", is_flag=True, help="Print JSON, see `macrofit schema verdict`.")
@click.pass_context
def judge(
    context: click.Context,
    curve: Path,
    diameter: float | None,
    length: float | None,
    interference: float | None,
    standard: str | None,
    wheel: str | None,
    target: Path | None,
    as_json: bool,
    columns: str | None,
    **of_curve: Any,
) -> None:
    """Hold a measured CURVE, or the folder of a run, against a standard for wheelsets.

    CURVE is text with columns of displacement and force, as for identify. Ends with 0 where the fit is accepted,
    1 where it is refused, 2 where it cannot be judged.

    \b
    macrofit judge press.csv --diameter 190 --length 180
    macrofit judge press.csv --diameter 190 --length 180 --standard gost-11018 --wheel emu
    macrofit judge wheelset
    """  # noqa: D301 - click wants the character
    from ..identify.measured import Reading, two_columns
    from ..judge import Seat, carry_out_judgement

    reading = Reading(columns=two_columns(columns), **of_curve)
    seat = Seat(diameter=diameter, length=length, interference=interference)
    lines, code = carry_out_judgement(
        curve, seat, reading=reading, standard=standard, wheel=wheel, target=target, as_json=as_json
    )
    for line in lines:
        click.echo(line)
    context.exit(code)


@main.command()
@scene_argument
@click.option(
    "--tolerance", type=POSITIVE, default=0.05, show_default=True,
    help="Relative error of force, pressure and largest stress that a preset must meet.",
)  # fmt: skip
@changes
@click.option("-o", "--output", "folder", type=FILE, help="Folder [the scene's name]-convergence.")
@click.option("--quiet", is_flag=True, help="Say nothing but errors.")
def converge(scene: str, tolerance: float, overrides: tuple[str, ...], folder: Path | None, quiet: bool) -> None:
    """Estimate how exact SCENE is: force, pressure and largest stress on three meshes and with two step lengths.

    The meshes are twice as coarse as the scene's, its own and twice as fine; Richardson's extrapolation gives the
    limit. Then the presets are tried, cheapest first, until one meets the tolerance. Writes convergence.json.
    """
    announce(loading(scene), quiet=quiet)
    from mpi4py import MPI

    comm, target = MPI.COMM_WORLD, folder or Path(f"{Path(scene).stem}-convergence")
    with ending(comm, target, resumes=False):
        if comm.rank < 2:
            import_mesher()
        from ..converge.run import carry_out_convergence

        lines = carry_out_convergence(scene, comm, target, overrides=overrides, tolerance=tolerance, quiet=quiet)
        say_lines(lines, quiet=quiet)


@main.command()
@scene_argument
@click.option("--bonded", is_flag=True, help="Only the linear solution where nothing slips; without a press.")
@changes
@click.option("-o", "--output", "folder", type=FILE, help="Folder [the scene's name]-service.")
@click.option("--resume", is_flag=True, help="Continue the computation in the folder after its last step.")
@click.option("--quiet", is_flag=True, help="Say nothing but errors.")
def service(
    scene: str, bonded: bool, overrides: tuple[str, ...], folder: Path | None, resume: bool, quiet: bool
) -> None:
    """Press the wheel of SCENE on, let it go, and turn the wheelset under its loads: slip at the edges, and fatigue.

    The loads are those of the scene's table [service]. Writes service.json, tables along the seat and a figure.
    """
    announce(loading(scene), quiet=quiet)
    from mpi4py import MPI

    comm, target = MPI.COMM_WORLD, folder or Path(f"{Path(scene).stem}-service")
    with ending(comm, target, resumes=not bonded):
        from ..scene import load_scene

        resolved = load_scene(scene, overrides)
        import_mesher_for(resolved)
        from ..service.run import carry_out_service

        lines = carry_out_service(resolved, comm, target, bonded=bonded, quiet=quiet, resume=resume)
        say_lines(lines, quiet=quiet)


def loading(scene: str) -> str:
    """What is said of a scene before anything is loaded for it."""
    return f"Scene           {scene}; loading the solver"


def say_lines(lines: Iterable[str], *, quiet: bool) -> None:
    """Print a summary; of a quiet run its doubts alone, as errors are."""
    from ..base.progress import say
    from ..results.doubts import DOUBTFUL

    for line in lines:
        if not quiet:
            say(line)
        elif line.startswith(DOUBTFUL):
            click.echo(line, err=True)


def import_mesher_for(scene: Scene, rank: int = 0) -> None:
    """Import gmsh on ranks that hold a body which has to be drawn: none that is kept."""
    if rank < 2 and None in (scene.mesh.axle, scene.mesh.wheel):
        from ..bodies.kept import all_kept

        if not all_kept(scene):
            import_mesher()


def import_mesher() -> None:
    """Import gmsh ahead of dolfinx, whose libraries, open to all that come later, slow its own down threefold."""
    interrupt = signal.getsignal(signal.SIGINT)
    import gmsh  # noqa: F401

    signal.signal(signal.SIGINT, interrupt)  # it takes Ctrl-C for itself


@main.command()
def scenes() -> None:
    """List the built-in scenes."""
    from ..scene import load_scene, scene_names

    names = scene_names()
    width = max(len(name) for name in names)
    for name in names:
        click.echo(f"{name:<{width}}  {load_scene(name).title}")


@main.command()
def providers() -> None:
    """List the installed friction providers and where they come from."""
    from ..friction import registry

    for name, source, target in registry.names():
        click.echo(f"{name}  from {source}, {target}")


@main.command()
@click.argument("kind", type=click.Choice(["hub", "wheel", "hollow-axle", "meshes"]), default="hub")
@click.option("-o", "--output", "target", type=FILE, help="The file [KIND.toml].")
def init(kind: str, target: Path | None) -> None:
    """Write a scene to begin with, every key with its meaning, its unit and its default; nothing is overwritten.

    KIND is hub (a plain ring; the default), wheel, hollow-axle, or meshes, which brings two mesh files along.
    """
    if kind == "meshes":
        import_mesher()
    from ..drafts.write import write_draft

    for file in write_draft(kind, target or Path(f"{kind}.toml")):
        click.echo(f"Written         {file}")


@main.command()
@scene_argument
@changes
@click.option(
    "-o", "--output", "target", type=FILE, metavar="DRAWING",
    help="Also draw the section to scale with every key of its shapes on it: .svg, .pdf or .png.",
)  # fmt: skip
def check(scene: str, overrides: tuple[str, ...], target: Path | None) -> None:
    """Decode and check SCENE, its mesh files and its friction provider, and say what it will do."""
    from ..friction import registry
    from ..results.outlook import outlook, tiles_outlook
    from ..scene import idle_keys, load_scene

    resolved = load_scene(scene, overrides)
    for line in idle_keys(resolved):
        complain(f"warning: {line}")
    friction, material = resolved.friction, resolved.axle.material
    build = partial(registry.build_provider, friction.provider, friction.options)
    for line in registry.try_provider(build, material.youngs_modulus, material.poisson_ratio, tiles_outlook(resolved)):
        complain(f"warning: {line}")
    for line in outlook(resolved):
        click.echo(line)
    if target is not None:
        from ..figures.section import write_section

        click.echo(f"Section         {write_section(resolved, target)}")


@main.command()
@click.argument("kind", type=click.Choice(["scene", "standard", "verdict"]), default="scene")
def schema(kind: str) -> None:
    """Print a JSON schema: every key with its meaning, unit and bounds.

    KIND is scene (the default) or standard, for editors, or verdict, for programs that read what `macrofit judge
    --json` prints and summary.json has.
    """
    import msgspec

    if kind == "scene":
        from ..scene import json_schema as of_kind
    elif kind == "standard":
        from ..acceptance import standard_schema as of_kind
    else:
        from ..acceptance import verdict_schema as of_kind
    click.echo(msgspec.json.format(msgspec.json.encode(of_kind()), indent=2).decode())


@main.command()
@click.argument("folders", nargs=-1, required=True, type=FILE, metavar="DIR...")
@click.option(
    "-o", "--output", "target", type=FILE, default=Path("fitting_curves.png"),
    show_default=True, help="The figure.",
)  # fmt: skip
def plot(folders: tuple[Path, ...], target: Path) -> None:
    """Overlay the fitting curves of folders of runs and studies in one figure."""
    from ..figures.curves import compare

    click.echo(compare(folders, target))


@main.command()
@click.argument("folder", type=FILE, metavar="DIR")
@click.option("-o", "--output", "target", type=FILE, metavar="PAGE", help="The page [report.html in DIR].")
@click.option("--pdf", is_flag=True, help="Print it as PDF too, by chromium or weasyprint where one is there.")
@standard_option
@click.option("--wheel", metavar="TYPE", help="Type of wheel in that standard.")
def report(folder: Path, target: Path | None, pdf: bool, standard: str | None, wheel: str | None) -> None:
    """Write one HTML page of a run, a study, or one or many wheelsets in service: a file that needs no network.

    It has the inputs with the section, the curve in its window, the acceptance checks, stresses, pressure and shear
    along the seat, balances and doubts, and what made it; of a wheelset in service its slip, friction work, criteria
    and the verdict on its nominal stress. Nothing is computed anew.
    """
    from ..report import write_report

    for line in write_report(folder, target, pdf=pdf, standard=standard, wheel=wheel):
        click.echo(line)
