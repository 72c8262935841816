"""What moves the plates: quasi-static increments or explicit time steps."""
