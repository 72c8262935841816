"""Fill a database with friction tests of rough plates.

    design = Design(max_height=(0.005, 0.04))
    settings = plate_settings(["plates.spheres=3000"])
    generate_samples(Path("train.h5"), design, settings, pairs=1000, farm=ProcessFarm(2))

Sample `id` = packings x pair + packing. A sample depends on its place in the design alone, so whatever is killed goes
on with the same call, by any number of workers.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from macrofit.base.farm import Farm

from .database import open_database, require_samples
from .design import Design
from .monitor import FarmMonitor, Silent
from .sample import Result, design_tasks, header_of, simulate

if TYPE_CHECKING:
    from meso.settings import Settings


def generate_samples(
    path: Path, design: Design, settings: Settings, pairs: int, farm: Farm, monitor: FarmMonitor | None = None
) -> None:
    """Add to a database what it lacks of the first pairs of a design.

    A sample that failed before is not tried again.

    Args:
        path: the database, new or begun before.
        design: which samples there are.
        settings: settings of the plates.
        pairs: how many pairs of the design, from the first.
        farm: who computes.
        monitor: told about samples as they end.

    Raises:
        DesignError: the design asks for what cannot be.
        DatabaseError: see `open_database`; or every sample failed, which the database keeps.
        FarmError: a process of the farm was killed.
    """
    monitor = monitor or Silent()
    header = header_of(design, settings)
    tasks = list(design_tasks(design, settings, pairs, header))
    with open_database(path, header) as (writer, done):
        ahead = [task for task in tasks if task.id not in done]
        monitor.started(len(tasks), len(tasks) - len(ahead))

        def accept(result: Result) -> None:
            if result.reason:
                writer.fail(result.id, result.reason)
            else:
                writer.append(result.row)
            monitor.advanced(failed=bool(result.reason))

        try:
            farm.run(ahead, simulate, accept)
        finally:
            monitor.finished()
    require_samples(path)
