"""The steel of axles and wheels: one place for its constants, whatever the scale."""

YOUNGS_MODULUS, POISSON_RATIO, DENSITY = 206e3, 0.3, 7.85e-9
"""Railway axle steel [MPa, -, t/mm3]: E = 206 GPa and nu = 0.3, in use for the grades of EN 13261; 7850 kg/m3."""
EXPANSION = 1.15e-5
"""Thermal expansion of plain carbon steel between 20 and some 150 C [1/K]; handbooks have 1.1e-5 to 1.25e-5."""
