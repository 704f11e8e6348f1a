#!/usr/bin/env bash
# Installs what PECS needs on Debian 12, and builds it: Debian packages by apt (as root; else it says what to install),
# Python packages into .venv, the program and library into build/release. Can be run again: only what is missing is done.
#   scripts/setup.sh          what the demo needs
#   scripts/setup.sh --tests  also what the tests need
#   scripts/setup.sh --with learning,ros  also the optional packages of the wheel (pyproject.toml), in .venv
source "$(dirname "$0")/lib.sh"
WITH_TESTS=OFF EXTRAS=
case "${1:-}" in
  "") ;;
  --tests) WITH_TESTS=ON ;;
  --with) EXTRAS=${2:-}; [ -n "$EXTRAS" ] || die "setup.sh: --with: got nothing, wanted names, such as learning,ros" 2 ;;
  *) die "setup.sh: got $1, wanted --tests, --with NAMES or nothing" 2 ;;
esac

PACKAGES=(g++ cmake ninja-build pkg-config git python3 python3-venv
  libopenexr-dev libhdf5-dev libopencv-dev libavformat-dev nlohmann-json3-dev libfmt-dev libcli11-dev libtbb-dev
  libopencolorio-dev libeigen3-dev libceres-dev libhwy-dev libdeflate-dev libzstd-dev liblz4-dev libzip-dev libblosc-dev libpugixml-dev
  libflatbuffers-dev flatbuffers-compiler librsvg2-dev fonts-dejavu-core
  # bpy's own needs
  libx11-6 libxi6 libxxf86vm1 libxfixes3 libxrender1 libxkbcommon0 libsm6 libice6 libgl1 libegl1)
[ "$WITH_TESTS" = ON ] && PACKAGES+=(ccache libgtest-dev python3-torch python3-torchvision libgl1-mesa-dri)

say "Debian packages"
debian_packages "${PACKAGES[@]}"
# Booting makes it; in a bare chroot, where nothing booted, Blender complains of its absence at every start.
[ -e /etc/mtab ] || [ "$(id -u)" != 0 ] || ln -s ../proc/self/mounts /etc/mtab

say "Python packages (.venv)"
[ -x "$PY" ] || /usr/bin/python3.11 -m venv .venv
if [ "$WITH_TESTS" = ON ] || grep -qs '^test' .venv/pecs-current; then
  python_packages .venv test test-no-deps
else
  python_packages .venv run
fi
use_checkout .venv/bin/python
if [ -n "$EXTRAS" ]; then
  say "Optional packages ($EXTRAS)"
  optional_packages "$PY" "$EXTRAS"
fi

if [ "$WITH_TESTS" = ON ]; then
  say "Third-party readers of data sets (.venv-datasets)"
  [ -x .venv-datasets/bin/python ] || /usr/bin/python3.11 -m venv --system-site-packages .venv-datasets
  python_packages .venv-datasets datasets datasets-no-deps
  use_checkout .venv-datasets/bin/python

  say "Blender 5 (.venv-blender5)"
  [ -x .venv-blender5/bin/python ] || /usr/bin/python3.11 -m venv .venv-blender5
  python_packages .venv-blender5 blender5
  use_checkout .venv-blender5/bin/python
fi

say "Program (build/release)"
[ "$WITH_TESTS" = OFF ] && grep -qs 'PECS_BUILD_TESTS:BOOL=ON' build/release/CMakeCache.txt && WITH_TESTS=ON
cmake --preset release -DPECS_BUILD_TESTS=$WITH_TESTS -DPECS_BUILD_FUZZERS=$WITH_TESTS \
  -DPECS_WERROR=$([ "${CI:-}" = true ] && echo ON || echo OFF) >build.log 2>&1 || { cat build.log; die "setup.sh: cmake failed"; }
rm build.log
cmake --build --preset release
echo "ready: build/release/bin/pecs ($("$PECS" --version)), .venv/bin/python"
