"""`python -m tests.benchmarks NAME [options]`: run one benchmark; without a name, list them."""

from __future__ import annotations

import importlib
import os
import sys
from pathlib import Path

for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(variable, "1")

NAMES = sorted(path.stem for path in Path(__file__).parent.glob("*.py") if not path.stem.startswith("__"))

if __name__ == "__main__":
    if len(sys.argv) < 2 or sys.argv[1] not in NAMES:
        print("usage: python -m tests.benchmarks NAME [options]; names:", ", ".join(NAMES))
        sys.exit(2)
    sys.exit(importlib.import_module(f"tests.benchmarks.{sys.argv[1]}").main(sys.argv[2:]))
