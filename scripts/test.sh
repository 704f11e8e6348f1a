#!/usr/bin/env bash
# Sets up and runs all tests: ctest (C++), pytest (Python, renders with Cycles), the linters, and the fast C++ tests once
# more under the address and undefined-behaviour sanitizers, with mutants of all files that we read (scripts/check.sh has
# the other checks).
source "$(dirname "$0")/lib.sh"
scripts/setup.sh --tests
say "clang-format, ruff"
git ls-files '*.cpp' '*.h' | xargs .venv/bin/clang-format --dry-run --Werror
.venv/bin/ruff check . && .venv/bin/ruff format --check .
say "ctest"
ctest --test-dir build/release --output-on-failure -j "$(nproc)"
say "pytest"
"$PY" -m pytest -q
.venv-datasets/bin/python -m pytest -q tests/python/learning/test_networks.py
scripts/check.sh asan --fast
say "all tests passed"
