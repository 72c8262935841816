"""What a command loads, and in which order: nothing that its scene does not ask for."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from benchmarks.startup import imports
from benchmarks.verification import worst
from found import Figures, Found
from unit.test_imports import loaded_by, run_help

from macrofit.base.caches import RANKS

ORDER = """
import json, sys
from macrofit.cli import main
try:
    main(["run", "contact-patch", "-o", sys.argv[1], "--quiet"], standalone_mode=False)
finally:
    print("\\n" + json.dumps(list(sys.modules)))
"""
HANDLER = """
import signal
from macrofit.cli.commands import import_mesher
signal.signal(signal.SIGINT, lambda *_: None)
before = signal.getsignal(signal.SIGINT)
import_mesher()
print(signal.getsignal(signal.SIGINT) is before)
"""


def said(code: str, *words: str) -> str:
    """The last line that a fresh interpreter prints."""
    done = subprocess.run(
        [sys.executable, "-c", code, *words],
        env=dict(os.environ),  # without what MPI adds to it in this process
        stdin=subprocess.DEVNULL, capture_output=True, text=True, check=True,
    )  # fmt: skip
    return done.stdout.splitlines()[-1]


def test_help_loads_no_arrays() -> None:
    assert not loaded_by(run_help("macrofit")) & {"numpy", "msgspec", "rich"}


def test_a_run_loads_what_its_scene_asks_for(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Neither network nor plates for a uniform coefficient; gmsh first, which loads slower after dolfinx."""
    monkeypatch.setenv("MACROFIT_CACHE", str(tmp_path / "cache"))
    loaded = json.loads(said(ORDER, str(tmp_path / "run")))
    assert {"gmsh", "dolfinx", "h5py"} <= set(loaded)
    assert loaded.index("gmsh") < loaded.index("dolfinx")
    unasked = {
        "torch",
        "numba",
        "meso",
        "surrogate",
        "macrofit.contact.monolithic",
        "macrofit.study.run",
        "macrofit.identify.fit",
    }
    unasked |= {"pkg_resources"}  # nobody asks for a version
    assert not unasked & set(loaded)
    again = json.loads(said(ORDER, str(tmp_path / "again")))
    assert not {"gmsh", "dolfinx", "petsc4py", "ufl"} & set(again)  # its meshes and their stiffness are kept
    first, second = ((tmp_path / name / "journal.bin").read_bytes() for name in ("run", "again"))
    assert len(first) == len(second)
    curves = [(tmp_path / name / "fitting_curve.csv").read_text().splitlines() for name in ("run", "again")]
    without_time = [[line.rpartition(",")[0] for line in lines] for lines in curves]
    assert without_time[0] == without_time[1]


@pytest.mark.parametrize("launched", [False, True])
def test_alone_mpi_looks_for_no_networks(monkeypatch: pytest.MonkeyPatch, launched: bool) -> None:
    """To find that there are none takes 0.2 s; ranks may need them, and what a user has set stays."""
    for name in [*RANKS, *(name for name in os.environ if name.startswith(("OMPI_", "PMIX_", "PMI_")))]:
        monkeypatch.delenv(name, raising=False)
    if launched:
        monkeypatch.setenv("PMIX_RANK", "0")
    code = "import os\nfrom macrofit.cli import main\nmain(['scenes'], standalone_mode=False)\n"
    code += "print(os.environ.get('OMPI_MCA_mtl'), os.environ.get('OMPI_MCA_ess_singleton_isolated'))"
    assert said(code) == ("None None" if launched else "^psm,psm2,ofi 1")
    monkeypatch.setenv("OMPI_MCA_mtl", "ofi")
    assert said(code).startswith("ofi")


def test_nothing_is_looked_through_when_a_command_ends() -> None:
    """Python would collect garbage among all objects three times: a sixth of a short run."""
    code = "import atexit, gc\natexit.register(lambda: print(gc.get_freeze_count() > 1000))\n"
    assert said(code + "from macrofit.cli import main\nmain(['scenes'], standalone_mode=False)") == "True"


def test_loading_the_mesher_leaves_ctrl_c() -> None:
    assert said(HANDLER) == "True"
    assert signal.getsignal(signal.SIGINT) is not signal.SIG_DFL


def test_imports_are_summed_by_package() -> None:
    text = "import time:      1500 |      9000 | numpy.core\nimport time:       500 |  100 |   numpy\nother words\n"
    text += "import time:      7000 |      7000 |     gmsh\n"
    assert imports(text) == (3, [("gmsh", 7.0), ("numpy", 2.0)])


def test_found_keeps_what_it_was_told(tmp_path: Path) -> None:
    figures, properties = Figures(), [("another", 3)]
    found = Found("tests/test_a.py::test_b[1]", properties)
    assert found("error", 0.5, 1.0)
    assert not found("error", 2.0, 1.0)
    assert not found("error", float("nan"), 1.0)
    assert found("rate", 2.0, 1.9, at_least=True)
    assert not found("rate", 1.5, 1.9, at_least=True)
    figures.take(properties)
    figures.write(tmp_path / "figures.json")
    written = json.loads((tmp_path / "figures.json").read_text())
    assert written[1] == {
        "what": "error", "value": 2.0, "bar": 1.0, "at_least": False, "test": "tests/test_a.py::test_b[1]"
    }  # fmt: skip
    kept = [figure for figure in written if figure["value"] == figure["value"]]
    assert [(figure["what"], figure["value"], count) for figure, count in worst(kept)] == [
        ("error", 2.0, 2), ("rate", 1.5, 2),
    ]  # fmt: skip


TABLES = """
import sys
{first}
from macrofit.base.figure import figure_class
Figure = figure_class()
from matplotlib.artist import Artist, kwdoc
from matplotlib.lines import Line2D
Figure().add_subplot().plot([1.0], [2.0])[0].set(lw=3.0)
print("linewidth" in (Line2D.set.__doc__ or ""), "linewidth" in kwdoc(Line2D))
"""


def test_matplotlib_keeps_its_tables_where_somebody_may_read_them() -> None:
    assert said(TABLES.format(first="")) == "False True"
    assert said(TABLES.format(first="sys.ps1 = '>>> '")) == "True True"
    assert said(TABLES.format(first="import matplotlib.lines")) == "True True"


SETTINGS = """
import os, sys
os.chdir(sys.argv[1])
from macrofit.base.figure import figure_class
figure_class()
import matplotlib
print(matplotlib.rcParams["text.usetex"], matplotlib.rcParams["font.size"])
"""


def test_figures_do_not_depend_on_the_settings_of_other_figures(tmp_path: Path) -> None:
    """A matplotlibrc that asks for a TeX that is not there was a traceback at the end of a run."""
    (tmp_path / "matplotlibrc").write_text("text.usetex: True\nfont.size: 22\n")
    assert said(SETTINGS, str(tmp_path)) == "False 10.0"


def test_names_of_files_need_not_be_utf_8(tmp_path: Path) -> None:
    """Of an old disk, say; dolfinx read the words of the command as its own, and failed on them."""
    folder = os.fsencode(tmp_path) + b"/l\xe9"
    command = [sys.executable, "-m", "macrofit", "run", "contact-patch", "--quiet", "-o", folder]
    done = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert "udce9" in json.loads(Path(os.fsdecode(folder), "summary.json").read_text())["provenance"]["command"]


def test_a_value_that_is_not_utf_8_is_a_line(tmp_path: Path) -> None:
    words = [sys.executable, "-m", "macrofit", "run", "wheelset", "-o", tmp_path / "run", "--set", b'title="\xe9"']
    done = subprocess.run(words, stdin=subprocess.DEVNULL, capture_output=True)
    assert done.returncode == 2
    assert done.stderr.count(b"\n") == 1
    assert b"not UTF-8" in done.stderr
