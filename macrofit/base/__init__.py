"""What the three packages share, once: errors, files, logs, TOML, commands, progress, figures, provenance, material.

Nothing here knows a press fit, a plate or a network. Standard library, numpy, click, msgspec, rich and tomli_w;
matplotlib only inside `figure`, mpi4py only inside `farm`.
"""
