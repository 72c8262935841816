"""The network that replaces the rough plates. Still to come: see `macrofit-surrogate --help`."""
