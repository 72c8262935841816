"""The lattice of beams between the spheres, its contacts and its factorisation."""
