"""`python -m pecs.fit`."""

from .._command import start

if __name__ == "__main__":
    start("pecs.fit.cli")
