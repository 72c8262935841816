"""Several runs of one scene's bodies at once: pairing, influence and factors are shared, increment by increment."""
