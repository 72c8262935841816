"""What a program needs that is started by a test, alone or under an mpirun of its own."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path
from typing import Protocol

LAUNCHER_VARIABLES = ("OMPI_COMM_WORLD_", "OMPI_UNIVERSE_", "ORTE_", "PRTE_", "PMIX_", "PMI_")
"""Beginnings of the variables that mpirun hands to its ranks."""


class Mpirun(Protocol):
    """Run `python *arguments` on some ranks and wait, but not for ever."""

    def __call__(
        self, ranks: int, *arguments: str | Path, timeout: float = 60.0, cwd: Path | None = None
    ) -> subprocess.CompletedProcess[str]: ...


def alone() -> dict[str, str]:
    """The environment without what an mpirun around the tests has put there."""
    return {k: v for k, v in os.environ.items() if not k.startswith(LAUNCHER_VARIABLES)}


def launcher_environment() -> dict[str, str]:
    """For an mpirun started here: as root, on fewer cores than ranks, one thread each; Open MPI 4 and 5."""
    return alone() | {
        "OMPI_ALLOW_RUN_AS_ROOT": "1",
        "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1",
        "OMPI_MCA_hwloc_base_binding_policy": "none",
        "OMPI_MCA_rmaps_base_oversubscribe": "1",
        "PRTE_MCA_hwloc_default_binding_policy": "none",
        "PRTE_MCA_rmaps_default_mapping_policy": ":oversubscribe",
        "OMP_NUM_THREADS": "1",
        "NUMBA_NUM_THREADS": "1",
    }
