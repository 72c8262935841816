"""Steel that yields: the law at a point, the plastic strain of a body, and both bodies with their contact."""
