"""Rough surfaces: made from a seed, measured, closed to a hull."""
