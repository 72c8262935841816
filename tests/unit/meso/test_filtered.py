"""The Gaussian filter against its transmission, and profiles of waves whose measures are known."""

from __future__ import annotations

import numpy as np
import pytest

from meso.plates import make_plates
from meso.results.summary import body_roughness, profile_line
from meso.settings import FaceKeys, load
from meso.surfaces.face import rough_face
from meso.surfaces.filtered import CUTOFF, filtered, measured_length, profile
from meso.surfaces.roughness import measure
from meso.surfaces.surface import Surface

A = 0.001


def wave(length: float, *, along: bool = True, extent: float = 24.0) -> Surface:
    """A sine of this wavelength [mm] along one side, 64 points to a millimetre."""
    n = round(64 * extent)
    x = np.linspace(0.0, extent, n + 1)
    h = np.tile(A * np.sin(2 * np.pi * x / length)[:, None], (1, 65))
    return Surface(h, (extent, 1.0)) if along else Surface(h.T, (1.0, extent))


@pytest.mark.parametrize("length", [0.2, 0.4, 0.8, 1.6, 4.0])
@pytest.mark.parametrize("along", [True, False])
def test_half_of_a_wave_of_the_cutoff_is_kept(length: float, along: bool) -> None:
    """Transmission 1 - exp(-pi (alpha cutoff / wavelength)^2) = 1 - 2^-((cutoff / wavelength)^2), away from the ends.

    The filter ends at one cut-off, where its weight is 1e-6 of the middle; what it leaves out is 2e-4 of the sum.
    """
    face = wave(length, along=along)
    middle = (slice(128, -128), slice(None)) if along else (slice(None), slice(128, -128))
    kept = 1.0 - 2.0 ** -((CUTOFF / length) ** 2)
    assert filtered(face).heights[middle] == pytest.approx(kept * face.heights[middle], abs=1e-3 * A)


def test_a_filter_leaves_nothing_of_a_constant_and_of_a_plane_within() -> None:
    flat = Surface(np.full((33, 17), 0.3), (2.0, 1.0))
    assert filtered(flat).heights == pytest.approx(0.0, abs=1e-15)
    x = np.linspace(0.0, 8.0, 129)[:, None]
    tilted = filtered(Surface(np.repeat(0.01 * x, 17, axis=1), (8.0, 1.0))).heights
    assert tilted[13:-13] == pytest.approx(0.0, abs=1e-12)
    assert np.abs(tilted[0]).max() > 1e-4  # at the border the filter has one side only


def test_profile_of_a_wave() -> None:
    """Ra = 2 A / pi, Rq = A / sqrt 2, Rz = 2 A of a short sine, a part 2^-16 of which is taken away."""
    found = profile(wave(0.2))
    assert found.Ra == pytest.approx(2 * A / np.pi, rel=5e-3)
    assert found.Rq == pytest.approx(A / np.sqrt(2), rel=5e-3)
    assert found.Rz == pytest.approx(2 * A, rel=0.02)  # 13 points to a wave
    assert found.evaluation == pytest.approx(24.0 - CUTOFF, abs=1 / 32)
    assert profile(wave(0.2, extent=1.0)).evaluation == 1.0  # nothing to spare


def test_heights_as_generated_are_not_the_roughness_of_a_drawing() -> None:
    """R = 20 um: Sq 3 um and more as generated, Rq below 1 um behind the filter, and Ra of 0.5 to 0.9 um."""
    face = rough_face(FaceKeys(), "axle", 65536, (2.0, 1.0))
    long = measured_length(FaceKeys(), "axle", 65536, face)
    assert long.size == (40.0, 1.0)
    assert np.array_equal(long.heights[:17], face.heights)
    assert measure(long).Sq > 3e-3
    assert 0.5e-3 < profile(long).Ra < profile(long).Rq < 1e-3
    for keys in (FaceKeys(form="tiles"), FaceKeys(form="levelled")):
        assert measured_length(keys, "axle", 3, face) is face


def test_a_fine_strip_is_measured_on_one_evaluation_length() -> None:
    keys = FaceKeys(levels=9)
    face = Surface.flat((1.0, 1.0)).resampled((513, 513))
    assert measured_length(keys, "wheel", 65536, face).size == (5.0, 1.0)


@pytest.mark.parametrize("form", ["strip", "tiles"])
def test_a_summary_has_faces_profiles_and_envelopes(form: str) -> None:
    settings = load(None, ["plates.spheres=600", f"surface.form={form}"])
    plates = make_plates(settings)
    for body, packing in (("wheel", plates.wheel_packing), ("axle", plates.axle_packing)):
        found = body_roughness(settings, body, packing)  # type: ignore[arg-type]
        assert found["Sq_mm"] == measure(packing.surface).Sq > found["filtered"]["Sq_mm"] > 0.0
        assert found["envelope"]["Sq_mm"] > 5.0 * found["Sq_mm"]  # spheres of 50 um stand out of the face
        assert found["filtered"]["cutoff_mm"] == found["profile"]["cutoff_mm"] == CUTOFF
        assert found["profile"]["evaluation_mm"] > (30.0 if form == "strip" else 0.9)
        assert found["profile"]["Rz_mm"] > 2.0 * found["profile"]["Ra_mm"] > 0.0
        said = profile_line(settings, body, packing.surface)  # type: ignore[arg-type]
        assert ("of the strip" if form == "strip" else "of this face alone") in said
