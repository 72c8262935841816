"""What steel bears for ever: criteria of histories of stress, limits, and the nominal stress held against them."""
