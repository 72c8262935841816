"""A trained network on disk: tensors in safetensors, and where they come from. Nothing is ever unpickled.

The metadata has one entry, `macrofit-surrogate`: JSON with the provenance and a digest of it and of all tensors. (One
entry only: safetensors writes several in no fixed order, and the same training shall give the same bytes.)
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

import msgspec
import numpy as np
import numpy.typing as npt
import safetensors
import safetensors.numpy

from macrofit.base.errors import OutputError, shortened
from macrofit.base.files import check_regular, replacing

from ..data.plates import Faces, Plates
from ..errors import CheckpointError
from .inference import TrainedEnsemble, ensemble_shapes

if TYPE_CHECKING:
    from .model import FoundationEnsemble, LallemanCNN, LallemanEnsemble

Architecture = Literal["energy", "paper"]
Model: TypeAlias = "FoundationEnsemble | LallemanCNN | LallemanEnsemble"
Arrays: TypeAlias = dict[str, npt.NDArray[Any]]
Shapes: TypeAlias = dict[str, tuple[np.dtype[Any], tuple[int, ...]]]
ENTRY = "macrofit-surrogate"
SCHEMA = 1
Control: TypeAlias = Literal["displacement", "force"]
"""What is held while sliding."""
PRESSURE_SLACK = 0.05
"""How far a pressure may lie outside those learned from [-]; it is worth less than 0.1 % of a coefficient."""
LARGEST_FILE = 200_000_000
"""Upper bound of a file that is read [bytes]."""


class EnsembleOptions(
    msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, tag="energy", tag_field="architecture"
):
    """Arguments of `FoundationEnsemble`; files name this architecture "energy"."""

    stiffness: list[float]
    load: float
    members: int = 8
    width: int = 24
    positions: int = 5
    constant: bool = False
    wide: bool = False
    trapezoid: bool = False

    def build_network(self) -> FoundationEnsemble:
        """Build the network, untrained; with torch."""
        from .model import FoundationEnsemble

        return FoundationEnsemble(**{name: getattr(self, name) for name in self.__struct_fields__})


class CNNOptions(msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag="paper", tag_field="architecture"):
    """Arguments of `LallemanCNN`, or with several members of `LallemanEnsemble`; files name both "paper"."""

    points: int = 33
    filters: tuple[int, ...] = (16, 12, 8, 6, 4)
    members: int = 1

    def build_network(self) -> LallemanCNN | LallemanEnsemble:
        """Build the network, untrained; with torch."""
        from .model import LallemanCNN, LallemanEnsemble

        if self.members == 1:
            return LallemanCNN(self.points, self.filters)
        return LallemanEnsemble(self.points, self.filters, self.members)


class Provenance(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Where weights come from, what inputs they have seen, and how well they did."""

    options: EnsembleOptions | CNNOptions
    """Architecture and its arguments."""
    faces: Faces
    """Surfaces as generated, or as the envelopes of their spheres."""
    database: str
    """Content hash of the samples."""
    seed: int
    """Seed of the split, the starting values and the order of the samples."""
    training: int
    """Pairs learned from."""
    validation: int
    """Pairs held back, for early stopping and for the stated uncertainty."""
    points: int
    """Points of a wheel's face along its edge."""
    plates: Plates
    """The plates of the friction tests."""
    surface_seeds: tuple[int, int]
    """Smallest and largest seed of a surface, of both bodies together; held back or not."""
    packing_seeds: tuple[int, int]
    """Smallest and largest seed of a packing."""
    max_height: tuple[float, float]
    """Smallest and largest R [mm]."""
    levels: tuple[int, ...]
    """Subdivisions that were there."""
    hurst_exponent: tuple[float, float]
    """Smallest and largest Hurst exponent [-]."""
    micro_friction: tuple[float, float]
    """Smallest and largest micro coefficient [-]."""
    pressures: dict[Control, tuple[float, float]] = {}
    """Smallest and largest pressure at the modulus of the plates [MPa], by what was held while sliding; none: the
    pressure of the plates alone, and what they hold."""
    forms: tuple[str, ...] = ()
    """Forms of the faces; none: that of the plates."""
    lays: tuple[str, ...] = ()
    """Lays of the faces; none: that of the plates."""
    seeds_of_form: dict[str, tuple[int, int]] = {}
    """`surface_seeds` of each form; none: those of the plates' form."""
    device: str = "cpu"
    """Device of torch on which it was trained."""
    validation_error: dict[str, float]
    """Mean relative error [-] on the validation pairs by micro coefficient."""
    validation_r2: float
    """R2 of b [-] on the validation pairs."""
    versions: dict[str, str]
    """Versions of the packages that trained the network."""
    schema: int = SCHEMA

    @property
    def wide(self) -> bool:
        """Whether pressure and modulus, as p/E, are inputs."""
        return bool(self.pressures)

    def at_modulus(self, pressure: float, youngs_modulus: float) -> float:
        """The pressure on plates of the network's modulus for which p/E is the same [MPa]."""
        return pressure * self.plates.youngs_modulus / youngs_modulus

    def unlike(self, asked: Plates) -> list[str]:
        """In which keys plates are others than the network knows, in words; see `Plates.unlike`."""
        known, findings = self.plates, []
        if not self.wide:
            return known.unlike(asked)
        ranges = {str(control): known for control, known in self.pressures.items()}
        if asked.control not in ranges:
            findings.append(f"load.control = '{asked.control}' is not '{' or '.join(ranges)}'")
        low, high = ranges.get(asked.control, (0.0, math.inf))
        pressure = self.at_modulus(asked.pressure, asked.youngs_modulus)
        if not low * (1.0 - PRESSURE_SLACK) <= pressure <= high * (1.0 + PRESSURE_SLACK):
            on_steel = "" if asked.youngs_modulus == known.youngs_modulus else f" ({pressure:.3g} on steel)"
            others = "; ".join(
                f"with control = '{control}' it knows {least:.3g} ... {most:.3g}"
                for control, (least, most) in ranges.items()
                if control != asked.control and least <= pressure <= most
            )
            findings.append(
                f"pressure = {asked.pressure:g}{on_steel} with control = '{asked.control}' is outside "
                f"{low:.3g} ... {high:.3g} MPa" + (f" ({others})" if others else "")
            )
        same = {"pressure": known.pressure, "youngs_modulus": known.youngs_modulus, "control": known.control}
        return findings + known.unlike(msgspec.structs.replace(asked, **same))

    @property
    def architecture(self) -> Architecture:
        """Name of the architecture in files and options."""
        return "energy" if isinstance(self.options, EnsembleOptions) else "paper"


class _Entry(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The entry of the metadata."""

    provenance: msgspec.Raw
    sha256: str


def checkpoint_digest(arrays: Mapping[str, npt.NDArray[Any]], provenance: bytes) -> str:
    """SHA-256 of the provenance and of names, types, shapes and values of all tensors."""
    whole = hashlib.sha256(provenance)
    for name in sorted(arrays):
        values = arrays[name]
        whole.update(f"{name} {values.dtype.str} {values.shape}".encode())
        whole.update(values.tobytes())
    return whole.hexdigest()


def save_checkpoint(path: Path, model: Model, provenance: Provenance) -> None:
    """Write the file in one step: whoever looks finds the old one or the new one.

    Raises:
        OutputError: it cannot be written.
    """
    arrays = {name: value.detach().cpu().contiguous().numpy() for name, value in model.state_dict().items()}
    about = msgspec.json.encode(provenance)
    entry = msgspec.json.encode(_Entry(msgspec.Raw(about), checkpoint_digest(arrays, about))).decode()
    with replacing(path) as draft:
        draft.write_bytes(safetensors.numpy.save(arrays, {ENTRY: entry}))


def load_checkpoint(path: Path) -> tuple[Model, Provenance]:
    """Read a network in torch, and its provenance.

    Raises:
        CheckpointError: there is no such file, it is no checkpoint of this program or a damaged or changed one, or
            the tensors are not those of its architecture.
    """
    arrays, provenance = _read_checked(path)
    return _assemble(path, arrays, provenance), provenance


def load_for_answers(path: Path) -> tuple[TrainedEnsemble | LallemanCNN | LallemanEnsemble, Provenance]:
    """Read a network, ready to predict: an ensemble on foundations in numpy, without torch.

    Raises:
        CheckpointError: as `load_checkpoint`.
    """
    arrays, provenance = _read_checked(path)
    if not isinstance(provenance.options, EnsembleOptions):
        return _assemble(path, arrays, provenance), provenance  # type: ignore[return-value]
    try:
        shapes = ensemble_shapes(provenance.options)
    except ValueError as error:
        raise CheckpointError(f"{path}: cannot be built from its options: {error}") from error
    _check_shapes(path, {name: (np.dtype(np.float32), shape) for name, shape in shapes.items()}, arrays, provenance)
    return TrainedEnsemble(provenance.options, arrays), provenance


def _read_checked(path: Path) -> tuple[Arrays, Provenance]:
    """All tensors and the provenance of a file that is as it was written, with finite values and options that fit."""
    arrays, text = _read(path)
    try:
        entry = msgspec.json.decode(text, type=_Entry)
        provenance = msgspec.json.decode(entry.provenance, type=Provenance)
    except (msgspec.DecodeError, UnicodeError) as error:  # a ValidationError is a DecodeError
        raise CheckpointError(f"{path}: its provenance cannot be read ({shortened(error)}); train it anew") from error
    if provenance.schema != SCHEMA:
        raise CheckpointError(f"{path}: has schema {provenance.schema}, this version reads {SCHEMA}; train it anew")
    if checkpoint_digest(arrays, bytes(entry.provenance)) != entry.sha256:
        raise CheckpointError(f"{path}: was changed or damaged after it was written: its digest differs; get it anew")
    bad = [name for name, value in arrays.items() if not np.isfinite(value).all()]
    if bad:
        raise CheckpointError(f"{path}: {bad[0]} has values that are not finite; train it anew")
    options, points = provenance.options, provenance.points
    if isinstance(options, EnsembleOptions):
        steps = options.positions - 1
        fits = steps > 0 and (points - 1) % steps == 0 and 0.0 < options.load < math.inf
    else:
        fits = options.points == points and options.members > 0
    if not fits:
        raise CheckpointError(f"{path}: its options do not fit faces of {points} points, or a load above 0")
    return arrays, provenance


def _read(path: Path) -> tuple[Arrays, str]:
    """All tensors, and the text of the entry."""
    foreign = f"{path}: is no checkpoint of macrofit-surrogate (safetensors; nothing else is ever loaded)"
    try:
        if path.exists():
            check_regular(path, LARGEST_FILE)
        with safetensors.safe_open(path, framework="np") as file:
            text = (file.metadata() or {}).get(ENTRY)
            if text is None:
                raise CheckpointError(f"{foreign}: its metadata do not say what it is")
            return {name: file.get_tensor(name) for name in file.keys()}, text  # noqa: SIM118  no mapping
    except FileNotFoundError:
        raise CheckpointError(f"{path}: there is no such file; macrofit-surrogate train makes one") from None
    except OutputError as error:
        raise CheckpointError(f"{foreign}: {error}") from None
    # a type that numpy does not have is an AttributeError, a TypeError or a KeyError
    except (
        OSError, safetensors.SafetensorError, ValueError, RuntimeError, AttributeError, TypeError, KeyError
    ) as error:  # fmt: skip
        raise CheckpointError(f"{foreign}, or a damaged one: {error}") from error


def _assemble(path: Path, arrays: Arrays, provenance: Provenance) -> Model:
    """The network of the provenance in torch, with the tensors in it."""
    import torch

    try:
        with torch.device("meta"):  # no memory before the shapes are known to fit
            model: Model = provenance.options.build_network()
        state = model.state_dict().items()
        expected = {name: (np.dtype(str(value.dtype)[6:]), tuple(value.shape)) for name, value in state}
    except (RuntimeError, ValueError, TypeError, IndexError, ZeroDivisionError, OverflowError) as error:
        raise CheckpointError(f"{path}: cannot be built from its options: {error}") from error
    _check_shapes(path, expected, arrays, provenance)
    model.load_state_dict({name: torch.from_numpy(np.array(value)) for name, value in arrays.items()}, assign=True)
    model.requires_grad_(False)
    return model.eval()


def _check_shapes(path: Path, expected: Shapes, arrays: Arrays, provenance: Provenance) -> None:
    """Refuse tensors that are not those of the architecture."""
    for name in sorted(expected.keys() | arrays.keys()):
        there = name in arrays and name in expected
        if not there or expected[name] != (arrays[name].dtype, arrays[name].shape):
            what = "is not in it" if name not in arrays else "does not belong to it or has another shape or type"
            raise CheckpointError(f"{path}: is no network '{provenance.architecture}': {name} {what}")


def outside_training(provenance: Provenance, **inputs: float) -> list[str]:
    """Which inputs lie outside what the network has seen, in words.

    Args:
        provenance: what the network was trained on.
        inputs: any of max_height [mm], levels, hurst_exponent, micro_friction.
    """
    findings = []
    for name, value in inputs.items():
        seen = getattr(provenance, name)
        low, high = min(seen), max(seen)
        slack = 1e-3 * (high - low)
        if not math.isfinite(value) or not low - slack <= value <= high + slack:
            findings.append(f"{name} = {value:g} is outside {low:g} ... {high:g}")
    return findings
