from stripes_friction import Stripes

from macrofit.friction.conformance import check


def test_stripes_keeps_the_contract() -> None:
    check(Stripes(smooth=0.05))
