"""`python -m pecs.learning`."""

from .._command import start

if __name__ == "__main__":
    start("pecs.learning.cli")
