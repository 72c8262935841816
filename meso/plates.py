"""Two rough plates face to face: from settings to surfaces, packings and lattices.

The axle's plate lies at the bottom, 0 <= z, its rough face up; the wheel's hangs above it, rough face down. The wheel
is carried by `drive` = (x, y, z): x is the slide, z the height of its plate over the position in which the nominal
faces coincide.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from macrofit.base.arrays import FloatArray

from .errors import PackingError
from .lattice.calibration import beams_for
from .lattice.candidates import STILL, ContactCandidates, Faces
from .lattice.lattice import Lattice, build, join, turned_over
from .lattice.modulus import scaled_to
from .lattice.sway import sway_frequency
from .material import Beams
from .packing.cache import flat_packing
from .packing.pack import Packing, morph
from .settings import Settings
from .surfaces.face import rough_face
from .surfaces.surface import Body


def beams_of(settings: Settings) -> Beams:
    """The beams of the settings, or those calibrated for its material."""
    return settings.beams if settings.beams is not None else beams_for(settings.material)


@dataclass(frozen=True, kw_only=True)
class Plates:
    """The two plates of a friction test, ready to be brought together."""

    settings: Settings
    wheel_packing: Packing
    axle_packing: Packing
    beams: Beams
    wheel: Lattice
    """Turned over and hung above the axle's."""
    axle: Lattice

    @cached_property
    def lattice(self) -> Lattice:
        """Both in one numbering, the wheel's nodes first."""
        return join(self.wheel, self.axle)

    @cached_property
    def faces(self) -> Faces:
        """The two rough faces."""
        return Faces(self.lattice, self.wheel.nodes)

    @cached_property
    def first_touch(self) -> float:
        """Height of the wheel's plate at which the faces first touch, before any slide [mm]."""
        return self.faces.first_touch()

    @property
    def bodies(self) -> dict[Body, tuple[Packing, Lattice]]:
        """Packing and lattice of each plate."""
        return {"wheel": (self.wheel_packing, self.wheel), "axle": (self.axle_packing, self.axle)}

    @cached_property
    def sway(self) -> tuple[float, float]:
        """Frequencies at which the wheel's and the axle's plate sway on their external faces [Hz]."""
        return sway_frequency(self.wheel), sway_frequency(self.axle)

    @property
    def resonance(self) -> float:
        """f d: geometric mean of the sway frequencies times the mean diameter of the spheres [mm/s]."""
        wheel, axle = self.sway
        return float(np.sqrt(wheel * axle)) * 2.0 * float(self.lattice.radii.mean())

    @property
    def speed(self) -> float:
        """Speed of the slide in the explicit engine [mm/s]: `engine.speed`, or `engine.resonance` times f d."""
        keys = self.settings.engine
        return keys.speed if keys.resonance is None else keys.resonance * self.resonance

    @property
    def area(self) -> float:
        """Apparent area of contact [mm2]."""
        return self.settings.plates.edge**2

    @property
    def target(self) -> float:
        """Normal force at the end of the squeeze [N]; 0 where an interference is asked for instead."""
        return self.settings.load.pressure * self.area if self.settings.load.interference is None else 0.0

    def candidates(
        self, low: float, high: float, margin: float, travel: float | None = None, sway: FloatArray = STILL
    ) -> ContactCandidates:
        """Pairs that may meet while the wheel's height stays within low ... high [mm]; see `Faces.candidates`."""
        settings = self.settings
        return self.faces.candidates(
            (low, high),
            settings.load.slide if travel is None else travel,
            margin,
            settings.material,
            settings.contact.normal_stiffness,
            settings.contact.tangential_ratio,
            sway,
        )

    def likely_approach(self) -> float:
        """How far below the first touch the squeeze will probably end [mm].

        Spheres that overlap as if the plates were rigid, each a spring of k_n in series with as much again twice
        (the lattices below it), are brought to the force asked for.
        """
        interference = self.settings.load.interference
        if interference is not None:
            return interference
        reach = 0.25 * float(self.lattice.radii.mean())
        near = self.candidates(self.first_touch - reach, self.first_touch, 0.0, travel=0.0)
        across = np.hypot(near.offset[:, 0], near.offset[:, 1])
        radii = near.reach
        below = across < radii
        gap = -near.offset[below, 2] - np.sqrt(radii[below] ** 2 - across[below] ** 2)
        depth = np.sort(gap + self.first_touch)  # approach at which each pair touches, from zero
        stiffness = float(near.normal_stiffness.mean()) / 3.0
        force = stiffness * (np.arange(1, len(depth) + 1) * depth - np.cumsum(depth))
        enough = int(np.searchsorted(force, self.target))
        if enough == 0:
            return float(depth[0])
        return float((self.target / stiffness + np.sum(depth[:enough])) / enough)


def make_plates(settings: Settings) -> Plates:
    """Surfaces, packings and lattices of these settings.

    Raises:
        SettingsError, SurfaceError, PackingError: what cannot be built, and what to try.
    """
    return face_to_face(settings, make_plate(settings, "wheel"), make_plate(settings, "axle"))


def make_plate(settings: Settings, body: Body) -> tuple[Packing, Lattice]:
    """One plate, its lattice where it belongs: the wheel's turned over. The other body's seed has no part in it.

    Raises:
        SettingsError, SurfaceError, PackingError: as `make_plates`.
    """
    keys, edge, slide = settings.plates, settings.plates.edge, settings.load.slide
    axle_packing = keys.packing_seed if keys.axle_packing_seed is None else keys.axle_packing_seed
    packing_seed, length, seed = {
        "wheel": (2 * keys.packing_seed, edge, settings.surface.wheel_seed),
        "axle": (2 * axle_packing + 1, edge + slide, settings.surface.axle_seed),
    }[body]
    size = (length, edge)
    spheres = max(1, round(keys.spheres * length / (edge + (edge + slide))))
    try:
        flat = flat_packing(spheres, size, keys.thickness, packing_seed)
    except PackingError as error:
        raise PackingError(
            f"plates.spheres = {keys.spheres} in both plates together, plate of the {body}: {error}"
        ) from None
    packing = morph(flat, rough_face(settings.surface, body, seed, size))
    lattice = build(
        packing,
        settings.material,
        beams_of(settings),
        cube=keys.cube,
        external_face=keys.external_face,
        external_modulus=keys.external_modulus,
    )
    if keys.modulus == "material":
        lattice = scaled_to(settings.material.youngs_modulus, packing, lattice)
    return packing, turned_over(lattice, 2.0 * keys.thickness) if body == "wheel" else lattice


def face_to_face(settings: Settings, wheel: tuple[Packing, Lattice], axle: tuple[Packing, Lattice]) -> Plates:
    """The plates of a friction test from two that `make_plate` made; each may serve in many."""
    return Plates(
        settings=settings,
        wheel_packing=wheel[0],
        axle_packing=axle[0],
        beams=beams_of(settings),
        wheel=wheel[1],
        axle=axle[1],
    )
