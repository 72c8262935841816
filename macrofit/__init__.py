"""macrofit: a railway wheel pressed onto its axle, with friction that comes from the roughness of both.

    from macrofit.scene import load_scene
    from macrofit.solve import solve

    solution = solve(load_scene("wheelset"))

Importing the package loads nothing heavy.
"""

__version__ = "0.1.0"
