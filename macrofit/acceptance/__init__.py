"""Acceptance of a press fit: standards as data, a check for each rule, one word for the whole."""

from .fit import Fit, fit_of_scene
from .run import judge_scene, verdict
from .standard import Standard, load_standard, standard_names, standard_schema
from .verdict import Check, Verdict, judge, verdict_schema

__all__ = [
    "Check",
    "Fit",
    "Standard",
    "Verdict",
    "fit_of_scene",
    "judge",
    "judge_scene",
    "load_standard",
    "standard_names",
    "standard_schema",
    "verdict",
    "verdict_schema",
]
