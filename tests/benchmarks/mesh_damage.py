"""What does the reader of meshes do with damaged files?

    python -m tests.benchmarks mesh_damage

Sound files of a wheel and of a ring (gmsh 2.2 and 4.1, VTK, decks of Abaqus in their dialects) are damaged by chance:
bits turned, files cut, pieces lost or doubled, numbers replaced by odd ones, noise. Each case is told by its seed and
number. A file that is still read must be a sound mesh; its area and the lengths of its bore and of its pushed face tell
whether a point, an element or a member of a set was lost. What is left may be a mesh that could be meant: then it is
computed, with a doubt.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from macrofit.base.arrays import FloatArray
from macrofit.bodies.mesh import MeshData, read_mesh
from macrofit.bodies.triangles import doubled_area
from macrofit.errors import MeshError

from ._measure import head, row

KINDS = ("refused", "read, within 0.1 %", "read otherwise, doubtful", "read otherwise, without a word")
ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / "tests"))

from damaged import check_sound, damage, sound_files  # noqa: E402


def area(data: MeshData) -> float:
    """Area of a mesh [mm2]."""
    return 0.5 * float(np.abs(doubled_area(data.points, data.triangles)).sum())


def sizes(data: MeshData) -> FloatArray:
    """Area [mm2], and lengths of bore and pushed face [mm]."""
    ends = [data.points[data.edges[name]] for name in ("bore", "pushed")]
    return np.array([area(data), *(np.linalg.norm(pair[:, 1] - pair[:, 0], axis=1).sum() for pair in ends)])


def judged(broken: Path, wanted: FloatArray) -> str:
    """What became of a damaged file."""
    try:
        data = read_mesh(str(broken), "wheel")
        check_sound(data)
    except MeshError as error:
        return "refused" if "\n" not in str(error) else "refused in many lines"
    except Exception as error:
        return f"traceback ({type(error).__name__})"
    if np.abs(sizes(data) / wanted - 1.0).max() < 1e-3:
        return KINDS[1]
    return KINDS[2] if data.oddities else KINDS[3]


def main(words: Sequence[str]) -> int:
    """Print a row per format."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks mesh_damage", description=__doc__)
    parser.add_argument("--quick", action="store_true", help="200 cases")
    parser.add_argument("--cases", type=int, default=5000)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args(words)
    cases = 200 if options.quick else options.cases
    found: dict[str, Counter[str]] = {}
    slowest: Counter[str] = Counter()
    with tempfile.TemporaryDirectory() as folder:
        files = sound_files(Path(folder), ROOT / "meshes")
        wanted = {path: sizes(read_mesh(str(path), "wheel")) for path in files}
        for case in range(cases):
            path = files[case % len(files)]
            broken = Path(folder) / f"broken{path.suffix}"
            broken.write_bytes(damage(path.read_bytes(), np.random.default_rng([options.seed, case])))
            started = time.perf_counter()
            said = judged(broken, wanted[path])
            slowest[path.suffix] = max(slowest[path.suffix], time.perf_counter() - started)  # type: ignore[assignment]
            found.setdefault(path.suffix, Counter())[said] += 1
            if said.startswith("traceback") or said == KINDS[3]:
                print(f"case {case} of seed {options.seed}, {path.name}: {said}", file=sys.stderr)
    print(head("format", "cases", *KINDS, "tracebacks", "slowest s"))
    for suffix, count in sorted(found.items()):
        rest = count.total() - sum(count[kind] for kind in KINDS)
        print(row(suffix, count.total(), *(count[kind] for kind in KINDS), rest, f"{slowest[suffix]:.2g}"))
    print(f"\nSeed {options.seed}.")
    return 0
