"""Solutions by parts of the kept factor against whole ones."""

from __future__ import annotations

import numpy as np
import pytest
from mpi4py import MPI
from small import small_press

from macrofit.assembly import discretise_bodies
from macrofit.bodies.body import Body
from macrofit.plasticity.substitution import Substitution


@pytest.fixture(scope="module")
def body() -> Body:
    return discretise_bodies(small_press(), MPI.COMM_SELF)["axle"]


def test_a_part_gives_what_the_whole_gives(body: Body) -> None:
    """A load on a few unknowns, displacements of a few others: less of the factor, the same numbers."""
    kept, load = Substitution(body.kept_factor), np.zeros(body.dofs)
    loaded = np.setdiff1d(np.arange(40, 60), np.flatnonzero(body.supported))
    load[loaded] = np.random.default_rng(1).normal(size=len(loaded))
    exact = body.solve(load[:, None])[:, 0]
    part, wanted = kept.reached(loaded), kept.reached(body.trace_dofs)
    assert len(part) < len(kept.everything) / 2
    y = kept.forward(load, part)
    found = kept.backward(y, wanted)
    assert found[body.trace_dofs] == pytest.approx(exact[body.trace_dofs], rel=0, abs=1e-12 * np.abs(exact).max())
    assert kept.backward(y, kept.everything) == pytest.approx(exact, rel=0, abs=1e-12 * np.abs(exact).max())


def test_halves_add_up(body: Body) -> None:
    """What one load leaves of the first half of a solution serves another: L^-1 is linear."""
    kept, rng = Substitution(body.kept_factor), np.random.default_rng(2)
    first, second = (np.where(body.supported.ravel(), 0.0, rng.normal(size=body.dofs)) for _ in range(2))
    y = kept.forward(first, kept.everything) + kept.forward(second, kept.everything)
    exact = body.solve((first + second)[:, None])[:, 0]
    assert kept.backward(y, kept.everything) == pytest.approx(exact, rel=0, abs=1e-12 * np.abs(exact).max())
