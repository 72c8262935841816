"""Measured surfaces: read from the files of instruments, mended and levelled."""
