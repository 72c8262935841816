"""How far from converged a scene is: the same scene on three meshes and with two step lengths, and its presets."""
