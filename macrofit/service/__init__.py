"""The pressed wheelset in service: rotating bending, fretting at the ends of the fit."""
