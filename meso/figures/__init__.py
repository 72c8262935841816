"""Figures of plates, forces and calibrations."""
