"""The commands on toy inputs, and the places in which they are tried."""

from __future__ import annotations

import os
import shlex
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from ._trials import ROOT, complaints

from small import small_press  # isort: skip

from macrofit.scene import dump_scene

PLATES = ("--set", "plates.spheres=600")
SYSTEM = {"PATH": os.environ.get("PATH", "/usr/bin:/bin"), "OMP_NUM_THREADS": "1", "LC_ALL": "C.UTF-8"}
"""What is left of the environment in a place without a home."""

NOWHERE = "/proc/none"
"""A folder that nobody can make, root neither."""


@dataclass(frozen=True)
class Said:
    """How a command ended."""

    code: int
    err: str

    @property
    def fault(self) -> str:
        """What is wrong with it: neither did it work, nor was it one line and code 2. Empty where nothing is."""
        lines = complaints(self.err)
        if "Traceback" in self.err:
            return "traceback"
        if self.code == 0:
            return ""
        if self.code != 2:
            return f"code {self.code}"
        return "" if len(lines) == 1 else f"{len(lines)} lines"


@dataclass(kw_only=True)
class Place:
    """Where a command is tried: variables, what a shell does before it, and words around it."""

    name: str
    more: Mapping[str, str] = field(default_factory=dict)
    bare: bool = False  # without the variables of this process
    before: str = ""  # of a shell in mounts of its own
    around: str = "{}"

    def run(self, words: Sequence[str], limit_s: float = 300.0) -> Said:
        """Run a command here and wait."""
        inner = shlex.join([sys.executable, "-m", *words])
        script = f"{self.before}\n{self.around.format(inner)}" if self.before else self.around.format(inner)
        shell = ["unshare", "-m", "bash", "-c"] if self.before else ["bash", "-c"]
        environment = (SYSTEM if self.bare else {**os.environ, "OMP_NUM_THREADS": "1"}) | dict(self.more)
        done = subprocess.run(
            [*shell, script], cwd=ROOT, env=environment, stdin=subprocess.DEVNULL, capture_output=True, text=True,
            timeout=limit_s, errors="replace",
        )  # fmt: skip
        return Said(done.returncode, done.stderr)


def commands(folder: Path, inputs: Path) -> dict[str, list[str]]:
    """Every command that writes, on inputs made by `make_inputs`, into a folder."""
    scene, database = str(inputs / "scene.toml"), str(inputs / "db.h5")
    vary = ["--vary", "friction.options.coefficient=0.1,0.2"]
    return {
        "macrofit run": ["macrofit", "run", scene, "-o", f"{folder}/run"],
        "macrofit study": ["macrofit", "study", scene, *vary, "-o", f"{folder}/study"],
        "macrofit-meso run": ["meso", "run", *PLATES, "--micro-friction", "0.05", "-o", f"{folder}/plates"],
        "macrofit-surrogate generate": [
            "surrogate", "generate", "-o", f"{folder}/new.h5", "--pairs", "1", *PLATES, "--jobs", "1",
        ],
        "macrofit-surrogate train": [
            "surrogate", "train", database, "-o", f"{folder}/net.safetensors", "--epochs", "1", "--members", "1",
        ],
        "macrofit-surrogate predict": ["surrogate", "predict", "-o", f"{folder}/faces.csv"],
    }  # fmt: skip


def make_inputs(folder: Path, *, database: bool) -> None:
    """A scene and, where it is wanted, a database to learn from."""
    (folder / "scene.toml").write_text(dump_scene(small_press(fields=True)))
    if not database:
        return
    words = ["surrogate", "generate", "-o", str(folder / "db.h5"), "--pairs", "24", *PLATES, "--quiet", "--jobs", "1"]
    said = Place(name="here").run(words)
    if said.code:
        raise SystemExit(f"the database cannot be made: {said.err}")


def places(folder: Path, target: Path) -> list[Place]:
    """All places that can be had here; ``target`` is what the commands write into."""
    nobody = {"XDG_CACHE_HOME": NOWHERE, "XDG_CONFIG_HOME": NOWHERE, "HOME": NOWHERE}
    caches = {"NUMBA_CACHE_DIR": str(folder / "numba"), "XDG_CACHE_HOME": str(folder / "cache")}
    found = [
        Place(name="no cache, no home", bare=True, more=nobody),
        Place(name="sound caches of its own", more=caches),
        *(Place(name=f"caches {how}", more=caches) for how in DAMAGE),
        Place(name="stdout closed", around="{} >&-"),
        Place(name="stdout and stderr closed", around="{} >&- 2>&-"),
        Place(name="a full disk behind stdout", around="{} >/dev/full"),
        Place(name="files of 20 kB at most", around="ulimit -f 20; {}"),
    ]
    if subprocess.run(["unshare", "-m", "true"], capture_output=True, check=False).returncode:
        return found
    bind = f"mount --bind {shlex.quote(str(ROOT))} {shlex.quote(str(ROOT))} && mount -o remount,ro,bind "
    found.append(Place(name="read-only install", bare=True, more=nobody, before=bind + shlex.quote(str(ROOT))))
    for room in ("4k", "64k", "256k", "1m"):
        mount = f"mount -t tmpfs -o size={room} none {shlex.quote(str(target))}"
        found.append(Place(name=f"a disk of {room}", before=mount))
    return found


def _turn(path: Path, rng: np.random.Generator) -> None:
    data = bytearray(path.read_bytes())
    for at in rng.integers(0, len(data), 3):
        data[at] ^= 1 << int(rng.integers(0, 8))
    path.write_bytes(bytes(data))


def _cut(path: Path, rng: np.random.Generator) -> None:
    data = path.read_bytes()
    path.write_bytes(data[: int(rng.integers(0, len(data)))])


DAMAGE: dict[str, Callable[[Path, np.random.Generator], None]] = {
    "turned in bits": _turn,
    "cut off": _cut,
    "emptied": lambda path, rng: path.write_bytes(b"") and None,
    "replaced by noise": lambda path, rng: path.write_bytes(rng.bytes(1000)) and None,
}
"""What is done to every file of the caches."""


def damage_caches(folder: Path, how: str, rng: np.random.Generator) -> int:
    """Damage what was compiled into the caches of `places`; how many files."""
    ends = {".nbi", ".nbc", ".so"}
    files = [
        path for path in sorted(folder.rglob("*")) if path.suffix in ends and path.is_file() and path.stat().st_size
    ]
    for path in files:
        path.chmod(0o755)
        DAMAGE[how](path, rng)
    return len(files)
