"""What does a run compute, import and write that its scene does not need?

    python -m tests.benchmarks skipping

Each built-in scene, and some variants, is run as `macrofit run` does it, in a process of its own with warm caches. Each
cell is what was counted over what the scene needs, by the rules below the table. Counts are the same on any machine.
"""

from __future__ import annotations

import argparse
import csv
import json
import os
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from ._measure import head, row

ROOT = Path(__file__).parents[2]
PROFILE = "measured_profile.csv"  # written where the run is
PROFILE_TEXT = "z_mm,deviation_um\n0,0\n60,4\n120,-3\n180,0\n"
SHORT_PLATES = ("motion.travel=4", "friction.options.plates.spheres=600")  # a pair of plates takes up to a second
VARIANTS = {
    "wheelset, no stress": ("wheelset", "output.stress=false"),
    "wheelset, curve only": ("wheelset", "output.stress=false", "output.fields_at=[]"),
    "wheelset, frictionless": ("wheelset", "friction.options.coefficient=0"),
    "wheelset, let go": ("wheelset", "motion.release=true"),
    "wheelset, shrunk": ("wheelset", "wheel.temperature=120", "motion.cooling=10"),
    "wheelset, profile": ("wheelset", f"axle.profile={PROFILE}"),
    "wheelset, never yields": ("wheelset", "axle.material.yield_stress=9000", "wheel.material.yield_stress=9000"),
    "wheelset, network": ("wheelset", "friction.provider=surrogate", "friction.options={}", "motion.travel=20"),
}
QUICK = {
    "wheelset, coarse": (
        "wheelset",
        "mesh.seat_facet=4",
        "motion.travel=40",
        "motion.increment=5",
        "output.stress=false",
    )
}
PACKAGES = (
    "gmsh", "meshio", "rich", "h5py", "matplotlib", "numba", "torch", "safetensors", "pandas", "meso", "surrogate",
    "macrofit.plasticity.kernels", "macrofit.report",
    "macrofit.contact.monolithic", "macrofit.lockstep.solve", "macrofit.study.run", "macrofit.identify.fit",
    "macrofit.friction.table",
)  # fmt: skip
RULES = {
    "meshes": "one per drawn body",
    "drawings meshed": "by gmsh: none, for meshes are kept",
    "body factorisations": "one per body to condense it; one more where stresses or fields are asked for (that of "
    "condensing keeps the contact line apart: to solve with it costs what another one does)",
    "back substitutions": "one per body and increment in contact where stress is asked for, otherwise per field "
    "written; one at least; where steel may yield but never does, one more per body and increment, to see that",
    "stress evaluations": "the same",
    "interface factorisations": "one for each set of open, sticking and slipping moments met within an increment",
    "tangential rows": "of the influence: in increments where something sticks",
    "provider calls": "one for a uniform coefficient, otherwise at most one per increment",
    "pairs asked": "each pair of tiles once; one for a uniform coefficient",
    "compilations": "of forms and kernels: none with warm caches",
    "packages": f"of {', '.join(PACKAGES)}: meshio (and rich with it) where a mesh is "
    "read or fields are written, h5py and matplotlib for the files of any run, numba and meso for plates, numba for "
    "steel that yields, safetensors, meso and surrogate for the network",
    "files": "scene.toml, journal.bin, fitting_curve.csv and .png, summary.json, interface.h5; interface.png where "
    "there is contact, friction.png where pairs differ, two stress figures and fields/ where fields are asked for",
}


def probe(folder: Path, scene: str, *overrides: str) -> dict[str, Any]:
    """Run a scene in this process as the command does; what was counted, imported and written, and what was met."""
    from macrofit import stress
    from macrofit.bodies import body, mesh
    from macrofit.cli import main as macrofit
    from macrofit.contact import condensed

    counted: Counter[str] = Counter()

    def watched(owner: Any, name: str, note: Callable[..., None]) -> None:
        original = getattr(owner, name)

        def stand_in(*given: Any, **named: Any) -> Any:
            note(*given)
            return original(*given, **named)

        setattr(owner, name, stand_in)

    statuses: dict[int, tuple[Any, Any]] = {}  # of each problem, which is kept so that its id stays its own
    sticking: set[int] = set()

    def solved(problem: Any, status: Any, *_: Any) -> None:
        _, before = statuses.get(id(problem), (None, None))
        if status.kind.any() and (before is None or not before.same(status)):
            counted["statuses met"] += 1
        if (status.kind == condensed.STICK).any():
            sticking.add(id(problem))
        statuses[id(problem)] = (problem, status)

    def influenced(_engine: Any, _facing: Any, component: int, *_: Any) -> None:
        counted["tangential rows"] += component

    from ffcx.codegeneration import jit

    watched(body, "mesh_drawing", lambda *_: counted.update({"meshes": 1}))
    watched(mesh, "_meshed", lambda *_: counted.update({"drawings meshed": 1}))
    watched(stress.StressEvaluator, "stress", lambda _, u: counted.update({"stress evaluations": u.shape[1]}))
    watched(condensed.CondensedProblem, "solve", solved)
    watched(condensed.Condensed, "influence", influenced)
    watched(jit, "_compile_objects", lambda *_: counted.update({"compilations": 1}))
    words = ["run", scene, "-o", str(folder), "--quiet", *(f"--set={override}" for override in overrides)]
    macrofit(words, standalone_mode=False)
    for module in [module for name, module in sys.modules.items() if name.startswith("meso.")]:
        dispatchers = [value for value in vars(module).values() if type(value).__name__ == "CPUDispatcher"]
        counted["compilations"] += sum(sum(each.stats.cache_misses.values()) for each in dispatchers)
    counted["sticking problems"] = len(sticking)
    return {"counted": counted, "packages": [name for name in PACKAGES if name in sys.modules]}


def needed(folder: Path, summary: dict[str, Any], counted: dict[str, int]) -> dict[str, Any]:
    """What the scene needs by RULES, from its resolved keys and what the run met."""
    import tomllib

    scene = tomllib.loads((folder / "scene.toml").read_text())
    with (folder / "fitting_curve.csv").open() as file:
        touching = [float(line["normal_force_N"]) > 0.0 for line in csv.DictReader(file)]
    output, provider = scene["output"], scene["friction"]["provider"]
    drawn = sum(name not in scene["mesh"] for name in ("axle", "wheel"))
    fields = sum(1 for _ in (folder / "fields").glob("axle_*.vtu"))
    displaced = 2 * max(sum(touching) if output["stress"] else fields, 1 if output["stress"] else 0)
    files = ["scene.toml", "journal.bin", "fitting_curve.csv", "fitting_curve.png", "summary.json", "interface.h5"]
    files += ["interface.png"] * any(touching) + ["friction.png"] * (provider != "uniform")
    files += ["stress.png", "stress_entrance.png", "fields"] * bool(fields)
    packages = {"h5py", "matplotlib"}
    packages |= {"meshio", "rich"} if drawn < 2 or fields else set()
    packages |= {"dem": {"numba", "meso"}, "surrogate": {"safetensors", "meso", "surrogate"}}.get(provider, set())
    may_yield = "yield_stress" in scene["axle"].get("material", {})
    packages |= {"numba", "macrofit.plasticity.kernels"} if may_yield else set()
    return {
        "meshes": drawn,
        "drawings meshed": 0,
        "body factorisations": 4 if displaced else 2,
        "back substitutions": displaced + may_yield * 2 * sum(touching),
        "stress evaluations": displaced,
        "interface factorisations": counted.get("statuses met", 0),
        "tangential rows": counted["sticking problems"],
        "provider calls": 1 if provider == "uniform" else len(touching),
        "pairs asked": 1 if provider == "uniform" else pairs(folder),
        "compilations": 0,
        "packages": packages,
        "files": set(files),
    }


def pairs(folder: Path) -> int:
    """Number of pairs of tiles the run met."""
    import h5py

    with h5py.File(folder / "interface.h5") as file:
        return len(file["pairs/seat"]) if "pairs" in file else 0


def compared(name: str, words: Sequence[str]) -> tuple[list[str], list[str]]:
    """The cells of a scene's row, and sentences on what is superfluous."""
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place) / "run"
        (Path(place) / PROFILE).write_text(PROFILE_TEXT)
        words = [word.replace(PROFILE, str(Path(place) / PROFILE)) for word in words]
        done = subprocess.run(
            [sys.executable, "-m", "tests.benchmarks.skipping", str(folder), *words], cwd=ROOT,
            env=os.environ | {"PYTHONPATH": str(ROOT)}, stdin=subprocess.DEVNULL, capture_output=True, text=True,
            check=False,
        )  # fmt: skip
        if done.returncode:
            raise RuntimeError(f"{name}: {done.stderr[-2000:]}")
        found = json.loads(done.stdout.splitlines()[-1])
        summary = json.loads((folder / "summary.json").read_text())
        wanted = needed(folder, summary, found["counted"])
        written = {path.name for path in folder.iterdir()}
    counters = summary["counters"]
    computed = found["counted"] | {
        "body factorisations": counters["factorisations"],
        "packages": set(found["packages"]),
        "files": written,
    } | {key.replace("_", " "): counters[key] for key in
         ("back_substitutions", "interface_factorisations", "provider_calls", "pairs_asked")}  # fmt: skip
    cells, superfluous = [name], []
    for rule in RULES:
        has, wants = computed.get(rule, 0), wanted[rule]
        extra = sorted(has - wants) if isinstance(has, set) else has > wants
        cells.append(f"{len(has)} / {len(wants)}" if isinstance(has, set) else f"{has} / {wants}")
        if extra:
            cells[-1] = f"**{cells[-1]}**"
            listed = ", ".join(extra) if isinstance(extra, list) else f"{has - wants} of {has}"
            superfluous.append(f"{name}: {rule}: {listed}")
    return cells, superfluous


def main(words: Sequence[str]) -> int:
    """Print a row per scene and the rules; 1 where something superfluous was done."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks skipping", description=__doc__)
    parser.add_argument("--quick", action="store_true", help="one small scene")
    options = parser.parse_args(words)
    from macrofit.scene import scene_names

    cases: dict[str, tuple[str, ...]] = dict(QUICK)
    if not options.quick:
        cases = {name: (name, *SHORT_PLATES) if name == "rough-hub" else (name,) for name in scene_names()} | VARIANTS
    print(head("scene", *RULES))
    superfluous: list[str] = []
    for name, case in cases.items():
        cells, extra = compared(name, case)
        if extra or name in ("rough-hub", "wheelset, network"):  # the caches are warm now
            cells, extra = compared(name, case)
        print(row(*cells), flush=True)
        superfluous += extra
    print(f"\n{head('count', 'needed')}")
    for rule, text in RULES.items():
        print(row(rule, text))
    print("\nSuperfluous: " + ("; ".join(superfluous) or "nothing") + ".")
    return int(bool(superfluous))


if __name__ == "__main__":
    print(json.dumps(probe(Path(sys.argv[1]), *sys.argv[2:])))
