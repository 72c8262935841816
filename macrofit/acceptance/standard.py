"""A standard as a record: every number with where it comes from and how sure that is, read strictly from TOML."""

from __future__ import annotations

from functools import lru_cache
from importlib import resources
from pathlib import Path
from typing import Annotated, Any, Literal, TypeAlias

import msgspec

from ..base.errors import nearest
from ..base.keys import KeyMistake, Keys, decode_tables, told
from ..base.toml import errors_as, parse_toml, read_toml
from ..errors import StandardError

Known: TypeAlias = Literal[
    "read", "secondary source", "from memory: confirm against the text", "assumed by macrofit", "own rule", "unknown"
]
"""How sure a number is; `own rule` is for the file of a user."""


class Limits(Keys, frozen=True):
    """Least and largest value that a rule accepts; one that is left out does not bind."""

    low: Annotated[float | None, told("Least value, in the unit of the rule.")] = None
    high: Annotated[float | None, told("Largest value, in the unit of the rule.")] = None
    source: Annotated[str, told("Where the numbers stand.")] = ""
    known: Annotated[Known, told("How sure the numbers are.")] = "unknown"

    @property
    def stated(self) -> bool:
        """Whether there is a number to hold a value against."""
        return self.low is not None or self.high is not None

    def hold(self, value: float) -> bool:
        """Whether the value lies between the limits, both included."""
        return (self.low is None or value >= self.low) and (self.high is None or value <= self.high)

    def scaled(self, factor: float) -> Limits:
        """The limits times a factor."""
        low, high = (None if each is None else factor * each for each in (self.low, self.high))
        return Limits(low=low, high=high, source=self.source, known=self.known)


class Interference(Limits, frozen=True):
    """Diametral interference per diameter of the seat [mm/mm], to which a length may be added."""

    low_added: Annotated[float, told("Is added to low times the diameter [mm].")] = 0.0
    high_added: Annotated[float, told("Is added to high times the diameter [mm].")] = 0.0

    def at(self, diameter: float) -> Limits:
        """The limits [mm] for a seat of this diameter [mm]."""
        low = None if self.low is None else self.low * diameter + self.low_added
        high = None if self.high is None else self.high * diameter + self.high_added
        return Limits(low=low, high=high, source=self.source, known=self.known)


class Groove(Limits, frozen=True):
    """A dip where an oil groove passes the seat's entrance; its depth is bound by `high`, over the peak [-]."""

    start: Annotated[float | None, told("Displacement from which the dip belongs to the groove [mm].")] = None
    end: Annotated[float | None, told("Displacement up to which it does [mm].")] = None

    def has(self, start: float, end: float) -> bool:
        """Whether a dip between two displacements [mm] is the groove's."""
        return self.start is not None and self.end is not None and start >= self.start and end <= self.end


class Elsewhere(Keys, frozen=True):
    """A demand of the standard that neither a curve nor a run shows."""

    name: Annotated[str, told("What it is called.")]
    demand: Annotated[str, told("What is asked, in words with numbers.")]
    source: Annotated[str, told("Where it stands.")]
    known: Annotated[Known, told("How sure it is.")]


NONE, NO_FIT, NO_GROOVE = Limits(), Interference(), Groove()
"""What stands for a rule that a file leaves out: no number, and known as unknown."""


class Standard(Keys, frozen=True):
    """The rules a press fit is held against; a rule that is left out is not judged."""

    title: Annotated[str, told("What the verdict calls the standard.")]
    final_force: Annotated[
        dict[str, Limits], msgspec.Meta(min_length=1),
        told("Force at the end over the seat's diameter, for each type of wheel [N/mm]."),
    ]  # fmt: skip
    wheel: Annotated[str | None, told("Type of wheel taken where none is named; left out: the first.")] = None
    length_over_diameter: Annotated[Limits, told("Fits for which the window of the final force holds [-].")] = NONE
    peak: Annotated[Limits, told("Largest force over the upper end of the window of the final force [-].")] = NONE
    press: Annotated[Interference, told("Diametral interference of a wheel that is pressed on.")] = NO_FIT
    shrink: Annotated[Interference, told("Diametral interference of a wheel that is shrunk on.")] = NO_FIT
    start_jump: Annotated[Limits, told("Force with which the curve sets in, before it rises steadily [N].")] = NONE
    step: Annotated[Limits, told("Rise within a millimetre beyond that of the curve around it [N].")] = NONE
    engaged_length: Annotated[Limits, told("Displacement from the first force to the end [mm].")] = NONE
    without_rise: Annotated[Limits, told("Longest stretch without a rise, over the engaged length [-].")] = NONE
    oscillation_depth: Annotated[Limits, told("Deepest dip below what had been reached, over the peak [-].")] = NONE
    oscillation_length: Annotated[Limits, told("Length of all dips together, over the engaged length [-].")] = NONE
    bulge: Annotated[Limits, told("Mean height of the curve above its chord, over the peak [-].")] = NONE
    end_drop: Annotated[
        Limits, told("Drop at the end, over the peak [-]; left out: the drop is an oscillation as any other.")
    ] = NONE
    oil_groove: Annotated[Groove, told("Dip at an oil groove; left out: it is an oscillation as any other.")] = (
        NO_GROOVE
    )
    safety_axle: Annotated[Limits, told("Yield stress over the largest von Mises stress of the axle [-].")] = NONE
    safety_wheel: Annotated[Limits, told("The same of the wheel [-].")] = NONE
    proof: Annotated[
        Limits, told("Axial force that holds a wheel that is shrunk on, over the low end of final_force [-].")
    ] = NONE
    noise: Annotated[
        float, msgspec.Meta(ge=0.0, lt=0.1), told("Change over the peak below which it is noise [-].")
    ] = 0.005  # fmt: skip
    elsewhere: Annotated[tuple[Elsewhere, ...], told("Demands that neither a curve nor a run shows.")] = ()

    def window(self, wheel: str | None = None) -> tuple[str, Limits]:
        """Type of wheel and its limits of the final force over the diameter [N/mm].

        Raises:
            StandardError: the standard has no such type.
        """
        name = wheel or self.wheel or next(iter(self.final_force))
        if name not in self.final_force:
            raise StandardError(f"{self.title}: no wheel '{name}'; it has {', '.join(self.final_force)}")
        return name, self.final_force[name]


def standard_names() -> list[str]:
    """Names of the standards shipped with the package."""
    return sorted(entry.name[:-5] for entry in _folder().iterdir() if entry.name.endswith(".toml"))


def standard_schema() -> dict[str, Any]:
    """JSON schema of a standard's file, for editors: every rule with its meaning and its unit."""
    schema = msgspec.json.schema(Standard)
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", "title": "A standard of macrofit", **schema}


def load_standard(source: str) -> Standard:
    """Read a standard: a built-in name, or the path of a TOML file.

    Raises:
        StandardError: one line that names the key.
    """
    if source in standard_names():
        return _built_in(source)
    if not Path(source).exists():
        raise StandardError(
            f"no standard '{source}': neither a file nor one of the built-in ones "
            f"({nearest(source, standard_names(), 'which are')})"
        )
    with errors_as(StandardError):
        return _decode(read_toml(Path(source)), source)


@lru_cache
def _built_in(name: str) -> Standard:
    """A standard of the package; every run asks for two."""
    return _decode(parse_toml((_folder() / f"{name}.toml").read_text(), name), name)


def _decode(tables: dict[str, Any], source: str) -> Standard:
    try:
        standard = decode_tables(tables, Standard, "standard")
        _check(standard)
    except KeyMistake as error:
        raise StandardError(f"{source}: {error}") from None
    return standard


def _folder() -> resources.abc.Traversable:
    return resources.files("macrofit.acceptance")


def _check(standard: Standard) -> None:
    """What one key alone cannot say.

    Raises:
        KeyMistake: limits that cross, numbers without a source, a type of wheel that is not there.
    """
    rules = {name: getattr(standard, name) for name in standard.__struct_fields__}
    rules |= {f"final_force.{wheel}": limits for wheel, limits in standard.final_force.items()}
    for name, limits in rules.items():
        if isinstance(limits, Limits):
            _check_limits(name, limits)
    for wheel, limits in standard.final_force.items():
        if limits.low is None or limits.high is None:
            raise KeyMistake(f"final_force.{wheel}: needs low and high [N/mm]")
    if standard.wheel is not None and standard.wheel not in standard.final_force:
        raise KeyMistake(f"wheel: no '{standard.wheel}' in final_force ({', '.join(standard.final_force)})")
    groove = standard.oil_groove
    if groove.stated and (groove.start is None or groove.end is None or groove.start >= groove.end):
        raise KeyMistake("oil_groove: needs start and end [mm], start below end")


def _check_limits(name: str, limits: Limits) -> None:
    if limits.low is not None and limits.high is not None and limits.low > limits.high:
        raise KeyMistake(f"{name}: low = {limits.low:g} is above high = {limits.high:g}")
    if limits.stated and (limits.known == "unknown" or not limits.source):
        raise KeyMistake(f'{name}: say where its numbers come from: source = "...", known = "own rule"')
