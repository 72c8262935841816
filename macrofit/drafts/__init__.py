"""Scenes to begin with: `macrofit init` writes one of them, every key with its meaning and its unit."""
