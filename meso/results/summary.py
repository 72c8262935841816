"""What a friction test says in numbers and in words."""

from __future__ import annotations

import platform
import sys
from collections.abc import Sequence
from dataclasses import asdict
from importlib import metadata
from typing import Any, NamedTuple

import msgspec
import numpy as np

from macrofit.base.toml import dump_toml

from ..friction_test import FrictionTest, engine_name
from ..lattice.lattice import Lattice
from ..lattice.modulus import own_modulus
from ..material import Beams, Material
from ..measured.clean import lay
from ..measured.keys import ScanKeys
from ..packing.pack import Packing
from ..plates import Plates
from ..records import UNBALANCED, Slide
from ..settings import SHARED, Settings
from ..surfaces.filtered import CUTOFF, SECTIONS, filtered, measured_length, profile
from ..surfaces.measured import as_surface, place_doubts, scan_of
from ..surfaces.origin import roughness_numbers, scan_numbers, with_units
from ..surfaces.roughness import Roughness, measure
from ..surfaces.surface import Body, Surface

PAPER = "Lalleman et al. report about 0.11 for micro 0.07"
"""What the paper says of the one micro coefficient it names."""
IN_EQUILIBRIUM = "; slid slowly, pairs of this model give 1.02 to 1.05 times the micro coefficient in the mean"
SWAYING = ", and so does the preset as-published: its plates sway near their resonance, which adds to the friction"

WEAK_LAY = 0.2
"""A lay that is weaker is called none [-]."""


class Affine(NamedTuple):
    """mu_meso = a mu_micro + b, by least squares over the slides."""

    a: float
    b: float
    largest_residual: float


def affine(slides: Sequence[Slide]) -> Affine | None:
    """The affine fit, or None for fewer than two micro coefficients or where contact was lost for good."""
    micro, meso = np.array([(each.micro_friction, each.curve.coefficient) for each in slides]).T
    if len(set(micro)) < 2 or not np.isfinite(meso).all():
        return None
    terms = np.stack([micro, np.ones_like(micro)], axis=1)
    (a, b), *_ = np.linalg.lstsq(terms, meso, rcond=None)
    return Affine(float(a), float(b), float(np.abs(terms @ [a, b] - meso).max()))


def summary(test: FrictionTest, run_cpu_s: float) -> dict[str, Any]:
    """The numbers of summary.json, keys with their units; without slides there is none.

    What belongs to a slide is that of the first micro coefficient, and `slides` holds them all. A number that does
    not exist is None. `run_cpu_s` is the CPU time of everything after the plates: `setup_cpu_s` is part of it.
    """
    plates, fit = test.plates, affine(test.slides)
    bodies = plates.bodies
    return {
        "title": test.settings.title,
        **slide_numbers(test.slides[0]),
        "spheres": plates.lattice.nodes,
        "bonds": len(plates.lattice.cols),
        "packing_cpu_s": test.packing_cpu_s,
        "setup_cpu_s": test.setup_cpu_s,
        "run_cpu_s": run_cpu_s,
        "slides": [slide_numbers(each) for each in test.slides],
        "affine_fit": None if fit is None else fit._asdict(),
        "packing": {body: packing_numbers(plate[0]) | modulus_numbers(*plate) for body, plate in bodies.items()},
        "roughness": {body: body_roughness(test.settings, body, packing) for body, (packing, _) in bodies.items()},
        "resonance": resonance_numbers(plates) if sways(plates) else None,
        "beams": msgspec.to_builtins(plates.beams),
        "fingerprint": test.settings.fingerprint,
        "versions": versions(),
    }


def slide_numbers(slide: Slide) -> dict[str, Any]:
    """What a summary says about one slide."""
    curve, work = slide.curve, slide.work
    explicit = slide.bond_steps > 0 and slide.cpu_s > 0.0
    account = {f"{name}_N_mm": value for name, value in msgspec.to_builtins(work).items()}
    return {
        "micro_friction": slide.micro_friction,
        "meso_friction": curve.coefficient,
        "meso_friction_mean_of_ratio": curve.mean_of_ratio,
        "meso_friction_resultant": curve.resultant,
        "uncertainty": curve.uncertainty,
        "engine": slide.engine,
        "steps": slide.steps,
        "bond_steps_per_s": slide.bond_steps / slide.cpu_s if explicit else None,
        "unconverged_increments": slide.unconverged_increments,
        "largest_residual": slide.largest_residual,
        "mean_normal_force_N": curve.mean_normal,
        "mean_tangential_force_N": curve.mean_tangential,
        "approach_mm": float(slide.squeeze.displacement[-1]),
        "work": account | {"imbalance": work.imbalance},
        "broken_beams": 0 if slide.breaks is None else len(slide.breaks.time),
        "slide_cpu_s": slide.cpu_s,
        "remark": slide.remark or None,
    }


def packing_numbers(packing: Packing) -> dict[str, Any]:
    """Measures of a packed plate."""
    mean, deviation = packing.envelope_error()
    return {
        "spheres": len(packing.radii),
        "bonds": len(packing.contacts),
        "mean_radius_mm": float(packing.radii.mean()),
        "solid_fraction": packing.solid_fraction,
        "coordination": packing.coordination,
        "largest_overlap": packing.largest_overlap,
        "envelope_mean_error_mm": mean,
        "envelope_error_sd_mm": deviation,
    }


def modulus_numbers(packing: Packing, lattice: Lattice) -> dict[str, float]:
    """Young's modulus of a plate as it slides, and with its beams as they were before they were scaled."""
    modulus = own_modulus(packing, lattice) if lattice.modulus is None else lattice.modulus
    return {
        "youngs_modulus_MPa": modulus,
        "youngs_modulus_before_MPa": modulus / lattice.scaling,
        "scaling": lattice.scaling,
    }


def sways(plates: Plates) -> bool:
    """Whether the sway of the plates matters: they are slid at a speed, or on faces softer than the solid."""
    return engine_name(plates.settings) == "explicit" or plates.settings.plates.external_face == "beams"


def resonance_numbers(plates: Plates) -> dict[str, float]:
    """The sway resonance, and the speed beside it where the explicit engine slides."""
    wheel, axle = plates.sway
    explicit = engine_name(plates.settings) == "explicit"
    return {
        "wheel_sway_Hz": wheel,
        "axle_sway_Hz": axle,
        "mean_diameter_mm": 2.0 * float(plates.lattice.radii.mean()),
        "f_d_mm_s": plates.resonance,
        "speed_mm_s": plates.speed if explicit else 0.0,
        "speed_over_f_d": plates.speed / plates.resonance if explicit else 0.0,
    }


def resonance_line(plates: Plates) -> str:
    """The sway resonance for people."""
    found = resonance_numbers(plates)
    line = (
        f"f d {1e-3 * found['f_d_mm_s']:.3g} m/s (wheel {1e-3 * found['wheel_sway_Hz']:.0f} kHz, axle "
        f"{1e-3 * found['axle_sway_Hz']:.0f} kHz, d {1e3 * found['mean_diameter_mm']:.0f} µm)"
    )
    if not found["speed_mm_s"]:
        return line
    return f"{line}, slid at {1e-3 * found['speed_mm_s']:.3g} m/s, {found['speed_over_f_d']:.2g} f d"


def body_roughness(settings: Settings, body: Body, packing: Packing) -> dict[str, Any]:
    """Measures of a body's face as it was asked for, of profiles along its strip, and of its spheres' envelope."""
    keys, face = settings.surface, packing.surface
    seed = keys.wheel_seed if body == "wheel" else keys.axle_seed
    along = with_units(asdict(profile(measured_length(keys, body, seed, face))))
    envelope = roughness_numbers(packing.inner_envelope)
    found = roughness_numbers(face) | {"profile": along | {"cutoff_mm": CUTOFF}, "envelope": envelope}
    scan = keys.measured(body)
    if scan is None:
        return found
    doubts = (*place_doubts(scan, seed, face.size), *([SHARED] if body == "wheel" and keys.shared_files() else ()))
    return found | {"measured": scan_numbers(scan, doubts)}


def scan_lines(keys: ScanKeys) -> list[str]:
    """What the files of a measured face hold, and what was done with them, for people."""
    lines = []
    for which, name in enumerate(keys.files):
        scan = scan_of(keys, which)
        (nx, ny), (length, width), (dx, dy) = scan.heights.shape, scan.size, scan.spacing
        angle, strength = lay(scan)
        lines.append(
            f"File            {name}: {length:.4g} x {width:.4g} mm, {nx} x {ny} points {1e3 * dx:.3g} x "
            f"{1e3 * dy:.3g} µm apart"
        )
        lines += [f"Done            {line}" for line in scan.done]
        lines.append(f"Scan            {roughness_line(as_surface(scan))}")
        told = f"at {angle:.0f}° to the slide, strength {strength:.2f} of 1" if strength > WEAK_LAY else "none"
        lines.append(f"Lay             {told}")
        lines += [f"Doubt           {line}" for line in scan.doubts]
    return lines


def versions() -> dict[str, str]:
    """Versions of what computes; nothing is imported for it, and what is not installed is left out."""
    found = {"python": platform.python_version()}
    for name in ("macrofit", "numpy", "scipy", "numba"):
        version = getattr(sys.modules.get(name), "__version__", None)
        try:
            found[name] = version or metadata.version(name)
        except metadata.PackageNotFoundError:
            continue
    return found


def settings_of(material: Material, beams: Beams) -> str:
    """TOML of a run with these beams."""
    tables = {"material": msgspec.to_builtins(material), "beams": msgspec.to_builtins(beams)}
    return f"# Beams found by macrofit-meso calibrate. mm, N, MPa, t, s.\n\n{dump_toml(tables)}"


def slide_line(slide: Slide) -> str:
    """One slide on one line, for the progress."""
    curve = slide.curve
    line = f"Micro {slide.micro_friction:<8g}meso {curve.coefficient:.4f} ± {curve.uncertainty:.4f}, {slide.engine}"
    return f"{line}, {slide.steps} {'steps' if slide.bond_steps else 'increments'}"


def plates_line(plates: Plates) -> str:
    """The plates on one line, for the progress."""
    lattice = plates.lattice
    moduli = ", ".join(f"{body} {modulus_line(*plate)}" for body, plate in plates.bodies.items())
    resonance = f"; {resonance_line(plates)}" if sways(plates) else ""
    return f"Plates        {lattice.nodes} spheres, {len(lattice.cols)} beams; {moduli}{resonance}"


def modulus_line(packing: Packing, lattice: Lattice) -> str:
    """The modulus of a plate for people, before its beams were scaled and after."""
    found = modulus_numbers(packing, lattice)
    before, after = (1e-3 * found[f"youngs_modulus_{which}MPa"] for which in ("before_", ""))
    return f"{after:.0f} GPa" if lattice.scaling == 1.0 else f"{before:.0f} GPa, scaled to {after:.0f} GPa"


def sentences(numbers: dict[str, Any]) -> list[str]:
    """A summary in a few lines for people."""
    lines = [_verdict(each) for each in numbers["slides"]]
    lines += [_resultant(each) for each in numbers["slides"] if np.isfinite(each["meso_friction_resultant"])]
    if any(np.isfinite(each["uncertainty"]) for each in numbers["slides"]):
        lines.append("Uncertainty     ± is the standard error along the slide, by which surfaces of this kind scatter")
    lines += [_roughness(body, numbers["roughness"][body]) for body in ("wheel", "axle")]
    for scan in (scan for body in ("wheel", "axle") for scan in numbers["roughness"][body].get("measured", [])):
        lines.append(f"Measured        {scan['file']}: {'; '.join(scan['done'])}")
        lines += [f"Doubt           {scan['file']}: {doubt}" for doubt in scan["doubts"]]
    fit = numbers["affine_fit"]
    if fit is not None:
        line = f"Affine fit      meso = {fit['a']:.4f} micro {fit['b']:+.4f}"
        off = f", off by {fit['largest_residual']:.1g} at most" if len(numbers["slides"]) > 2 else ""
        lines.append(line + off)
    if any(each["micro_friction"] == 0.07 and not each["broken_beams"] for each in numbers["slides"]):
        lines.append(f"Compare         {PAPER}{SWAYING if numbers['resonance'] else IN_EQUILIBRIUM}")
    for each in numbers["slides"]:
        if each["broken_beams"]:
            lines.append(f"Broken beams    micro {each['micro_friction']:g}: {each['broken_beams']}")
        rest = abs(each["work"]["imbalance"])
        if rest > UNBALANCED:
            lines.append(
                f"Balance         micro {each['micro_friction']:g}: {rest:.0%} of the work is unaccounted for: take a "
                "smaller engine.increment or another engine, and do not rely on it"
            )
        if each["remark"]:
            lines.append(f"Doubt           micro {each['micro_friction']:g}: {each['remark']}")
    engines = " and ".join(dict.fromkeys(each["engine"] for each in numbers["slides"]))
    lines.append(
        f"Engine          {engines}; {numbers['packing_cpu_s']:.2f} s of CPU for the plates, "
        f"{numbers['run_cpu_s']:.2f} s for the rest"
    )
    return lines


def _resultant(each: dict[str, Any]) -> str:
    return (
        f"Resultant       {each['meso_friction_resultant']:.4f} for micro {each['micro_friction']:g}: mean of "
        "sqrt(Tx² + Ty²) over mean N, another reading"
    )


def _roughness(body: str, found: dict[str, Any]) -> str:
    tops = found["envelope"]
    sq, behind, spheres, sharp = (1e3 * each["Sq_mm"] for each in (found, found["filtered"], tops, tops["filtered"]))
    return (
        f"Roughness       {body}: Ra {1e3 * found['profile']['Ra_mm']:.2g} µm; Sq {sq:.2g} µm, {behind:.2g} behind the "
        f"filter of {CUTOFF:g} mm; envelope of its spheres {spheres:.2g} and {sharp:.2g} µm"
    )


def _verdict(each: dict[str, Any]) -> str:
    micro = f"{each['micro_friction']:g}"
    if not np.isfinite(each["meso_friction"]):
        return f"Meso friction   none for micro {micro}: the plates do not touch while they slide, squeeze them more"
    return (
        f"Meso friction   {each['meso_friction']:.4f} ± {each['uncertainty']:.4f} for micro {micro}: "
        f"mean T {each['mean_tangential_force_N']:.4g} N over mean N {each['mean_normal_force_N']:.4g} N"
    )


def roughness_line(surface: Surface) -> str:
    """Measures of a rough face for people, on one line."""
    r: Roughness = measure(surface)
    hurst = _hurst(r.hurst_exponent)
    heights = ", ".join(f"{name} {1e3 * getattr(r, name):.3g} µm" for name in ("Sa", "Sq", "Sz"))
    return f"{heights}, Sdq {r.Sdq:.3g}, Hurst exponent {hurst}"


def _hurst(exponent: float) -> str:
    """The exponent in words where it is none: grooves and noise have no slope of a self-affine surface."""
    if not np.isfinite(exponent):
        return "not known on so few points"
    return f"{exponent:.2f}" if 0.0 <= exponent <= 1.0 else "none (not self-affine)"


def filtered_line(surface: Surface) -> str:
    """Measures of a rough face behind the filter for people, on one line."""
    r = measure(filtered(surface), level=False)
    heights = ", ".join(f"{name} {1e3 * getattr(r, name):.3g} µm" for name in ("Sa", "Sq", "Sz"))
    long = min(surface.size) / CUTOFF
    short = f"; the face is {long:.2g} cut-offs wide, the standard asks for {SECTIONS}" if long < SECTIONS else ""
    return f"{heights}, Sdq {r.Sdq:.3g}, without waves above {CUTOFF:g} mm (ISO 16610-61){short}"


def profile_line(settings: Settings, body: Body, face: Surface) -> str:
    """Ra, Rq and Rz for people, on one line: of the strip, or of what there is of a tile."""
    keys = settings.surface
    seed = keys.wheel_seed if body == "wheel" else keys.axle_seed
    found = profile(measured_length(keys, body, seed, face))
    where = "of the strip" if keys.form == "strip" and keys.measured(body) is None else "of this face alone"
    return (
        f"Ra {1e3 * found.Ra:.3g} µm, Rq {1e3 * found.Rq:.3g} µm, Rz {1e3 * found.Rz:.3g} µm on "
        f"{found.evaluation:.3g} mm {where} along the slide, cut-off {CUTOFF:g} mm (ISO 21920, ISO 4287)"
    )


def packing_line(packing: Packing) -> str:
    """Measures of a packed plate for people, on one line."""
    numbers = packing_numbers(packing)
    return (
        f"{numbers['spheres']} spheres of {1e3 * numbers['mean_radius_mm']:.1f} µm in mean radius, "
        f"{numbers['bonds']} beams, solid fraction {numbers['solid_fraction']:.3f}, coordination "
        f"{numbers['coordination']:.2f}, largest overlap {numbers['largest_overlap']:.1%}"
    )
