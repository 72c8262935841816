"""Tell what `make demo` has computed: three fitting curves, their numbers, and why they differ.

    python demo_page.py FOLDER

FOLDER is a study of `wheelset` with --keep: uniform friction as reference, plates as published, slow plates. Writes
FOLDER/index.html; every number on it is read from the files of the study.
"""

from __future__ import annotations

import csv
import sys
from html import escape
from pathlib import Path
from typing import NamedTuple

PAGE = """<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8"><title>macrofit: three fitting curves</title>
<style>
body {{ font: 16px/1.5 sans-serif; max-width: 60em; margin: 2em auto; padding: 0 1em; color: #222; }}
table {{ border-collapse: collapse; margin: 1em 0; }}
td, th {{ border: 1px solid #ccc; padding: 0.3em 0.7em; text-align: right; }}
td:first-child, th:first-child {{ text-align: left; }}
img {{ max-width: 100%; }}
</style></head><body>
<h1>One wheel, three kinds of friction</h1>
<p>A railway wheel is pressed {travel:g} mm onto its axle. Lalleman et al. (<i>Multi-scale friction coefficient: from
roughness to system computation using deep learning</i>) report that a coefficient of {micro:g} between the spheres of
two rough plates acts in this press-fit like a uniform coefficient of {uniform:g}. Here are both, and a third curve:
the plates that are the default here, slid slowly on stiff faces along one continuous roughness.</p>
<p><img src="fitting_curves.png" alt="Pushing force against displacement, three curves"></p>
<table>
<tr><th></th><th>mean friction at the end</th><th>force at the end [kN]</th><th>against uniform</th>
<th>largest stress of axle, wheel [MPa]</th></tr>
{rows}
</table>
<h2>Why the curves differ</h2>
<p><b>Plates as published</b> stand on beams that bend. They are slid at 10 m/s, near the speed at which they sway in
resonance with the washboard of spheres. The swaying loses energy, and this raises the coefficient from {micro:g}
between the spheres to {published:.3f} between the plates. So the curve comes within {near:.1%} of uniform
{uniform:g}.</p>
<p><b>Slow plates</b> rest on faces as stiff as the solid and do not sway (and have half the roughness, which matters
less). Then little is lost beside the friction
between the spheres themselves: {slow:.3f} instead of {micro:g}. The force is {less:.0%} lower than with uniform
{uniform:g}. A press is slow, so this is the default.</p>
<p><b>The stress hardly changes</b>: at most {stress:.1%} between the three. It comes from the interference and from
the rounded corners that ride over each other at {places} mm.</p>
<p><img src="stress_entrance.png" alt="Von Mises stress at the entrance of the seat, three runs"></p>
<p>{verdict} What of the paper comes out here, number by number: <a href="../docs/paper.md">docs/paper.md</a>.
Everything that was computed: <code>study.csv</code>, <code>curves.csv</code> and the folders <code>runs/0001</code>
to <code>runs/0003</code>.</p>
</body></html>
"""
ROW = (
    "<tr><td>{name}</td><td>{mean:.3f}</td><td>{force:.0f}</td><td>{change:+.1%}</td>"
    "<td>{axle:.0f}, {wheel:.0f}</td></tr>"
)
NAMES = (
    "uniform {uniform:g}",
    "plates as published, {micro:g} between spheres",
    "slow plates, {micro:g} between spheres",
)
UNIFORM, MICRO = 0.11, 0.07
"""Coefficients of the demo [-]."""


class Told(NamedTuple):
    """What the page says of one run."""

    force: float  # kN, at the end
    mean: float  # coefficient of friction at the end [-]
    axle: float  # MPa, largest von Mises stress
    wheel: float
    place: float  # mm, displacement of the wheel's largest stress
    travel: float  # mm
    refused_for: str


def read(folder: Path) -> list[Told]:
    """The runs of the study, in the order of study.csv."""
    told = []
    with (folder / "study.csv").open() as file:
        for row in csv.DictReader(file):
            with (folder / "runs" / f"{int(row['run']):04d}" / "fitting_curve.csv").open() as curve:
                *_, last = csv.DictReader(curve)
            told.append(
                Told(
                    force=float(last["force_N"]) / 1e3,
                    mean=float(last["mean_friction"]),
                    axle=float(row["axle_max_von_mises_MPa"]),
                    wheel=float(row["wheel_max_von_mises_MPa"]),
                    place=float(row["wheel_displacement_mm"]),
                    travel=float(last["displacement_mm"]),
                    refused_for=row["refused_for"],
                )
            )
    return told


def page(runs: list[Told]) -> str:
    """The page of a uniform, a published and a slow run."""
    uniform, published, slow = runs
    known = {"uniform": UNIFORM, "micro": MICRO}
    rows = [
        ROW.format(name=escape(name.format(**known)), change=run.force / uniform.force - 1.0, **run._asdict())
        for name, run in zip(NAMES, runs, strict=True)
    ]
    stresses = [[run.axle for run in runs], [run.wheel for run in runs]]
    verdict = ""
    if uniform.refused_for:
        why = " and ".join(word.replace("_", " ") for word in uniform.refused_for.split())
        verdict = (
            f"EN 13260 would refuse this fit for its {why}: the paper's interference is larger than workshops take. "
            "The scene <code>wheelset-en</code> has a usual one."
        )
    return PAGE.format(
        rows="\n".join(rows),
        travel=uniform.travel,
        published=published.mean,
        slow=slow.mean,
        near=abs(published.force / uniform.force - 1.0),
        less=1.0 - slow.force / uniform.force,
        stress=max(max(each) / min(each) - 1.0 for each in stresses),
        places=" and ".join(dict.fromkeys(f"{run.place:g}" for run in runs)),
        verdict=verdict,
        **known,
    )


def main(folder: Path) -> None:
    """Write the page."""
    (folder / "index.html").write_text(page(read(folder)))
    print(f"Open {folder / 'index.html'}: what the three curves say, and why they differ")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
