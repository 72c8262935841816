"""What a study computes: a scene for every combination of the varied values, and for every reference."""

from __future__ import annotations

import hashlib
import itertools
import math
import re
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from decimal import Decimal, InvalidOperation
from functools import partial
from pathlib import Path
from typing import Any

import msgspec

from .. import __version__
from ..acceptance import Standard
from ..base.toml import last_part
from ..errors import MacrofitError, SceneError
from ..friction import GivenFriction, ScriptFriction, build_provider, try_provider
from ..results.journal import VERSION, file_digests
from ..scene import Scene, load_scene, with_script_friction

MOST_RUNS = 100_000
FINE_RANGE = "friction.options.coefficient=0.1:0.5:0.1"
EXAMPLE = f"for example friction.options.micro_friction=0.01,0.03, {FINE_RANGE} or friction.options.seed=1:200"
RANGE = re.compile(r"\s*([-+.\deE]+):([-+.\deE]+)(?::([-+.\deE]+))?\s*")
BRACKETS = {"[": 1, "{": 1, "(": 1, "]": -1, "}": -1, ")": -1}


@dataclass(frozen=True, kw_only=True)
class PlannedRun:
    """One run of a study."""

    number: int  # from 1 on
    label: str
    values: dict[str, str]  # varied key -> value as written; empty for a reference
    scene: Scene
    digest: str  # of everything that determines the run

    @property
    def name(self) -> str:
        """What messages call it."""
        return f"run {self.number} ({self.label})" if self.label else f"run {self.number}"


@dataclass(frozen=True, kw_only=True)
class Plan:
    """All runs of a study: the references first, then the product of the values, the last key varying fastest."""

    source: str
    title: str
    keys: tuple[str, ...]
    runs: tuple[PlannedRun, ...]
    script: ScriptFriction | None = None  # friction that a script gives, for the runs that name it
    standard: Standard | None = None  # what the runs are held against; None: EN 13260

    @property
    def different(self) -> list[PlannedRun]:
        """The runs that differ: a reference may be one of the varied runs."""
        first: dict[str, PlannedRun] = {}
        for run in self.runs:
            first.setdefault(run.digest, run)
        return list(first.values())

    def friction_of(self, scene: Scene) -> GivenFriction | None:
        """The object that gives a run's friction; None where it is that of an installed provider."""
        named = self.script is not None and scene.friction.provider == self.script.name
        return self.script.given if self.script is not None and named else None


def plan_study(
    source: str | Path,
    vary: Sequence[str],
    overrides: Iterable[str] = (),
    references: Sequence[str] = (),
    *,
    friction: GivenFriction | None = None,
    standard: Standard | None = None,
) -> Plan:
    """The runs of a study of a scene, every one decoded and checked, its provider's options too.

    Args:
        source: a built-in scene or a TOML file.
        vary: "key=v1,v2,..." each; a value may be a range first:last:step, "0.1:0.5:0.1", its ends included;
            of integers the step may be left out, "1:200".
        overrides: "key=value" each, for all runs.
        references: see `reference_overrides`; they may name installed providers.
        friction: an object in place of the scene's [friction], with a `digest`, see `macrofit.solve.solve`. Its
            options vary (friction.options.KEY) where it is a callable that makes a provider, such as a class.
        standard: what the runs are held against, EN 13260 where it is left out.

    Raises:
        SceneError: a key or value that is wrong; the line names the key.
        ProviderError: options that the provider refuses, or an object without a digest.
    """
    script = None if friction is None else ScriptFriction(friction)
    varied = [parse_vary(text) for text in vary]
    keys = _varied_keys(varied)
    common = [*([] if script is None else [f"friction.provider={script.name}"]), *overrides]
    planned = [reference_overrides(text) for text in references]
    runs: list[PlannedRun] = []
    for label, own in planned:
        runs.append(_planned(len(runs) + 1, label, {}, (source, [*common, *own]), script))
    for combination in itertools.product(*(values for _, values in varied)):
        chosen = dict(zip(keys, combination, strict=True))
        label = ", ".join(f"{_short(key, keys)} = {value}" for key, value in chosen.items())
        own = [f"{key}={value}" for key, value in chosen.items()]
        runs.append(_planned(len(runs) + 1, label, chosen, (source, [*common, *own]), script))
    _no_twins(runs)
    title = load_scene(source, common).title
    return Plan(source=str(source), title=title, keys=keys, runs=tuple(runs), script=script, standard=standard)


def _varied_keys(varied: Sequence[tuple[str, list[str]]]) -> tuple[str, ...]:
    """The keys, each given once and with a number of runs that can be computed."""
    keys = tuple(key for key, _ in varied)
    for key in keys:
        if keys.count(key) > 1:
            raise SceneError(f"--vary {key}: given more than once; write all its values after one --vary")
    count = math.prod(len(values) for _, values in varied)
    if count > MOST_RUNS:
        raise SceneError(f"--vary: {count} runs are asked for, more than {MOST_RUNS}")
    return keys


def parse_vary(text: str) -> tuple[str, list[str]]:
    """Key and values of "key=v1,v2,...".

    Raises:
        SceneError: it is written otherwise.
    """
    key, equals, listed = text.partition("=")
    key = key.strip()
    if not equals or not key:
        raise SceneError(f"--vary '{text}': write key=v1,v2,..., {EXAMPLE}")
    values: list[str] = []
    for part in split_outside(listed):
        span = RANGE.fullmatch(part)
        if span:
            values += _spread(key, part.strip(), span.groups())
        elif part.strip():
            values.append(part.strip())
        else:
            raise SceneError(f"--vary {key}: {'an empty value' if listed.strip() else 'no value'}; {EXAMPLE}")
    twice = [value for value, count in Counter(values).items() if count > 1]
    if twice:
        raise SceneError(f"--vary {key}: {twice[0]} is given twice")
    return key, values


def reference_overrides(text: str) -> tuple[str, list[str]]:
    """Label and overrides of a reference: "uniform=0.11", or "key=value,..." as for --set.

    Raises:
        SceneError: it is written otherwise.
    """
    name, equals, value = text.partition("=")
    if not equals or not name.strip() or not value.strip():
        raise SceneError(f"--reference '{text}': write uniform=0.11, or key=value,key=value,... as for --set")
    if name.strip() == "uniform":
        return f"uniform {value.strip()}", [
            "friction.provider=uniform", f"friction.options={{coefficient={value.strip()}}}"
        ]  # fmt: skip
    return text.strip(), [part.strip() for part in split_outside(text)]


def split_outside(text: str) -> list[str]:
    """Parts of a text between commas that are in no bracket and no quotation marks."""
    parts, depth, quote = [""], 0, ""
    for sign in text:
        if quote:
            quote = "" if sign == quote else quote
        elif sign in "\"'":
            quote = sign
        else:
            depth += BRACKETS.get(sign, 0)
        if sign == "," and depth == 0 and not quote:
            parts.append("")
        else:
            parts[-1] += sign
    return parts


def digest(scene: Scene, script: ScriptFriction | None = None) -> str:
    """SHA-256 of a scene, of all files it names, of the object it names as friction, and of macrofit's versions."""
    parts: list[Any] = [__version__, VERSION, scene, file_digests(scene)]
    if script is not None:
        parts.append(script.required_digest())
    return hashlib.sha256(msgspec.json.encode(parts, order="deterministic")).hexdigest()


def _spread(key: str, text: str, ends: Sequence[str | None]) -> list[str]:
    """The values first, first + step, ... up to last, in exact decimals.

    Raises:
        SceneError: the range cannot be counted, is empty or too long.
    """
    try:
        first, last, step = (Decimal(each or "1") for each in ends)
    except InvalidOperation:
        first = last = step = Decimal("NaN")
    if not all(math.isfinite(each) for each in (first, last, step)):
        raise SceneError(f"--vary {key}: {text} is no range of numbers; {EXAMPLE}") from None
    whole = not any(sign in text for sign in ".eE")
    if ends[2] is None and not whole:
        raise SceneError(f"--vary {key}: the range {text} has no step; write first:last:step, as {FINE_RANGE}")
    if first > last or float(step) <= 0.0:
        raise SceneError(f"--vary {key}: the range {text} is empty; write first:last:step, first <= last and step > 0")
    if (last - first) / step >= MOST_RUNS:
        raise SceneError(f"--vary {key}: the range {text} has more than {MOST_RUNS} values")
    return [_written(first + k * step, whole) for k in range(int((last - first) / step) + 1)]


def _written(value: Decimal, whole: bool) -> str:
    """A value of a range as TOML; one that is not whole by the way it was written keeps a point."""
    return str(value) if whole else re.sub(r"(\.\d+?)0*$", r"\1", f"{value + Decimal('0.0'):f}")


def _planned(
    number: int, label: str, values: dict[str, str], where: tuple[str | Path, list[str]], script: ScriptFriction | None
) -> PlannedRun:
    what = f"run {number} ({label}): " if label else ""
    try:
        scene = load_scene(*where)
        if script is not None and scene.friction.provider == script.name:
            scene = with_script_friction(scene, script)
        else:
            script = None
        _try_friction(scene, script)
        stated = digest(scene, script)
    except MacrofitError as error:
        hint = ""
        if script is None and "unknown option of friction provider" in str(error):
            hint = "; another provider is chosen with --set friction.provider=NAME"
        raise type(error)(f"{what}{error}{hint}") from error
    return PlannedRun(number=number, label=label, values=values, scene=scene, digest=stated)


def _try_friction(scene: Scene, script: ScriptFriction | None) -> None:
    """Build the provider once, so that a value it refuses is known before anything runs."""
    material, (name, options) = scene.axle.material, (scene.friction.provider, scene.friction.options)
    build = partial(build_provider, name) if script is None else script.build
    try_provider(partial(build, options), material.youngs_modulus, material.poisson_ratio)  # warned of when it runs


def _no_twins(runs: Sequence[PlannedRun]) -> None:
    """A reference may be one of the runs it is compared with; it is computed once."""
    seen: dict[str, PlannedRun] = {}
    for run in (run for run in runs if run.values):
        twin = seen.setdefault(run.digest, run)
        if twin is not run:
            raise SceneError(f"{twin.name} and {run.name} are the same scene; leave one of them out")


def _short(key: str, keys: Sequence[str]) -> str:
    """The last part of a key, where no other has the same."""
    last = last_part(key)
    return last if sum(last_part(other) == last for other in keys) == 1 else key
