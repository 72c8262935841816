"""The folder of a service computation, written."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ...base.files import replacing
from ...results.folder import write_numbers
from . import FIGURE, FRETTING, HISTORIES, NUMBERS, SEAT, SURFACE
from .numbers import fretting_columns, numbers, seat_columns, sentences, write_columns

if TYPE_CHECKING:
    from ..run import Service


def write_service(folder: Path, found: Service) -> list[str]:
    """Write service.json, the tables and the figure; gives the lines for people.

    Raises:
        OutputError: a file cannot be written.
    """
    from .figures import write_figure

    told = numbers(found)
    write_columns(folder / SEAT, seat_columns(found.bonded, found.turned))
    if found.turned is not None:
        columns = fretting_columns(found.whole.fit, found.turned.fretting, found.turned.friction)
        write_columns(folder / FRETTING, {name: np.asarray(column) for name, column in columns.items()})
        from .surface import surface_mesh

        with replacing(folder / SURFACE) as draft:
            surface_mesh(found.whole, found.turned).write(draft, file_format="vtu")
    if found.moments:
        from .histories import write_histories

        write_histories(folder / HISTORIES, found)
    write_figure(folder / FIGURE, found)
    write_numbers(folder / NUMBERS, told)
    return sentences(told)
