"""What a service computation leaves in its folder."""

from ...results.kinds import SERVICE

NUMBERS = SERVICE.numbers
SEAT = "seat.csv"
"""Values along the seat, one row for each facet; under the bonded fit, at the angle 0."""
FRETTING = "fretting.csv"
"""Values along the contact over a revolution, one row for each moment: two of a facet of order 2."""
FIGURE = "service.png"
HISTORIES = "service.h5"
"""Tractions, slips and stresses at all times of the last revolution."""
SURFACE = "seat.vtu"
"""The surface of the seat in space, under the loads at the angle 0, for ParaView."""
RESULTS = (NUMBERS, SEAT, FRETTING, FIGURE, HISTORIES, SURFACE)
