"""`python -m pecs.datasets RECIPE.toml -o SET`, which `pecs dataset` runs."""

import sys

from .._errors import PecsError, optional_module

try:
    optional_module("scipy", "SciPy", "pecs dataset")
except PecsError as e:
    print(f"pecs: {e}", file=sys.stderr)
    sys.exit(e.code)

from .cli import main

sys.exit(main(sys.argv[1:]))
