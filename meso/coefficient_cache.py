"""Meso coefficients, computed once: one small JSON file for each pair of surfaces, readable without this package.

    FOLDER/coefficients/<hash of settings and code>/<axle_seed>/<wheel_seed>-<hash of the packing seeds>.json

`CoefficientCache` says what makes a new file.
"""

from __future__ import annotations

import functools
import hashlib
import warnings
from pathlib import Path

import msgspec

from macrofit.base.files import replacing
from macrofit.base.provenance import code_hash, version

from .errors import MesoError, OutputError
from .settings import Settings

PACKAGE = Path(__file__).parent


class Entry(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """What a friction test of one pair of surfaces came to, with all it was made from."""

    coefficient: float
    """Mean T over mean N [-], as it came out; it may be below 0."""
    uncertainty: float
    """Its standard error along the slide [-]."""
    mean_normal: float
    """Mean N over the slide [N]."""
    mean_tangential: float
    """Mean T over the slide [N]."""
    engine: str
    """The engine that answered."""
    remark: str
    """Why another engine than the one asked for, or another load, if so."""
    imbalance: float
    """Share of the work that is unaccounted for [-]."""
    unconverged_increments: int
    largest_residual: float
    """Over the largest contact force [-]."""
    settings: Settings
    """Settings of the test, with the seeds of both surfaces."""
    code: str
    """As `code` gave it."""
    version: str
    """Version of the package."""


class _File(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    sha256: str  # of the entry's text
    entry: msgspec.Raw


class CoefficientCache:
    """The entries that share all settings but the seeds of surfaces and packings.

    A file's place depends on every setting, on the code that computes and on the version of the package; not on
    the libraries and the processor, which move a coefficient by rounding. What is damaged is computed again, and a
    folder that cannot be written is done without; both are told in a warning. Processes may share a folder.

    Args:
        folder: where everything costly is kept.
        settings: of the tests; the seeds of surfaces and packings do not matter.
    """

    def __init__(self, folder: Path, settings: Settings) -> None:
        self.folder = folder / "coefficients" / fingerprint(settings)
        self._unwritable = False

    def file(self, settings: Settings) -> Path:
        """Where the entry of these settings is kept."""
        surface, plates = settings.surface, settings.plates
        packings = hashlib.sha256(f"{plates.packing_seed} {plates.axle_packing_seed}".encode()).hexdigest()[:8]
        return self.folder / str(surface.axle_seed) / f"{surface.wheel_seed}-{packings}.json"

    def find(self, settings: Settings) -> Entry | None:
        """The entry of these settings; None where there is none that can be trusted."""
        file = self.file(settings)
        try:
            entry = _decoded(file.read_bytes())
            if entry.settings != settings or entry.code != code():
                raise ValueError("it is the entry of another test")
        except FileNotFoundError:
            return None
        except OSError as error:
            warnings.warn(f"{file} cannot be read and is computed again: {error.strerror}", stacklevel=2)
            return None
        except (ValueError, MesoError) as error:  # msgspec's errors are ValueErrors
            warnings.warn(f"{file} is damaged and is computed again: {error}", stacklevel=2)
            return None
        return entry

    def keep(self, entry: Entry) -> None:
        """Store an entry; a failure is told once."""
        try:
            with replacing(self.file(entry.settings)) as draft:
                draft.write_bytes(_encoded(entry))
        except OutputError as error:
            if not self._unwritable:
                warnings.warn(f"coefficients are not kept: {error}", stacklevel=2)
            self._unwritable = True


def fingerprint(settings: Settings) -> str:
    """Hash of all settings but title and seeds, of the code and of the package's version."""
    surface = msgspec.structs.replace(settings.surface, wheel_seed=0, axle_seed=0)
    plates = msgspec.structs.replace(settings.plates, packing_seed=0, axle_packing_seed=None)
    shared = msgspec.structs.replace(settings, surface=surface, plates=plates).fingerprint
    return hashlib.sha256(f"{shared} {code()} {version()}".encode()).hexdigest()[:20]


@functools.lru_cache(maxsize=2)
def code(module: str = "meso.provider") -> str:
    """Hash of the calibrations, and of the sources of all modules that a coefficient, or ``module``, goes through."""
    return code_hash(PACKAGE, module)


def _encoded(entry: Entry) -> bytes:
    text = msgspec.json.format(msgspec.json.encode(entry), indent=1)
    return b'{"sha256": "' + hashlib.sha256(text).hexdigest().encode() + b'",\n"entry": ' + text + b"}\n"


def _decoded(data: bytes) -> Entry:
    """The entry in a file; raises ValueError (msgspec's among them) or MesoError where it is not whole."""
    file = msgspec.json.decode(data, type=_File)
    text = bytes(file.entry)
    if hashlib.sha256(text).hexdigest() != file.sha256:
        raise ValueError("its checksum is wrong")
    return msgspec.json.decode(text, type=Entry)
