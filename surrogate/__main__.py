"""`python -m surrogate`, the same as the command `macrofit-surrogate`."""

from surrogate.cli import main

if __name__ == "__main__":
    main(prog_name="python -m surrogate")
