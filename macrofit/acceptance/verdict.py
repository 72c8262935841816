"""A press fit held against a standard: a result for each rule, and one word for the whole."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Annotated, Any, Literal, TypeAlias

import msgspec

from ..base.keys import told
from .curve import Curve, Found
from .fit import Fit
from .standard import Known, Limits, Standard, load_standard

Result: TypeAlias = Literal["pass", "fail", "undecided", "not applicable"]
Unit: TypeAlias = Literal["N", "mm", "1"]
Word: TypeAlias = Literal["accepted", "refused", "undecided"]
DEFAULT = "en-13260"
"""The standard that runs are held against, and curves where none is named."""
WINDOWS = ("en-13260", "gost-11018")
"""The standards whose window of the final force every verdict has."""
NUMBER_UNKNOWN = "the standard's file states no number"
NO_YIELD = "no yield stress is known, the largest stress is {stress:.4g} MPa; state {body}.material.grade"
SHARES = frozenset({"without_rise", "oscillation_depth", "oscillation_length", "bulge", "end_drop", "oil_groove"})
"""Checks whose value people read in percent."""


class Check(msgspec.Struct, frozen=True, kw_only=True):
    """The result of one rule."""

    name: Annotated[str, told("Name of the check: of the rule in the standard's file, or `curve` where there is none.")]
    result: Annotated[Result, told("What came of it; `not applicable`: no number, or no value to hold against it.")]
    value: Annotated[float | None, told("What was found [unit]; null: nothing.")] = None
    low: Annotated[float | None, told("Least value that is accepted [unit]; null: any.")] = None
    high: Annotated[float | None, told("Largest value that is accepted [unit]; null: any.")] = None
    unit: Annotated[Unit, told("Unit of value, low and high; 1: a ratio.")] = "1"
    at_mm: Annotated[float | None, told("Displacement where it was found [mm]; null: of the whole curve.")] = None
    known: Annotated[Known, told("How sure the limits are.")] = "unknown"
    source: Annotated[str, told("Where the limits stand.")] = ""
    note: Annotated[str, told("Why it is undecided or not applicable; empty otherwise.")] = ""

    def in_words(self) -> str:
        """Value, place and limits, for people."""
        value = "" if self.value is None else self._written(self.value)
        place = "" if self.at_mm is None else f" at {self.at_mm:.4g} mm"
        return f"{self.name.replace('_', ' ')} {value}{place} ({self.limits()})"

    def limits(self) -> str:
        """The limits and how sure they are, for people."""
        low, high = (None if each is None else self._written(each) for each in (self.low, self.high))
        if low is None and high is None:
            return self.known
        span = f"at most {high}" if low is None else f"at least {low}" if high is None else f"{low} to {high}"
        return f"{span}; {self.known}"

    def measured(self) -> str:
        """Value and place, for people."""
        place = "" if self.at_mm is None else f" at {self.at_mm:.4g} mm"
        return "" if self.value is None else f"{self._written(self.value)}{place}"

    def _written(self, number: float) -> str:
        if self.unit == "N":
            return f"{number / 1e3:.4g} kN"
        if self.unit == "mm":
            return f"{number:.4g} mm"
        return f"{number:.2%}" if self.name in SHARES else f"{number:.3g}"


class Window(msgspec.Struct, frozen=True, rename={"low": "low_N", "high": "high_N"}):
    """The forces [N] that a standard accepts at the end, and whether this one is among them, whatever the length."""

    low: Annotated[float, told("Least force [N].")]
    high: Annotated[float, told("Largest force [N].")]
    inside: Annotated[bool, told("Whether the final force is among them.")]


class Verdict(msgspec.Struct, frozen=True, kw_only=True, rename={"final_force": "final_force_N"}):
    """A press fit held against a standard; without a curve it has no final force and no windows."""

    word: Annotated[Word, told("The whole in one word; undecided: nothing fails, and not enough could be judged.")]
    standard: Annotated[str, told("Title of the standard.")]
    wheel: Annotated[str, told("Type of wheel whose window of the final force was taken.")]
    seat_diameter_mm: Annotated[float, told("Diameter of the seat [mm].")]
    length_mm: Annotated[float, told("Length that seat and bore have in common at the end [mm].")]
    final_force: Annotated[float | None, told("Last force of the curve [N]; null: there is no curve to judge.")]
    en_13260: Annotated[Window | None, told("Window of the final force by EN 13260; null as above.")]
    gost_11018: Annotated[
        Window | None, told("The same by GOST 11018, for this wheel, or a solid one of a locomotive.")
    ]
    checks: Annotated[tuple[Check, ...], told("All checks, in the order of the standard's rules.")]
    sentence: Annotated[str, told("The verdict for people, with every reason.")]

    @property
    def failed(self) -> list[Check]:
        """The checks that refuse the fit."""
        return [check for check in self.checks if check.result == "fail"]

    def check(self, name: str) -> Check:
        """One of the checks by its name."""
        return next(check for check in self.checks if check.name == name)


def judge(fit: Fit, standard: Standard | None = None, wheel: str | None = None) -> Verdict:
    """Hold a fit against a standard, EN 13260 where none is given.

    Args:
        fit: seat, curve and what else is known.
        standard: its rules.
        wheel: type of wheel that picks the window of the final force; None: the standard's own choice.

    Returns:
        `refused` where a check fails; `undecided` where none does, but one is undecided, or neither the final force nor
        the proof of a shrunk wheel can be judged; `accepted` otherwise, which says nothing of checks that are not
        applicable.

    Raises:
        StandardError: the standard does not know this type of wheel.
    """
    rules = standard or load_standard(DEFAULT)
    name, _ = rules.window(wheel)
    checks = tuple(_checks(fit, rules, wheel))
    word = _word(checks)
    european, russian = (None if fit.curve is None else _window(fit, fit.curve, each, name) for each in WINDOWS)
    return Verdict(
        word=word,
        standard=rules.title,
        wheel=name,
        seat_diameter_mm=fit.diameter,
        length_mm=fit.length,
        final_force=None if fit.curve is None else fit.curve.final.value,
        en_13260=european,
        gost_11018=russian,
        checks=checks,
        sentence=_sentence(fit, rules, word, checks, (european, russian)),
    )


def verdict_schema() -> dict[str, Any]:
    """JSON schema of a verdict as files have it: every key with its meaning and its unit."""
    schema = msgspec.json.schema(Verdict)
    for table in schema["$defs"].values():
        table["required"] = list(table["properties"])  # a verdict writes every key
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", "title": "A verdict of macrofit", **schema}


def _checks(fit: Fit, rules: Standard, wheel: str | None) -> Iterator[Check]:
    yield from _length(fit, rules)
    yield from _interference(fit, rules)
    curves: tuple[Callable[[Fit, Curve, Standard, str | None], Iterator[Check]], ...] = (
        _forces, _beginning, _rise, _oscillation, _drops,
    )  # fmt: skip
    if fit.curve is None:
        yield Check(name="curve", result="not applicable", note=fit.reason)
    else:
        for each in curves:
            yield from each(fit, fit.curve, rules, wheel)
    yield from _safety(fit, rules)
    yield from _proof(fit, rules, wheel)
    for demand in rules.elsewhere:
        note = f"not to be seen here: {demand.demand}"
        yield Check(
            name=demand.name, result="not applicable", known=demand.known, source=demand.source, note=note
        )  # fmt: skip


def _held(name: str, limits: Limits, found: Found | float | None, unit: Unit = "1", why: str = "") -> Check:
    """The check of one value; with a reason ``why``, or without a number or a value, it is not applicable."""
    value = found.value if isinstance(found, Found) else found
    place = found.at if isinstance(found, Found) else None
    note = why or ("" if limits.stated else NUMBER_UNKNOWN)
    result: Result = "fail"
    if note or value is None:
        result = "not applicable"
    elif limits.hold(value):
        result = "pass"
    return Check(
        name=name, result=result, value=value, low=limits.low, high=limits.high, unit=unit, at_mm=place,
        known=limits.known, source=limits.source, note=note,
    )  # fmt: skip


def _jump(name: str, limits: Limits, found: Found) -> Check:
    """The check of a jump: between points that are far apart, a large one may be a steep rise."""
    check = _held(name, limits, found, "N")
    if check.result != "fail" or found.resolved:
        return check
    note = f"the points are {found.within:.3g} mm apart there, too far to tell a jump from a steep rise"
    return msgspec.structs.replace(check, result="undecided", note=note)


def _length(fit: Fit, rules: Standard) -> Iterator[Check]:
    """Whether the window of the final force holds for this fit: outside, nothing is known, which is no refusal."""
    limits, ratio = rules.length_over_diameter, fit.length / fit.diameter
    why = "" if limits.hold(ratio) else "the standard's window of the final force is not for such a fit"
    yield _held("length_over_diameter", limits, ratio, why=why)


def _interference(fit: Fit, rules: Standard) -> Iterator[Check]:
    limits = (rules.shrink if fit.shrunk else rules.press).at(fit.diameter)
    why = "the interference is not known" if fit.interference is None else ""
    yield _held("interference", limits, fit.interference, "mm", why)


def _forces(fit: Fit, curve: Curve, rules: Standard, wheel: str | None) -> Iterator[Check]:
    window = rules.window(wheel)[1].scaled(fit.diameter)
    ratio = rules.length_over_diameter
    why = "" if ratio.hold(fit.length / fit.diameter) else "the window is not for such a length over the diameter"
    yield _held("final_force", window, curve.final, "N", why)
    yield _held("peak", rules.peak.scaled(window.high or 0.0), curve.top, "N", why)


def _beginning(fit: Fit, curve: Curve, rules: Standard, wheel: str | None) -> Iterator[Check]:
    yield _jump("start_jump", rules.start_jump, curve.start_jump())
    limits = rules.engaged_length
    short = limits.low is not None and fit.length < limits.low
    why = f"the fit itself is {fit.length:g} mm long" if short else ""
    yield _held("engaged_length", limits, Found(curve.length, float(curve.s[0])), "mm", why)


def _rise(fit: Fit, curve: Curve, rules: Standard, wheel: str | None) -> Iterator[Check]:
    flat = curve.without_rise(rules.noise)
    yield _held("without_rise", rules.without_rise, Found(flat.value / curve.length, flat.at))
    yield _jump("step", rules.step, curve.step())
    yield _held("bulge", rules.bulge, curve.bulge() / curve.peak)


def _oscillation(fit: Fit, curve: Curve, rules: Standard, wheel: str | None) -> Iterator[Check]:
    """Dips, but those that a rule of their own judges: the drop at the end, and that at an oil groove."""
    dips = curve.dips(rules.noise)
    if rules.end_drop.stated:
        dips = [dip for dip in dips if dip.end < curve.s[-1]]
    if rules.oil_groove.stated:
        dips = [dip for dip in dips if not rules.oil_groove.has(dip.start, dip.end)]
    deepest = max(dips, key=lambda dip: dip.depth, default=None)
    found = Found(deepest.depth / curve.peak, deepest.at) if deepest is not None else 0.0
    yield _held("oscillation_depth", rules.oscillation_depth, found)
    share = sum(dip.end - dip.start for dip in dips) / curve.length
    yield _held("oscillation_length", rules.oscillation_length, Found(share, dips[0].start) if dips else 0.0)


def _drops(fit: Fit, curve: Curve, rules: Standard, wheel: str | None) -> Iterator[Check]:
    drop = Found((curve.peak - curve.final.value) / curve.peak, curve.final.at)
    yield _held("end_drop", rules.end_drop, drop)
    groove = [dip for dip in curve.dips(rules.noise) if rules.oil_groove.has(dip.start, dip.end)]
    deepest = max(groove, key=lambda dip: dip.depth, default=None)
    found = None if deepest is None else Found(deepest.depth / curve.peak, deepest.at)
    why = "no dip there" if rules.oil_groove.stated and deepest is None else ""
    yield _held("oil_groove", rules.oil_groove, found, why=why)


def _safety(fit: Fit, rules: Standard) -> Iterator[Check]:
    for body, limits in (("axle", rules.safety_axle), ("wheel", rules.safety_wheel)):
        stress, bound = fit.von_mises.get(body, 0.0), fit.yield_stress.get(body)
        why = "" if stress > 0.0 else "no stress is known"
        why = why or ("" if bound is not None else NO_YIELD.format(body=body, stress=stress))
        yield _held(f"safety_{body}", limits, bound / stress if bound is not None and stress > 0.0 else None, why=why)


def _proof(fit: Fit, rules: Standard, wheel: str | None) -> Iterator[Check]:
    """What holds a wheel that is shrunk on, over the smallest force with which it might be pressed on.

    The loads of a proof change slowly and friction does not know the time: one push and three are the same. A wheel
    that is pressed on is proved by its curve; what holds it is then told over its last force.
    """
    load = rules.window(wheel)[1].scaled(fit.diameter).low
    ratio, why = rules.length_over_diameter, ""
    if fit.holds is None:
        why = f"not to be seen in a curve: {rules.proof.source}" if rules.proof.stated else ""
    elif not fit.shrunk:
        load = None if fit.curve is None else fit.curve.final.value
        why = "for wheels that are shrunk on; of one that is pressed on: what holds it over its last force"
    elif not ratio.hold(fit.length / fit.diameter):
        why = "the window of the force is not for such a length over the diameter"
    value = fit.holds / load if fit.holds is not None and load else None
    yield _held("proof", rules.proof, value, why=why)


def _word(checks: tuple[Check, ...]) -> Word:
    if any(check.result == "fail" for check in checks):
        return "refused"
    judged = any(check.name in ("final_force", "proof") and check.result == "pass" for check in checks)
    judged = judged and all(check.result != "undecided" for check in checks)
    return "accepted" if judged else "undecided"


def _window(fit: Fit, curve: Curve, name: str, wheel: str) -> Window:
    """The window of a built-in standard for this type of wheel, or its first one where it does not know the type."""
    standard = load_standard(name)
    limits = standard.window(wheel if wheel in standard.final_force else None)[1].scaled(fit.diameter)
    assert limits.low is not None  # `load_standard` has looked
    assert limits.high is not None
    return Window(limits.low, limits.high, limits.hold(curve.final.value))


def _sentence(
    fit: Fit, rules: Standard, word: Word, checks: tuple[Check, ...], windows: tuple[Window | None, Window | None]
) -> str:
    reasons = [check.in_words() for check in checks if check.result == "fail"]
    if word == "undecided":
        told = [check for check in checks if check.result == "undecided" or check.name in ("curve", "final_force")]
        reasons = [check.note for check in told if check.note]
    said = f"{word} by {rules.title}{': ' if reasons else ''}{'; '.join(reasons)}"
    if fit.curve is None:
        return said
    force, (european, russian) = fit.curve.final.value, windows
    return (
        f"{said}. The wheel is pressed on with {force / 1e3:.0f} kN at the end, {_placed(european, 'EN 13260')} and "
        f"{_placed(russian, 'GOST 11018')} for a seat of {fit.diameter:g} mm in diameter."
    )


def _placed(window: Window | None, standard: str) -> str:
    if window is None:
        return f"not held against {standard}"
    where = "inside" if window.inside else "outside"
    return f"{where} the {window.low / 1e3:.0f} to {window.high / 1e3:.0f} kN of {standard}"
