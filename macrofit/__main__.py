"""`python -m macrofit`, the same as the command `macrofit`."""

from macrofit.cli import main

if __name__ == "__main__":
    main(prog_name="python -m macrofit")
