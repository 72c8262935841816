"""What a database holds: the fields of a sample with their units and shapes, and the hash of its content."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any

import msgspec
import numpy as np
import numpy.typing as npt

from macrofit.base.arrays import FloatArray, HeightArray, IntArray
from macrofit.base.toml import TomlError, parse_toml
from meso.settings import FaceKeys

from ..errors import DatabaseError
from .plates import Plates

SCHEMA = 2
"""Version of the fields; 1 had no `FACES_AND_LOAD`, which all samples of a database shared."""
FACES_AND_LOAD = ("pressure", "form", "lay", "feed", "groove_depth", "anisotropy")
"""Fields of a sample that those of schema 1 lack."""
VARIED_FACES = ("levels", "max_height", "hurst_exponent")
"""Keys of the faces that every design varies."""
BLOCK = 256
"""Samples that are laid out row by row at a time."""


class Header(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """What all samples of a database share."""

    design: str
    """Options of the design, as JSON."""
    settings: str
    """Settings of the plates, as TOML; for what the design varies see the samples."""
    code: str
    """Hash of the code that computed the samples."""
    version: str
    """Version of the package."""
    micro_frictions: int
    """Number of micro coefficients per sample, k."""
    squares: int
    """Length of the axle's plate over that of the wheel's."""
    points: int = 33
    """Points of a surface along the edge of the wheel's plate; an envelope has 2 points - 1."""
    schema: int = SCHEMA

    @property
    def plates(self) -> Plates:
        """What the settings say of the plates.

        Raises:
            DatabaseError: they are no TOML, or lack a key.
        """
        try:
            return Plates.of_settings(parse_toml(self.settings, "settings"))
        except (TomlError, KeyError, msgspec.ValidationError) as error:
            raise DatabaseError(f"settings of the plates cannot be read ({error}); make the database anew") from error

    @property
    def surface(self) -> FaceKeys:
        """How the faces were made, but for what the design varies; older settings know tiles by themselves alone.

        Raises:
            DatabaseError: as `plates`.
        """
        try:
            table = parse_toml(self.settings, "settings")["surface"]
            keys = {key: value for key, value in table.items() if not key.endswith("_seed")}
            return msgspec.convert({"form": "tiles"} | keys, FaceKeys)
        except (TomlError, KeyError, msgspec.ValidationError) as error:
            raise DatabaseError(f"settings of the plates cannot be read ({error}); make the database anew") from error

    def face_keys(self, samples: Samples, sample: int) -> FaceKeys:
        """How the faces of a sample were made."""
        varied = {name: getattr(samples, name)[sample].item() for name in (*VARIED_FACES, *FACES_AND_LOAD[1:])}
        text = {name: value.decode() for name, value in varied.items() if isinstance(value, bytes)}
        return msgspec.structs.replace(self.surface, **varied | text)

    def row(self) -> np.dtype[Any]:
        """The type of one sample: the fields of `Samples`."""
        k, n = self.micro_frictions, self.points - 1
        per_coefficient = {
            name: np.dtype(("<f8", (k,)))
            for name in (
                "micro_friction", "meso_friction", "meso_friction_mean_of_ratio", "uncertainty", "mean_normal",
                "mean_tangential", "minimum_normal", "stored_energy", "friction_loss", "approach",
            )
        }  # fmt: skip
        special = {
            "wheel": np.dtype(("<f4", (n + 1, n + 1))),
            "axle": np.dtype(("<f4", (self.squares * n + 1, n + 1))),
            "wheel_envelope": np.dtype(("<f4", (2 * n + 1, 2 * n + 1))),
            "axle_envelope": np.dtype(("<f4", (2 * self.squares * n + 1, 2 * n + 1))),
            "engine": np.dtype(("S16", (k,))),
            "remark": np.dtype("S240"),
            "form": np.dtype("S8"),
            "lay": np.dtype("S9"),
        }
        numbers = ("max_height", "hurst_exponent", "pressure", "feed", "groove_depth", "anisotropy", "cpu_s")
        known = per_coefficient | special | dict.fromkeys(numbers, np.dtype("<f8"))
        names = [field.name for field in fields(Samples) if self.schema > 1 or field.name not in FACES_AND_LOAD]
        return np.dtype([(name, known.get(name, np.dtype("<i8"))) for name in names])

    def completed(self, columns: dict[str, npt.NDArray[Any]]) -> Samples:
        """Make the samples of these columns; what those of schema 1 lack is the same for all, and in the settings."""
        if self.schema == 1:
            surface, count = self.surface, len(columns["id"])
            shared = {"pressure": self.plates.pressure} | {name: getattr(surface, name) for name in FACES_AND_LOAD[1:]}
            row = msgspec.structs.replace(self, schema=SCHEMA).row()
            filled = {
                name: np.full(count, value.encode() if isinstance(value, str) else value, row[name])
                for name, value in shared.items()
            }
            columns = columns | filled
        return Samples(**{field.name: columns.pop(field.name) for field in fields(Samples)})


@dataclass(frozen=True, kw_only=True)
class Samples:
    """Friction tests, one row each, sorted by id: n pairs of plates, each slid with k micro coefficients.

    Heights are measured outward from the nominal face of each body, in single precision (1e-7 of the height). Row i
    of a matrix lies at x = i dx along the slide, column j at y = j dy across it. Heights
    of the wheel are mirrored in z, not rotated: after a slide s its point (x, y) faces point (x + s, y) of the axle.
    """

    id: IntArray
    """Number in the design, shape (n,)."""
    wheel_seed: IntArray
    """Seed of the wheel's surface, shape (n,); so are all up to the exponent."""
    axle_seed: IntArray
    """Seed of the axle's surface."""
    packing_seed: IntArray
    """Seed of both packings."""
    levels: IntArray
    """Subdivisions of both surfaces."""
    max_height: FloatArray
    """Range R of the random heights [mm]."""
    hurst_exponent: FloatArray
    """Hurst exponent H [-]."""
    pressure: FloatArray
    """Normal force over the apparent area before the slide [MPa], shape (n,)."""
    form: npt.NDArray[np.bytes_]
    """Form of the faces, shape (n,)."""
    lay: npt.NDArray[np.bytes_]
    """Lay of the faces, shape (n,)."""
    feed: FloatArray
    """Distance of turned grooves [mm]."""
    groove_depth: FloatArray
    """Depth of turned grooves [mm]."""
    anisotropy: FloatArray
    """Anisotropy of ground faces [-]."""
    wheel: HeightArray
    """Surface of the wheel [mm], shape (n, 33, 33) on 1 x 1 mm; exact, for grids of 2^levels + 1 points nest."""
    axle: HeightArray
    """Surface of the axle [mm], shape (n, 65, 33) on 2 x 1 mm."""
    wheel_envelope: HeightArray
    """Upper envelope of the wheel's spheres [mm], shape (n, 65, 65)."""
    axle_envelope: HeightArray
    """Upper envelope of the axle's spheres [mm], shape (n, 129, 65)."""
    micro_friction: FloatArray
    """Micro coefficients [-], shape (n, k), rising in each row; all that follow have this shape."""
    meso_friction: FloatArray
    """Mean T over mean N [-], shape (n, k)."""
    meso_friction_mean_of_ratio: FloatArray
    """Mean of T/N along the slide [-]."""
    uncertainty: FloatArray
    """Standard error of `meso_friction` along the slide."""
    mean_normal: FloatArray
    """Mean N over the slide [N]."""
    mean_tangential: FloatArray
    """Mean T over the slide [N]."""
    minimum_normal: FloatArray
    """Smallest N along the slide [N]."""
    stored_energy: FloatArray
    """Energy in beams and contacts at the end of the slide less that at its start [N mm]."""
    friction_loss: FloatArray
    """Work lost in the contacts along the slide [N mm]."""
    approach: FloatArray
    """From the first touch to the end of the squeeze [mm]."""
    engine: npt.NDArray[np.bytes_]
    """The engine that answered, shape (n, k)."""
    remark: npt.NDArray[np.bytes_]
    """Why another engine than the one asked for, if so; shape (n,)."""
    cpu_s: FloatArray
    """Time of the processor [s], shape (n,); the last field, and no part of a sample's digest."""

    def __len__(self) -> int:
        return len(self.id)


def select_samples(samples: Samples, rows: IntArray) -> Samples:
    """Select some of the samples, in the order of `rows`."""
    return Samples(**{name: column[rows] for name, column in vars(samples).items()})


def joined_samples(parts: Sequence[Samples]) -> Samples:
    """All samples of the parts, one part after the other."""
    if len(parts) == 1:
        return parts[0]
    return Samples(**{name: np.concatenate([vars(part)[name] for part in parts]) for name in vars(parts[0])})


def content_hash(samples: Samples) -> str:
    """Hash all samples by id, but for the time they took."""
    whole = hashlib.sha256()
    for sample in sample_digests({field.name: getattr(samples, field.name) for field in fields(Samples)}):
        whole.update(sample)
    return whole.hexdigest()


def sample_digests(arrays: Mapping[str, npt.NDArray[Any]]) -> Iterator[bytes]:
    """Yield the SHA-256 of each sample as `Header.row` lays it out, but for its time."""
    row = np.dtype([(name, stored.dtype, stored.shape[1:]) for name, stored in arrays.items()])
    count = len(arrays["id"])
    for start in range(0, count, BLOCK):
        block = np.empty(min(BLOCK, count - start), row)
        for name, stored in arrays.items():
            block[name] = stored[start : start + BLOCK]
        yield from (hashlib.sha256(sample.tobytes()[:-8]).digest() for sample in block)
