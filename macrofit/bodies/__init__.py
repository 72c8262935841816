"""The two elastic bodies: shape, mesh, elements, stiffness, stress."""
