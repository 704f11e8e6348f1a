"""`python -m pecs.datasets RECIPE.toml -o SET`, which `pecs dataset` runs."""

import sys

from .cli import main

sys.exit(main(sys.argv[1:]))
