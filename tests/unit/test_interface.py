"""Moments over segments: their basis, and what they integrate exactly."""

from __future__ import annotations

import numpy as np
import pytest
from small import condensed_press, small_press

from macrofit.interface import pair
from macrofit.moments import portions_of, quadrature


@pytest.mark.parametrize("order", [1, 2])
def test_basis_is_orthogonal_in_the_ring_measure(order: int) -> None:
    """int phi_i phi_j 2 pi r ds = W_i delta_ij on whole and partly covered facets, sloping ones included."""
    press, _ = condensed_press(small_press(f"mesh.order={order}"))
    pairing = pair(press.seat.line, press.bore, 43.3)
    assert pairing is not None
    portions = pairing.portions
    index = np.arange(len(portions.facet))
    s, which, test = quadrature(press.seat.line, portions, index, portions.start, portions.end)
    values = portions.basis(which, s) * portions.weight[which]
    count, n = portions.weight.shape
    gram = np.zeros((count, n, n))
    np.add.at(gram, which, test[:, :, None] * values[:, None, :])
    assert gram == pytest.approx(np.broadcast_to(np.eye(n), gram.shape), abs=1e-13)


def test_weights_add_up_to_the_area() -> None:
    """The area of a cone frustum, pi (r0 + r1) times its slant height, is split among the moments."""
    press, _ = condensed_press(small_press())
    line = press.seat.line
    s = line.coordinate
    portions = portions_of(line, np.arange(line.facets), s[:-1], s[1:])
    frustum = np.pi * (line.radius[1:] + line.radius[:-1]) * line.length
    assert portions.weight.sum(axis=1) == pytest.approx(frustum, rel=1e-14)


@pytest.mark.parametrize("travel", [0.3, 12.34, 59.9, 200.1, 350.0])
def test_linear_fields_face_each_other(travel: float) -> None:
    """A displacement linear in z has the same moments from either line, whatever the cut of the facets."""
    press, _ = condensed_press(small_press())
    pairing = pair(press.seat.line, press.bore, travel)
    assert pairing is not None
    covered = press.seat.cover(pairing.portions)

    def linear(nodes: np.ndarray, shift: float) -> np.ndarray:
        z = nodes[:, 1] + shift
        return np.concatenate([1.0 + 0.01 * z, 2.0 - 0.02 * z])

    seat = covered.seat_moments(linear(press.seat.line.nodes, 0.0))
    bore = pairing.bore_moments(linear(press.bore.nodes, travel))
    assert seat == pytest.approx(bore, abs=1e-12)


def test_no_overlap() -> None:
    press, _ = condensed_press(small_press())
    assert pair(press.seat.line, press.bore, -10.0) is None
    assert pair(press.seat.line, press.bore, 1000.0) is None
    assert pair(press.seat.line, press.bore, -9.999) is not None
