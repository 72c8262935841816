"""What is wrong with a table is said in one line that names the key, the value and what to try."""

from __future__ import annotations

from typing import Annotated, Any, Literal

import msgspec
import pytest

from macrofit.base.keys import KeyMistake, Keys, NotNegative, Positive, decode_tables, told


class Ball(Keys, frozen=True, tag="ball", tag_field="shape"):
    radius: Annotated[Positive, told("Radius [mm].")]


class Box(Keys, frozen=True, tag="box", tag_field="shape"):
    edge: Annotated[NotNegative | None, told("Edge [mm].")] = None


class Whole(Keys, frozen=True):
    body: Ball | Box
    order: Annotated[Literal[1, 2], told("Order.")] = 2
    fields: tuple[Literal["stress", "strain"], ...] = ()
    ratio: Annotated[float, msgspec.Meta(gt=-1.0, lt=0.5)] = 0.3
    values: Annotated[tuple[float, ...], msgspec.Meta(min_length=1)] = (1.0,)


BALL = {"shape": "ball", "radius": 1.0}


@pytest.mark.parametrize(
    ("tables", "said"),
    [
        ({"body": {"shape": "ball", "radius": -1.0}}, "body.radius: -1.0 must be positive"),
        ({"body": {"shape": "box", "edge": -1}}, "body.edge: -1 must not be negative"),
        ({"body": {"shape": "ball"}}, "body.radius: missing"),
        ({"body": {"shape": "cone"}}, "body.shape: invalid value 'cone' (one of ball, box)"),
        ({}, "body: missing"),
        ({"body": {"shape": "ball", "radius": 1.0, "edg": 1}}, "body.edg: unknown key (known keys: radius)"),
        ({"body": {"shape": "box", "edg": 1}}, "body.edg: unknown key (did you mean 'edge'?)"),
        ({"body": BALL, "ordr": 1}, "ordr: unknown key (did you mean 'order'?)"),
        ({"body": BALL, "order": 3}, "order: 3 is none of 1, 2"),
        ({"body": BALL, "fields": ["stres"]}, "fields: 'stres' is none of strain, stress"),
        ({"body": BALL, "ratio": 0.5}, "ratio: 0.5 must be below 0.5"),
        ({"body": BALL, "ratio": float("nan")}, "ratio: nan is not a finite number"),
        ({"body": BALL, "values": []}, "values: is empty"),
        ({"body": BALL, "values": "x"}, "values: must be a list, not text"),
        ({"body": 1}, "body: must be a table, not a whole number"),
    ],
)
def test_a_mistake_is_one_line(tables: dict[str, Any], said: str) -> None:
    with pytest.raises(KeyMistake) as caught:
        decode_tables(tables, Whole, "whole")
    assert str(caught.value) == said


def test_what_is_right_is_taken() -> None:
    assert decode_tables({"body": BALL}, Whole, "whole") == Whole(body=Ball(radius=1.0))
