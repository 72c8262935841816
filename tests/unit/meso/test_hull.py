"""The shell of a plate: closed, outward, as large as its heights say, and the same after a file."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from meso.errors import OutputError, SurfaceError
from meso.surfaces.hull import Hull, hull, is_watertight, write
from meso.surfaces.surface import Surface, diamond_square, generator

PLATES = [((1.0, 1.0), 1), ((1.0, 1.0), 4), ((2.0, 1.0), 3), ((0.5, 1.0), 3)]


def plate(size: tuple[float, float], levels: int, height: float = 0.1) -> tuple[Surface, Hull]:
    surface = diamond_square(generator("test", levels), levels=levels, max_height=height, size=size)
    return surface, hull(surface, 0.3)


def volume_under(surface: Surface, thickness: float) -> float:
    """int H + h: per cell the two triangles give (2 h00 + 2 h11 + h10 + h01) / 6 times its area."""
    h, (dx, dy) = surface.heights, surface.spacing
    means = (2 * h[:-1, :-1] + 2 * h[1:, 1:] + h[1:, :-1] + h[:-1, 1:]) / 6
    return float(thickness * surface.size[0] * surface.size[1] + dx * dy * means.sum())


@pytest.mark.parametrize(("size", "levels"), PLATES)
def test_closed_and_of_the_right_volume(size: tuple[float, float], levels: int) -> None:
    """Both sides of the divergence theorem are sums of a few hundred products: equal to 1e-12.

    The volume is positive only if normals point outward, and is the plate's only if all of them do.
    """
    surface, shell = plate(size, levels)
    assert is_watertight(shell.triangles)
    assert shell.volume == pytest.approx(volume_under(surface, 0.3), rel=1e-12)
    nx, ny = surface.shape
    assert len(shell.points) == 2 * nx * ny
    assert len(shell.triangles) == 4 * (nx - 1) * (ny - 1) + 4 * (nx + ny - 2)
    assert len(np.unique(shell.triangles)) == len(shell.points)


@pytest.mark.parametrize(("size", "levels"), PLATES)
def test_every_face_looks_outward(size: tuple[float, float], levels: int) -> None:
    """Normals of the rough face go up, of the back down, of the sides away from the middle; their sum is zero.

    The vector areas of a closed shell cancel, to rounding of areas below 2 mm^2.
    """
    surface, shell = plate(size, levels)
    a, b, c = np.moveaxis(shell.points[shell.triangles], 1, 0)
    area = 0.5 * np.cross(b - a, c - a)
    cells = 2 * (surface.shape[0] - 1) * (surface.shape[1] - 1)
    assert (area[:cells, 2] > 0).all()
    assert (area[cells : 2 * cells, 2] < 0).all()
    outward = (a + b + c) / 3 - np.array([size[0] / 2, size[1] / 2, 0.0])
    sides = np.einsum("ij,ij->i", area[2 * cells :, :2], outward[2 * cells :, :2])
    assert (sides > 0).all()
    assert area.sum(axis=0) == pytest.approx(np.zeros(3), abs=1e-14)


def test_rough_face_is_the_surface() -> None:
    """Random points on the hull's upper triangles lie where Surface.at puts them: same diagonal, to rounding."""
    surface, shell = plate((2.0, 1.0), 3)
    nx, ny = surface.shape
    triangles = shell.triangles[: 2 * (nx - 1) * (ny - 1)]
    share = generator("test").dirichlet(np.ones(3), len(triangles))
    x, y, z = np.einsum("tk,tkd->dt", share, shell.points[triangles])
    assert surface.at(x, y) + 0.3 == pytest.approx(z, abs=1e-14)
    assert (shell.points[nx * ny :, 2] == 0.0).all()


def test_leaks_are_found() -> None:
    """A hole, a triangle turned over, a doubled or a folded triangle, or nothing at all is not a closed shell."""
    _, shell = plate((1.0, 1.0), 2)
    good = shell.triangles
    turned = good.copy()
    turned[7] = turned[7, ::-1]
    folded = np.concatenate([good, [[0, 24, 24]]])  # opposite corners: on no edge of the shell
    for bad in (good[1:], turned, np.concatenate([good, good[:1]]), np.concatenate([good, good]), folded, good[:0]):
        assert not is_watertight(bad)


@pytest.mark.parametrize(("suffix", "rel"), [(".stl", 1e-6), (".vtk", 1e-14), (".vtu", 1e-14), (".ply", 1e-14)])
def test_files(tmp_path: Path, suffix: str, rel: float) -> None:
    """Read back, the shell is still closed and as large: single precision in .stl, double elsewhere."""
    meshio = pytest.importorskip("meshio")
    _, shell = plate((2.0, 1.0), 3)
    path = write(shell, tmp_path / f"plate{suffix}")
    mesh = meshio.read(path)
    triangles = mesh.get_cells_type("triangle").astype(np.int64)
    again = Hull(np.asarray(mesh.points, dtype=np.float64), triangles)
    assert is_watertight(again.triangles)
    assert again.points.shape == shell.points.shape
    assert again.triangles.shape == shell.triangles.shape
    assert again.volume == pytest.approx(shell.volume, rel=rel)


def test_files_refused(tmp_path: Path) -> None:
    _, shell = plate((1.0, 1.0), 1)
    with pytest.raises(OutputError, match=r"plate\.obj: a hull is written as \.stl, \.vtk, \.vtu, \.ply, not as \.obj"):
        write(shell, tmp_path / "plate.obj")
    with pytest.raises(OutputError, match="cannot be written: No such file or directory"):
        write(shell, tmp_path / "nowhere" / "plate.stl")
    assert list(tmp_path.iterdir()) == []


def test_plate_thinner_than_its_valleys() -> None:
    """H + min h = 0 is refused, anything above is not."""
    surface = Surface(np.array([[0.0, 0.1], [-0.25, 0.0]]), (1.0, 1.0))
    message = r"reaches the back of the plate: thickness 0\.25 mm, deepest valley -0\.25 mm"
    with pytest.raises(SurfaceError, match=message) as caught:
        hull(surface, 0.25)
    assert "\n" not in str(caught.value)
    assert hull(surface, 0.2500001).volume > 0
    for thickness in (0.1, -1.0, np.nan, np.inf):
        with pytest.raises(SurfaceError):
            hull(surface, thickness)


def test_import_is_light() -> None:
    """Making a hull does not load meshio."""
    code = (
        "import sys, meso.surfaces.hull, meso.surfaces.roughness\n"
        "sys.exit('meshio' in sys.modules or 'scipy' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
