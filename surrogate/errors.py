"""The error tree of the network and its data. A message says what, where, and what to try."""

from __future__ import annotations

from macrofit.base.errors import MacrofitError


class SurrogateError(MacrofitError):
    """Anything about the network and its data that the user can mend."""


class DatabaseError(SurrogateError):
    """A database that cannot be read, written or gone on with."""


class DesignError(SurrogateError):
    """A design of samples, or settings of the plates, that cannot be computed."""


class CheckpointError(SurrogateError):
    """Weights that cannot be read, are not what they say, or are of another kind."""


class TrainingError(SurrogateError):
    """Samples or options that nothing can be learned from."""


class PredictionError(SurrogateError):
    """Surfaces or coefficients that the network cannot be asked about."""


class EvaluationError(SurrogateError):
    """Samples that a network cannot be judged by."""
