"""The files and the summary of a friction test."""
