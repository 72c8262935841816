"""The command line. What is heavy is imported inside the commands, so that help comes at once."""

from .commands import main

__all__ = ["main"]
