"""The database of friction tests: design, farm, file, table."""
