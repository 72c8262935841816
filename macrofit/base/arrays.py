"""Names of the array types that all packages use, and a product of them that numpy 2 lacks."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
import numpy.typing as npt

FloatArray: TypeAlias = npt.NDArray[np.float64]
IntArray: TypeAlias = npt.NDArray[np.int64]
BoolArray: TypeAlias = npt.NDArray[np.bool_]
HeightArray: TypeAlias = npt.NDArray[np.float32]


def planar_cross(first: FloatArray, second: FloatArray) -> FloatArray:
    """The cross product of vectors in a plane, a_0 b_1 - a_1 b_0, along the last axis; numpy 2 has none."""
    return np.asarray(first[..., 0] * second[..., 1] - first[..., 1] * second[..., 0])
