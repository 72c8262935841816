"""Two rough plates made of spheres and beams, squeezed and slid over each other: the friction their roughness gives.

    from meso.settings import load
    from meso.friction_test import run

    test = run(load("plates.toml", ["surface.wheel_seed=7"]))  # load() alone: all defaults
    curve = test.slides[0].curve  # one slide for each micro coefficient asked for
    print(curve.coefficient, curve.uncertainty)  # mean T / mean N [-], its standard error along the slide [-]
    print(curve.displacement, curve.normal, curve.tangential)  # mm, N, N

Parts of it: `meso.surfaces` makes rough faces and measures them, `meso.packing` fills plates with spheres,
`meso.calibrate` finds the beams between them. The same from a shell: `macrofit-meso --help`.
Lengths are in mm, forces in N, moduli in MPa, masses in t, times in s.
"""
