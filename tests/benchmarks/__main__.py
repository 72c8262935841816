"""`python -m tests.benchmarks NAME [options]`: run one benchmark, or `book` for all; without a name, list them."""

from __future__ import annotations

import importlib
import os
import sys

for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(variable, "1")
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)  # the commands that are timed keep their bytecode, as installed ones do

from ._book import main as book  # noqa: E402
from ._book import names  # noqa: E402

if __name__ == "__main__":
    if sys.argv[1:2] == ["book"]:
        sys.exit(book(sys.argv[2:]))
    if len(sys.argv) < 2 or sys.argv[1] not in names():
        print("usage: python -m tests.benchmarks NAME [options]; names:", ", ".join(names()), "and book, for all")
        sys.exit(2)
    sys.exit(importlib.import_module(f"tests.benchmarks.{sys.argv[1]}").main(sys.argv[2:]))
