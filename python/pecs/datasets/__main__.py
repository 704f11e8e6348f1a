"""`python -m pecs.datasets`."""

from .._command import start

if __name__ == "__main__":
    start("pecs.datasets.cli")
