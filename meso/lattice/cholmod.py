"""The factor of a plate's stiffness, and what to do about a plate that has none."""

from __future__ import annotations

from typing import Any

from macrofit.base.arrays import IntArray
from macrofit.base.cholmod import Factor, FactorError, NotDefiniteError
from macrofit.base.cholmod import factor as factor_blocks

from ..errors import MesoError, PackingError


def factor(matrix: Any, last: IntArray | None = None, block: int = 6) -> Factor:
    """Factor a plate's stiffness, the contact candidates ordered last, as `macrofit.base.cholmod.factor`.

    Raises:
        MesoError: the library is missing or another one, or the factor is too large.
        PackingError: the stiffness is not positive definite, so that a piece of the lattice is free.
    """
    try:
        return factor_blocks(matrix, last, block)
    except NotDefiniteError as error:
        raise PackingError(
            f"{error}. A piece of the lattice hangs on nothing, or nothing of it is fixed: keep the main connected "
            "component and fix its back"
        ) from None
    except FactorError as error:
        remedy = "" if "CHOLMOD" in str(error) else ": take fewer spheres, or engine.name = 'explicit'"
        raise MesoError(f"{error}{remedy}") from None
