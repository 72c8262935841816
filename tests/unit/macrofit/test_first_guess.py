"""Where Newton's method starts: the front of contact follows the bore by moments, not by whole facets."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from macrofit.contact.interface import couple_lines
from macrofit.contact.status import OPEN, SLIP
from tests.small import condensed_press, small_press


@pytest.mark.parametrize("moment", [0, 1])
def test_contact_goes_on_by_moments(moment: int) -> None:
    """One moment was in contact; a motion of one facet puts its point on the same moment of the next facet alone."""
    press, _ = condensed_press(small_press())
    line = press.seat.line
    facet, facets = line.facets // 4, np.zeros((line.facets, 2), dtype=np.int64)
    kind, pressure = facets.copy(), facets[:, 0].astype(np.float64)
    kind[facet, moment], pressure[facet] = SLIP, 100.0
    moved = float(line.coordinate[facet + 1] - line.coordinate[facet])
    start = 60.0
    state = replace(press.rest(), displacement=start, direction=1.0, kind=kind, sign=kind // SLIP, pressure=pressure)
    coupling = couple_lines(line, press.bore, start + moved)
    assert coupling is not None
    covered = press.seat.cover(coupling.portions)
    posed = press.pose(state, start + moved, coupling, covered, np.full(line.facets, 0.11))
    found = np.zeros((line.facets, 2), dtype=np.int64)
    found[coupling.portions.facet] = posed.status.kind.reshape(-1, 2)
    wanted = kind.copy()
    wanted[facet + 1, moment] = SLIP
    assert facet in coupling.portions.facet
    assert np.array_equal(found, wanted)
    assert (posed.status.sign[posed.status.kind == OPEN] == 0).all()


def test_few_increments_find_their_front_by_trial() -> None:
    """Of thirty increments of 1 mm most start from the status they end with: 1.5 factorisations each, not 2.2."""
    press, _ = condensed_press(
        small_press("mesh.seat_facet=2", "motion.start=60", "motion.travel=90", "motion.increment=1")
    )
    found = [record for record, _ in press.increments(press.rest())]
    assert press.engine.factorisations <= 1.7 * len(found)
