"""Moments over segments: their basis, and what they integrate exactly."""

from __future__ import annotations

import numpy as np
import pytest
from small import condensed_press, small_press

from macrofit.contact.interface import couple_lines, open_gap
from macrofit.contact.moments import covered_facets, quadrature
from macrofit.press import REACH, Press
from macrofit.scene import build_scene


@pytest.mark.parametrize("order", [1, 2])
def test_basis_is_orthogonal_in_the_ring_measure(order: int) -> None:
    """int phi_i phi_j 2 pi r ds = W_i delta_ij on whole and partly covered facets, sloping ones included."""
    press, _ = condensed_press(small_press(f"mesh.order={order}"))
    pairing = couple_lines(press.seat.line, press.bore, 43.3)
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
    portions = covered_facets(line, np.arange(line.facets), s[:-1], s[1:])
    frustum = np.pi * (line.radius[1:] + line.radius[:-1]) * line.length
    assert portions.weight.sum(axis=1) == pytest.approx(frustum, rel=1e-14)


@pytest.mark.parametrize("travel", [0.3, 12.34, 59.9, 200.1, 350.0])
def test_linear_fields_face_each_other(travel: float) -> None:
    """A displacement linear in z has the same moments from either line, whatever the cut of the facets."""
    press, _ = condensed_press(small_press())
    pairing = couple_lines(press.seat.line, press.bore, travel)
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
    assert couple_lines(press.seat.line, press.bore, -10.0) is None
    assert couple_lines(press.seat.line, press.bore, 1000.0) is None
    assert couple_lines(press.seat.line, press.bore, -9.999) is not None


def beyond_reach(press: Press, travel: float) -> tuple[int, int]:
    """Number of near nodes of either line (gap below REACH depths), and of those with a facet that was left out."""
    seat, bore = press.seat.line, press.bore
    whole, near = couple_lines(seat, bore, travel), couple_lines(seat, bore, travel, REACH)
    assert whole is not None
    assert near is not None
    low, high = whole.portions.start[0], whole.portions.end[-1]
    every = np.concatenate([seat.coordinate, bore.coordinate + travel])
    nodes = np.unique(every[(every >= low) & (every <= high)])
    gap = open_gap(seat, bore, travel, nodes)
    close = nodes[gap < -REACH * gap.min()]
    first, last = near.portions.start[0], near.portions.end[-1]
    outside = ((close <= first) & (first > low)) | ((close >= last) & (last < high))
    left_out = gap[((nodes <= first) & (first > low)) | ((nodes >= last) & (last < high))]
    assert near.clearance <= left_out.min(initial=np.inf)
    return len(close), int(outside.sum())


def test_facets_on_both_sides_of_a_near_node_are_near() -> None:
    """Where the last near node is one of the seat, contact may spread over the facet behind it."""
    press, _ = condensed_press(small_press())
    assert [beyond_reach(press, travel)[1] for travel in np.arange(12.0, 60.0, 0.7)] == [0] * 69


def test_a_single_near_node() -> None:
    press, _ = condensed_press(small_press("mesh.bore_facet=12", "mesh.order=1", "axle.taper_blend=0"))
    assert beyond_reach(press, 9.0) == (1, 0)


@pytest.mark.parametrize("rounding", [-4e-16, 0.0, 4e-16])
def test_nodes_of_both_lines_that_are_one_but_for_rounding(rounding: float) -> None:
    """A small gear touches first where a node of its bore lies on one of the seat, or beside it by 1e-16."""
    axle = {"seat_radius": 10.0, "seat_length": 15.0, "taper_length": 2.0, "taper_height": 0.1, "tail_length": 12.0}
    wheel = {
        "bore_radius": 9.992, "hub_length": 15.0, "hub_outer_radius": 22.0,
        "chamfer_length": 1.0, "chamfer_height": 0.1,
    }  # fmt: skip
    press, _ = condensed_press(build_scene({"axle": axle, "wheel": wheel, "motion": {"travel": 2.0}}))
    near = couple_lines(press.seat.line, press.bore, 1.0 + rounding, REACH)
    assert near is not None
    assert near.portions.start == pytest.approx([-1.0, 0.0], abs=1e-12)
    assert near.portions.end == pytest.approx([0.0, 1.0], abs=1e-12)
