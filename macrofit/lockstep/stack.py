"""States of several runs as one, and the step of all of them taken apart: what a run owns has an axis of runs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ..contact.law import LinearSolution, Status
from ..solution import FacetState
from ..state import State, Step

COMMON = ("displacement", "thermal_strain", "flow", "changes")
"""What runs in lockstep have in common, or none of them has."""
VECTORS = ("seat_displacement", "bore_displacement", "seat_load", "bore_load")
"""Vectors of a body's nodes: (2 nodes,) of one run, (2, runs, nodes) of several; all others (...,) and (runs, ...)."""
NUMBERS = (
    "force", "normal_force", "friction_force", "friction_bound", "torque", "strain_energy", "dissipation", "slip_work",
)  # fmt: skip
STATE = tuple(name for name in State.__dataclass_fields__ if name not in (*COMMON, *VECTORS))
FACETS = tuple(FacetState.__dataclass_fields__)


def stacked(states: Sequence[State]) -> State:
    """The states of runs that are at one displacement, as one."""
    own: dict[str, Any] = {name: np.array([getattr(state, name) for state in states]) for name in STATE}
    for name in VECTORS:
        own[name] = np.stack([getattr(state, name).reshape(2, -1) for state in states], axis=1)
    return replace(states[0], **own)


def of_run(step: Step, run: int) -> Step:
    """The part of a step that is one run's."""
    state, answer, status = step.state, step.report.answer, step.report.status
    own: dict[str, Any] = {name: getattr(state, name)[run] for name in STATE if name != "direction"}
    for name in VECTORS:
        own[name] = getattr(state, name)[:, run].ravel()
    own["friction_force"] = float(own["friction_force"])
    traction, trial, total = answer.traction[:, run], answer.trial[:, run], answer.total[:, run]
    report = replace(
        step.report,
        answer=LinearSolution(traction, trial, total, answer.kappa[run]),
        status=Status(status.kind[run], status.sign[run]),
    )
    numbers: dict[str, Any] = {name: float(getattr(step, name)[run]) for name in NUMBERS}
    return replace(
        step,
        state=replace(state, **own),
        report=report,
        facets=FacetState(**{name: getattr(step.facets, name)[run] for name in FACETS}),
        **numbers,
    )
