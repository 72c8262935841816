"""The command `macrofit-meso`. What is heavy is imported inside the commands, so that help comes at once."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import click

from macrofit.base.commands import FILE, INTERRUPTED, SETTINGS, Commands, complain, few_threads, set_option
from macrofit.base.errors import OutputError
from macrofit.base.files import keep_inputs
from macrofit.base.progress import announce, is_first_rank
from macrofit.base.steel import POISSON_RATIO, YOUNGS_MODULUS

from .measured.options import asked_scan, refuse_idle_seed, scan_options, take_options
from .presets import DEFAULT, PRESETS, presets_line

if TYPE_CHECKING:
    from click.shell_completion import CompletionItem

    from .measured.keys import ScanKeys
    from .settings import Settings
    from .surfaces.surface import Body

RADIUS_RATIOS = (0.2, 0.25, 0.3, 0.35, 0.4, 0.5, 0.6, 0.7)
"""Radius ratios in the figures of a calibration [-]."""
MODULI = (0.5, 1.0, 1.5, 2.0)
"""Moduli of the beams in the figures of a calibration, over the modulus found [-]."""
LOADING = "Plates          loading their engines"
"""What is said before anything heavy is loaded."""
LIGHT_CUBE = 1000
"""Spheres, at most, in the cube that is pulled for these figures: 32 pairs of parameters take some seconds."""


@click.group("macrofit-meso", cls=Commands, context_settings=SETTINGS)
@click.version_option(package_name="macrofit", prog_name="macrofit-meso")
def main() -> None:
    """Rough plates of spheres and beams, squeezed and slid over each other: the friction their roughness gives.

    SETTINGS is a TOML file; without it every key has its default. Lengths are in mm, forces in N, moduli in MPa.
    """
    if not is_first_rank():  # nothing here is divided among ranks: under mpirun the first one does it all
        click.get_current_context().exit()
    few_threads()


def completes_key(context: click.Context, parameter: click.Parameter, incomplete: str) -> list[CompletionItem]:
    """Keys of the plates' settings and their values, for a shell."""
    from macrofit.base.completion import keys_and_values
    from macrofit.base.keys import dotted_keys

    from .settings import Settings

    return keys_and_values(dotted_keys(Settings), incomplete)


settings_argument = click.argument("settings", required=False, type=FILE)
set_settings = set_option("the settings", completes_key)
preset_option = click.option(
    "--preset", type=click.Choice(list(PRESETS)), default=DEFAULT, show_default=True,
    help=f"What neither SETTINGS nor --set says. {presets_line()}.",
)  # fmt: skip


def numbers(context: click.Context, option: click.Parameter, text: str | None) -> tuple[float, ...]:
    """Numbers between commas; none where nothing is given."""
    try:
        return tuple(float(part) for part in text.split(",")) if text is not None else ()
    except ValueError:
        raise click.BadParameter(f"'{text}' is not a number, or numbers between commas") from None


@main.command()
@settings_argument
@click.option(
    "-o", "--output", "folder", type=FILE, default=Path("meso-run"), show_default=True, help="Folder of the results."
)
@set_settings
@preset_option
@click.option("--engine", type=click.Choice(["auto", "quasi-static", "explicit"]), help="Instead of the settings'.")
@click.option("--micro-friction", callback=numbers, metavar="MU[,MU...]", help="Instead of the settings'.")
@click.option("--no-figures", is_flag=True, help="Write data only.")
@click.option("--quiet", is_flag=True, help="Say nothing but errors.")
def run(
    settings: Path | None,
    folder: Path,
    overrides: tuple[str, ...],
    preset: str,
    engine: str | None,
    micro_friction: tuple[float, ...],
    no_figures: bool,
    quiet: bool,
) -> None:
    """Squeeze two rough plates, slide them, and write their coefficient of friction, curves and figures.

    A folder with results of a run is replaced. A folder with anything else in it is refused.
    """
    announce(LOADING, quiet=quiet)
    more = [f"engine.name={engine}"] if engine else []
    if micro_friction:
        more.append(f"contact.micro_friction={list(micro_friction)}")
    resolved = _load(settings, (*overrides, *more), preset)
    try:
        from .monitor import on_screen
        from .run import carry_out

        lines = carry_out(resolved, folder, on_screen(quiet=quiet), figures=not no_figures)
    except KeyboardInterrupt:
        complain(f"interrupted; the slides that were done are in {folder}")
        click.get_current_context().exit(INTERRUPTED)
    for line in [] if quiet else lines:
        click.echo(line)


@main.command()
@click.option(
    "-o", "--output", "targets", multiple=True, type=FILE, metavar="FILE",
    help="Figure (.png), heights (.npy, .csv) or hull of the plate (.stl, .vtk, .vtu, .ply); several may be given.",
)  # fmt: skip
@click.option("--body", type=click.Choice(["wheel", "axle"]), default="wheel", show_default=True, help="Whose face.")
@click.option(
    "--file", "files", multiple=True, type=FILE, metavar="FILE",
    help="Measured face in place of a generated one (.npy, .csv, .xyz, .sdf, .sur, .x3p, .al3d ...); several: patches.",
)  # fmt: skip
@scan_options
@click.option("--levels", type=int, help="Subdivisions: 2^n + 1 points along 1 mm.")
@click.option("--max-height", type=float, help="Range R of the random heights of Diamond-Square [mm].")
@click.option("--rms-height", type=float, help="Sq of the self-affine generator [mm].")
@click.option("--hurst-exponent", type=float, help="From 0 (rough) to 1 (smooth).")
@click.option("--form", type=click.Choice(["strip", "tiles", "levelled"]), help="A piece of a strip, or a tile.")
@click.option("--lay", type=click.Choice(["isotropic", "turned", "ground"]), help="Of grooves or scratches.")
@click.option("--seed", type=int, help="Of the random heights; of a strip, 65536 times its number plus the place.")
@click.option("--generator", type=click.Choice(["diamond_square", "self_affine"]), help="How the heights are made.")
@set_settings
@preset_option
def surface(
    targets: tuple[Path, ...],
    body: Literal["wheel", "axle"],
    files: tuple[Path, ...],
    seed: int | None,
    overrides: tuple[str, ...],
    preset: str,
    **given: Any,
) -> None:
    """Make the rough face of a body, or read it from a file, print its roughness, and write it in the forms asked for.

    What is not given is as in a run without settings: the face is the very one of its plate.
    """
    from .results.folder import check_surface_file, write_surface
    from .results.summary import filtered_line, profile_line, roughness_line
    from .surfaces.face import rough_face

    for target in targets:
        check_surface_file(target)
    keep_inputs(targets, files)
    scan = take_options(given, "--file", bool(files), not files)
    if len(files) > 1 and scan["use"] == "face":
        scan["use"] = "patches"
    keys = asked_scan(files, scan) if files else None
    if keys is not None:
        refuse_idle_seed(keys, "--seed", seed)
    if seed is not None:
        given[f"{body}_seed"] = seed
    more = [f"surface.{key}={value}" for key, value in given.items() if value is not None]
    resolved = _load(None, (*overrides, *more), preset)
    edge, slide = resolved.plates.edge, resolved.load.slide
    size = (edge, edge) if body == "wheel" else (edge + slide, edge)
    if keys is not None:
        resolved = _with_files(resolved, body, keys, size)
    face = rough_face(resolved.surface, body, getattr(resolved.surface, f"{body}_seed"), size)
    nx, ny = face.shape
    click.echo(f"Surface         of the {body}, {face.size[0]:g} x {face.size[1]:g} mm, {nx} x {ny} points")
    click.echo(f"Roughness       {roughness_line(face)}")
    click.echo(f"Filtered        {filtered_line(face)}")
    click.echo(f"Profile         {profile_line(resolved, body, face)}")
    for target in targets:
        if target.suffix.lower() == ".png":
            from macrofit.base.figure import save

            from .figures.plates import surface as surface_map

            save(surface_map(face, f"Rough face of the {body}"), target)
        else:
            write_surface(target, face, resolved.plates.thickness)
        click.echo(f"File            {target}")


@main.command()
@settings_argument
@click.option(
    "-o", "--output", "targets", multiple=True, type=FILE, metavar="FILE", default=("plates.vtu", "plates.png"),
    show_default=True, help="Spheres and beams (.vtu, .vtk) or their picture (.png); several may be given.",
)  # fmt: skip
@set_settings
@preset_option
def sample(settings: Path | None, targets: tuple[Path, ...], overrides: tuple[str, ...], preset: str) -> None:
    """Pack the two plates of the settings, print their measures, and write them for a look."""
    for target in targets:
        if target.suffix.lower() not in (".vtu", ".vtk", ".png"):
            raise OutputError(f"{target}: spheres are written as .vtu or .vtk, their picture as .png")
    announce(LOADING, quiet=False)
    resolved = _load(settings, overrides, preset)
    from .plates import make_plates
    from .results.folder import write_spheres
    from .results.summary import modulus_line, packing_line, resonance_line, roughness_line

    plates = make_plates(resolved)
    for body, (packing, lattice) in plates.bodies.items():
        mean, deviation = packing.envelope_error()
        click.echo(f"{body.capitalize():<16}{packing_line(packing)}")
        click.echo(f"                modulus: {modulus_line(packing, lattice)}")
        click.echo(f"                surface: {roughness_line(packing.surface)}")
        click.echo(f"                its spheres less the surface: {1e3 * mean:.1f} ± {1e3 * deviation:.1f} µm")
        click.echo(f"                their envelope: {roughness_line(packing.inner_envelope)}")
    click.echo(f"Resonance       {resonance_line(plates)}")
    for target in targets:
        if target.suffix.lower() == ".png":
            from macrofit.base.figure import save

            from .figures.plates import plates_seen

            save(plates_seen(plates), target)
        else:
            write_spheres(target, plates)
        click.echo(f"File            {target}")


@main.command()
@click.option("--poisson-ratio", type=float, default=POISSON_RATIO, show_default=True, help="Of the material.")
@click.option("--youngs-modulus", type=float, default=YOUNGS_MODULUS, show_default=True, help="Of the material [MPa].")
@click.option("--spheres", type=click.IntRange(100), default=2000, show_default=True, help="In each packing.")
@click.option("--packings", type=click.IntRange(1), default=10, show_default=True, help="Number of them.")
@click.option("--seed", type=click.IntRange(0), default=0, show_default=True, help="Of the packings.")
@click.option(
    "-o", "--output", "folder", type=FILE, default=Path("meso-calibration"), show_default=True,
    help="Folder of calibration.toml, the figures, and beams.toml, which are SETTINGS of a run.",
)  # fmt: skip
@click.option("--no-figures", is_flag=True, help="Find the beams only.")
def calibrate(
    poisson_ratio: float,
    youngs_modulus: float,
    spheres: int,
    packings: int,
    seed: int,
    folder: Path,
    no_figures: bool,
) -> None:
    """Find the beams that make a packing as stiff as a material, and show what they do to it.

    Tensile tests on packed cubes of 1 mm give the radius ratio of the beams from the Poisson ratio, then their modulus
    from Young's modulus.
    """
    announce(LOADING, quiet=False)
    from macrofit.base.files import write_text

    from .calibrate import calibrate as find
    from .calibrate import influence
    from .calibrate import sample as draw_boxes
    from .material import Material
    from .results.summary import settings_of

    material = Material(youngs_modulus=youngs_modulus, poisson_ratio=poisson_ratio)
    started = time.perf_counter()
    click.echo(
        f"Pulling         {packings} cubes of {spheres} spheres, about {1 + 3e-3 * packings * spheres:.0f} s ..."
    )
    found = find(material, spheres=spheres, packings=packings, seed=seed)
    found.write(folder / "calibration.toml")
    beams = found.beams(youngs_modulus)
    write_text(folder / "beams.toml", settings_of(material, beams))
    elapsed = time.perf_counter() - started
    click.echo(f"Radius ratio    {beams.radius_ratio:.4f} for a Poisson ratio of {poisson_ratio:g}  ({elapsed:.1f} s)")
    click.echo(
        f"Beams           {beams.youngs_modulus / 1e3:.4g} GPa for {youngs_modulus / 1e3:.4g} GPa, "
        f"{found.stiffening:.2f} times the material's modulus"
    )
    click.echo(
        f"Scatter         {found.modulus_scatter:.1%} of the modulus, {found.poisson_scatter:.4f} in the Poisson ratio,"
        f" from packing to packing (standard deviations{'' if packings > 1 else '; one packing has none'})"
    )
    if not no_figures:
        from macrofit.base.figure import save

        from .figures.plates import influence_modulus, influence_radius

        started = time.perf_counter()
        (cube,) = draw_boxes("influence", seed, spheres=min(spheres, LIGHT_CUBE), packings=1)
        points = influence(
            cube, radius_ratios=RADIUS_RATIOS, youngs_moduli=[part * beams.youngs_modulus for part in MODULI]
        )
        title = f"A cube of {len(cube.radii)} spheres"
        for name, drawn in (("radius", influence_radius), ("modulus", influence_modulus)):
            save(drawn(points, title), folder / f"influence_{name}.png")
        click.echo(f"Influence       {len(points)} pairs of beams  ({time.perf_counter() - started:.1f} s)")
    click.echo(f"Files           {folder}")


def _with_files(settings: Settings, body: Body, keys: ScanKeys, size: tuple[float, float]) -> Settings:
    """The settings with a measured face of a body, once it is shown what its files hold."""
    from msgspec.structs import replace

    from .results.summary import scan_lines
    from .surfaces.measured import covering, pieces_of, place_doubts

    keys, doubts = covering(keys, size) if keys.use == "face" else (keys, ())
    surface = replace(settings.surface, **{"axle" if body == "axle" else "bore": keys}).found()
    for line in scan_lines(keys):
        click.echo(line)
    seed = getattr(surface, f"{body}_seed")
    for piece in pieces_of(keys, body, seed, size):
        click.echo(f"Piece           {piece}")
    for doubt in (*doubts, *place_doubts(keys, seed, size)):
        click.echo(f"Doubt           {doubt}")
    return replace(settings, surface=surface)


def _load(source: Path | None, overrides: tuple[str, ...], preset: str) -> Settings:
    from .settings import load

    return load(source, overrides, preset)
