"""Rough plates and their friction. Still to come: see `macrofit-meso --help`."""
