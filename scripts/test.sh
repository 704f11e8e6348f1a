#!/usr/bin/env bash
# Sets up and runs all tests: the linters, ctest (C++ tests, and mutants of every input format: tests/fuzz) and pytest
# (Python, renders with Cycles; four processes, as some wait). scripts/check.sh has the longer checks, such as sanitizers.
source "$(dirname "$0")/lib.sh"
scripts/setup.sh --tests
say "clang-format, ruff"
git ls-files '*.cpp' '*.h' | xargs .venv/bin/clang-format --dry-run --Werror
.venv/bin/ruff check . && .venv/bin/ruff format --check .
say "ctest"
ctest --test-dir build/release --output-on-failure -j "$(nproc)"
say "pytest"
"$PY" -m pytest -q -n 4 --dist loadfile --no-loadscope-reorder
.venv-datasets/bin/python -m pytest -q tests/python/learning/test_networks.py
say "pytest with Blender 5"
.venv-blender5/bin/python -m pytest -q -n 4 --dist loadfile tests/python/render/test_{blend,cuts,jobs,place}.py
say "all tests passed"
