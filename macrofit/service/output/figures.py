"""The figure of a service computation: bending, slip, pressure at an edge, criteria."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ...base.figure import BLACK, BLUE, GREEN, ORANGE, VERMILION, blank, placed, plain, save, sheet
from ..history import in_contact
from ..seat_stress import MM

if TYPE_CHECKING:
    from ..run import Service, Turned


def write_figure(target: Path, found: Service) -> Path:
    """Draw a service computation: the bonded bending stress alone, or with slip, an edge and the criteria.

    Raises:
        OutputError: the file cannot be written.
    """
    turned = found.turned
    if turned is None:
        figure, axes = sheet(7.0, 4.0)
        _bending(axes[0], found)
    else:
        figure = blank(11.0, 7.2)
        bending, slip, criteria, edge = (
            plain(placed(figure, left, bottom, width, 2.7))
            for left, bottom, width in ((0.8, 3.9, 4.4), (6.0, 3.9, 4.8), (0.8, 0.7, 4.4), (6.0, 0.7, 4.4))
        )
        _bending(bending, found)
        _slip(figure, slip, found, turned)
        _criteria(criteria, turned)
        _edge(edge, found, turned)
    if found.whole.scene.title:
        figure.suptitle(found.whole.scene.title, fontsize=10)
    return save(figure, target)


def _bending(axes: Any, found: Service) -> None:
    bonded = found.bonded
    axes.plot(bonded.z, bonded.bending, color=BLUE, lw=1.4, label="bonded fit")
    axes.plot(bonded.z, bonded.nominal, color="0.45", lw=1.0, ls=(0, (4, 3)), label="nominal")
    if found.turned is not None:
        stress = found.turned.endurance.stress[:, :, MM]
        amplitude = 0.5 * np.ptp(stress, axis=1)
        axes.plot(bonded.z, amplitude, color=VERMILION, lw=1.4, label="with friction")
    axes.set_ylim(bottom=0.0)
    axes.set_xlabel("z along the axle [mm]")
    axes.set_ylabel("amplitude of axial stress [MPa]")
    axes.legend(frameon=False, fontsize=9)


def _slip(figure: Any, axes: Any, found: Service, turned: Turned) -> None:
    """Axial slip at the angle 0 over a revolution, counted from its mean; white where the fit is open."""
    moments = turned.revolutions[-1].moments
    slip = 1e3 * np.stack([each.slip[0, 1] for each in moments])
    closed = in_contact(np.stack([each.traction for each in moments]))[:, 0]
    shown = np.where(closed, slip - slip[1:].mean(axis=0), np.nan)
    angles = np.linspace(0.0, 360.0, len(moments))
    largest = float(np.nanmax(np.abs(shown), initial=1e-9))
    z, colours = found.whole.fit.z, {"cmap": "RdBu_r", "vmin": -largest, "vmax": largest}
    mesh = axes.pcolormesh(z, angles, shown, shading="nearest", **colours)
    bar = figure.colorbar(mesh, ax=axes, pad=0.02)
    bar.set_label("axial slip from its mean [um]", fontsize=9)
    axes.set_xlim(found.bonded.z[0], found.bonded.z[-1])
    axes.set_xlabel("z along the axle [mm]")
    axes.set_ylabel("angle of the loads [deg]")
    axes.grid(visible=False)


def _edge(axes: Any, found: Service, turned: Turned) -> None:
    """A revolution at the place with the most friction work."""
    k = int(np.argmax(turned.fretting.work))
    moments = turned.revolutions[-1].moments
    angle = np.linspace(0.0, 360.0, len(moments))
    friction = turned.friction[k]
    axes.plot(angle, [friction * -each.traction[0, 0, k] for each in moments], color=BLACK, lw=1.0, label="mu p")
    axes.plot(angle, [each.traction[0, 1, k] for each in moments], color=BLUE, lw=1.4, label="shear along")
    axes.plot(angle, [each.traction[0, 2, k] for each in moments], color=GREEN, lw=1.4, label="shear around")
    axes.set_xlabel(f"angle of the loads at z = {found.whole.fit.z[k]:.1f} mm [deg]")
    axes.set_ylabel("traction [MPa]")
    axes.legend(frameon=False, fontsize=9)


def _criteria(axes: Any, turned: Turned) -> None:
    found = turned.endurance
    for name, values, colour in (
        ("Crossland", found.criteria.crossland, BLUE),
        ("Dang Van", found.criteria.dang_van, VERMILION),
        ("Findley", found.criteria.findley, ORANGE),
    ):
        axes.plot(found.z, values, color=colour, lw=1.3, label=name)
    axes.axhline(1.0, color="0.45", lw=0.9, ls=(0, (4, 3)))
    axes.set_ylim(bottom=0.0)
    axes.set_xlabel("z along the axle [mm]")
    axes.set_ylabel("share of the limit [-]")
    axes.legend(frameon=False, fontsize=9)
