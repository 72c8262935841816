"""The surface of the seat in space and the histories of a service computation."""

from __future__ import annotations

from pathlib import Path

import h5py
import meshio
import numpy as np
import pytest
from serving import SHORT, read_table

from macrofit.scene import load_scene
from macrofit.service import output
from macrofit.service.output.surface import surface_values
from macrofit.service.output.write import write_service
from macrofit.service.run import Service, serve
from macrofit.service.seat_stress import MM, MT


@pytest.fixture(scope="module")
def found() -> Service:
    # a torque besides, so that what turns one way differs from what turns the other
    return serve(load_scene("wheelset", [*SHORT, "service.torque=3e6", "service.steps=15", "service.harmonics=2"]))


@pytest.fixture(scope="module")
def folder(found: Service, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("service")
    write_service(folder, found)
    return folder


def test_surface_is_the_seat_all_around(found: Service, folder: Path) -> None:
    mesh, line = meshio.read(folder / output.SURFACE), found.whole.fit.lines[0]
    cells = mesh.cells_dict["quad"]
    assert len(cells) == 15 * line.facets
    corners = mesh.points[cells]
    across = np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
    middle = corners.mean(axis=1)
    assert (np.einsum("ci,ci->c", across[:, :2], middle[:, :2]) > 0.0).all()  # outwards
    area = 0.5 * np.linalg.norm(across, axis=1).sum()
    cylinder = np.pi * (line.radius[1:] + line.radius[:-1]) @ np.diff(line.coordinate)
    assert area == pytest.approx(cylinder * np.sin(np.pi / 15) / (np.pi / 15), rel=1e-3)  # a polygon of 15 sides
    assert middle[0, 1] == pytest.approx(0.0, abs=1e-9)  # the first cell lies around the angle 0


def test_what_turns_stands_around_the_axle_at_one_instant(found: Service) -> None:
    assert found.turned is not None
    values, last = surface_values(found.whole, found.turned), found.turned.revolutions[-1].moments[-1]
    assert last.time == round(last.time)  # the loads stand at the angle 0
    weight = np.bincount(found.whole.fit.facet, minlength=found.whole.fit.lines[0].facets).clip(1)
    for i, name in enumerate(("pressure_MPa", "shear_along_MPa", "shear_around_MPa")):
        for k in range(found.turned.angles):
            there = np.bincount(found.whole.fit.facet, last.traction[k, i], len(weight)) / weight
            there = np.maximum(-there, 0.0) if i == 0 else there
            error = np.abs(values[name][3 * k] - there).max()
            assert error < 0.03 * np.abs(values["shear_along_MPa"]).max(), (name, k)
    wrong = np.bincount(found.whole.fit.facet, last.traction[1, 1], len(weight)) / weight
    assert np.abs(values["shear_along_MPa"][-3] - wrong).max() > 0.1 * np.abs(wrong).max()


def test_shear_stress_stands_around_the_axle_as_in_the_bonded_fit(found: Service) -> None:
    assert found.turned is not None
    shear = surface_values(found.whole, found.turned)["surface_shear_stress_MPa"]
    bonded = 2.0 * found.bonded.harmonics[1].stress[:, MT].real  # of the sin family
    around = np.sin(2.0 * np.pi * np.arange(15) / 15)
    assert np.corrcoef(around @ shear, bonded)[0, 1] > 0.97  # a little slips


def test_surface_says_what_the_tables_say(found: Service, folder: Path) -> None:
    mesh, seat = meshio.read(folder / output.SURFACE), read_table(folder / output.SEAT)
    data = {name: values[0].reshape(15, -1) for name, values in mesh.cell_data.items()}
    for name in ("crossland", "dang_van", "findley", "swt_MPa", "ruiz_MPa2_mm"):
        assert (data[name] == seat[name]).all()
    assert data["axial_stress_MPa"].max(axis=0) == pytest.approx(seat["largest_axial_stress_MPa"])
    # the wheel is pressed against the seat where it stands on the rail, and the axle is compressed there
    inside = found.bonded.nominal > 0.0
    assert (data["axial_stress_MPa"][0] - data["axial_stress_MPa"][7] < 0.0)[inside].mean() > 0.7
    wear = read_table(folder / output.FRETTING)
    assert (
        0.5 * wear["axial_slip_range_mm"].max() < data["slip_range_along_mm"].max() <= wear["axial_slip_range_mm"].max()
    )


def test_histories_are_those_of_the_last_revolution(found: Service, folder: Path) -> None:
    assert found.turned is not None
    with h5py.File(folder / output.HISTORIES) as file:
        assert file["time"][:] == pytest.approx(np.linspace(2.0, 3.0, 16))
        traction, slip, area = file["traction"][:], file["slip"][:], file["area"][:]
        assert file["traction"].attrs["unit"] == "MPa"
        assert file["slip"].attrs["axes"] == "time, angle, (normal, along the seat, around it), place"
        assert "(nn, mm, tt, nm, nt, mt)" in file["stress"].attrs["axes"]
        assert (
            file["stress"][:, :, MM].max(axis=0) == read_table(folder / output.SEAT)["largest_axial_stress_MPa"]
        ).all()
    mean = 0.5 * (traction[1:] + traction[:-1])[:, :, 1:]
    work = -(mean * np.diff(slip[:, :, 1:], axis=0)).sum(axis=(0, 2)).mean(axis=0) @ area
    assert work == pytest.approx(found.turned.revolutions[-1].friction_work, rel=1e-9)
