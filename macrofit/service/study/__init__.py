"""Many wheelsets in service: a study of loads, friction, interference or surfaces."""

from .run import carry_out_service_study

__all__ = ["carry_out_service_study"]
