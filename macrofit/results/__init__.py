"""The files of a run: written whole, read back, summed up."""
