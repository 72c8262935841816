"""`python -m meso`, the same as the command `macrofit-meso`."""

from meso.cli import main

if __name__ == "__main__":
    main(prog_name="python -m meso")
