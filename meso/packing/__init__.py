"""Spheres packed into a plate."""
