"""A page to file of a run, a study or a service computation: one HTML file that opens offline, and a PDF of it."""

from .output import write_report

__all__ = ["write_report"]
