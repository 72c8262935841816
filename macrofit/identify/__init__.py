"""A parameter found from a measured curve."""
