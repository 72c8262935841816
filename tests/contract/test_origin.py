"""What a run keeps of measured faces: the same of plates and network, and what tiles are really cut from."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
from mpi4py import MPI
from small import small_press

import meso.surfaces.measured as cut
from macrofit.friction import BuildContext, build
from macrofit.friction.evolving import FlatteningPairs
from macrofit.run import write_results
from macrofit.scene import Scene
from macrofit.solve import solve
from meso.settings import FaceKeys
from meso.surfaces.measured import laid_pieces, measured_face
from meso.surfaces.origin import measured_origin
from meso.surfaces.surface import tile_seed

CONTEXT = BuildContext(seat_tiles=5, bore_tiles=6, youngs_modulus=206e3, poisson_ratio=0.3)


@pytest.fixture
def files(tmp_path: Path) -> dict[str, Any]:
    """A strip of 190 mm for the axle, and two patches of 1.5 mm for the bore, as options."""
    rng = np.random.default_rng(3)
    strip = tmp_path / "strip.npz"
    np.savez(strip, heights=2e-3 * rng.standard_normal((1900, 11)), spacing=0.1)
    patches = []
    for k in range(2):
        patches.append(str(tmp_path / f"patch{k}.npz"))
        np.savez(patches[-1], heights=3e-3 * rng.standard_normal((75, 60)), spacing=0.02)
    return {"axle": str(strip), "bore": {"files": patches}}


def options(files: dict[str, Any]) -> dict[str, Any]:
    return {"surface": files, "seed": 3}


@pytest.mark.filterwarnings("ignore:friction provider")
def test_plates_and_network_are_made_of_the_same(files: dict[str, Any]) -> None:
    dem, network = (build(name, options(files), CONTEXT) for name in ("dem", "surrogate"))
    origin = network.origin  # type: ignore[attr-defined]
    assert origin == dem.origin  # type: ignore[attr-defined]
    assert FlatteningPairs(network, "surrogate", 0.07, 1e4).origin == msgspec.to_builtins(origin)
    (strip,) = origin["axle"]["files"]
    assert strip["Sq_mm"] == pytest.approx(2e-3, rel=0.1)
    assert strip["done"][-1] == "form removed: cylinder"
    assert {"sha256", "lay_degrees", "lay_strength"} <= strip.keys()
    assert origin["axle"]["tile_0_at_mm"] == 0.0
    assert len(origin["bore"]["files"]) == 2
    starts = [piece["from_mm"] for piece in origin["bore"]["pieces"]]
    assert starts == pytest.approx(1.125 * np.arange(-1, 6))  # of six tiles
    assert build("surrogate", {}, CONTEXT).origin == {}  # type: ignore[attr-defined]


def test_the_pieces_are_those_that_tiles_are_cut_from(files: dict[str, Any], monkeypatch: pytest.MonkeyPatch) -> None:
    keys = FaceKeys(bore=tuple(files["bore"]["files"])).found().measured("wheel")
    assert keys is not None
    read, laid = cut._read, []

    def noted(scan: Any, piece: Any, *rest: Any) -> Any:
        laid.append(piece)
        return read(scan, piece, *rest)

    monkeypatch.setattr(cut, "_read", noted)
    told = laid_pieces(keys, "wheel", 3, (6.0, 1.0))
    for tile in range(6):
        laid.clear()
        measured_face(keys, "wheel", tile_seed(3, tile), (1.0, 1.0))
        over = [piece for start, piece in told if start <= tile + 1.0 + 1e-9 and start + 1.5 >= tile - 1e-9]
        assert laid == over
    assert len({piece.which for _, piece in told}) == 2
    assert measured_origin(FaceKeys(), 3, {"axle": 5, "wheel": 6}, 1.0) == {}


def rough(files: dict[str, Any]) -> Scene:
    table = f"{{seed=3, surface={{axle='{files['axle']}', bore={{files={files['bore']['files']}}}}}}}"
    return small_press("friction.provider=surrogate", f"friction.options={table}")


@pytest.mark.filterwarnings("ignore:friction provider")
def test_the_record_of_a_run_has_it(files: dict[str, Any], tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    write_results(tmp_path / "out", solve(rough(files), MPI.COMM_SELF))
    kept = json.loads((tmp_path / "out" / "summary.json").read_text())["provenance"]
    assert kept["friction"]["bore"]["files"][1]["file"].endswith("patch1.npz")
    write_results(tmp_path / "out", solve(small_press(), MPI.COMM_SELF))
    assert "friction" not in json.loads((tmp_path / "out" / "summary.json").read_text())["provenance"]
