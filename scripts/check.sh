#!/usr/bin/env bash
# Finds what tests alone do not. Each check builds in a folder of its own (build/asan, build/tsan, build/tidy), installs
# what it needs as scripts/setup.sh does, shows progress, and can be run again: what is current is not built twice.
#   scripts/check.sh asan           memory and undefined behaviour (GCC's sanitizers): all C++ tests, mutants of each
#                                   fuzzer's corpus (tests/fuzz), and the Python tests of the C interface
#   scripts/check.sh tsan           data races: lens, compare and sensor tests, with a oneTBB built for it from Debian's
#                                   source package
#   scripts/check.sh tidy           clang-tidy over all C++ sources; .clang-tidy says which checks, and why not the others
#   scripts/check.sh docs           the documentation site with warnings as errors, and its links: scripts/docs.sh
#   scripts/check.sh fuzz [SECONDS] every fuzzer for so many seconds: scripts/fuzz.sh
source "$(dirname "$0")/lib.sh"
CHECK=${1:-} OPTION=${2:-}
JOBS=$(nproc)
RUN=()  # a command before those that start what was built

# build PRESET TARGET... [-- NINJA_OPTION...]
build() {
  local preset=$1 ; shift
  say "build/$preset" ; mkdir -p build
  cmake --preset "$preset" >"build/$preset.log" 2>&1 || { cat "build/$preset.log"; die "check.sh: cmake failed"; }
  "${RUN[@]}" cmake --build --preset "$preset" -j "$JOBS" --target "$@"
}

# run_tests PRESET PART...: the C++ tests of these parts.
run_tests() {
  local preset=$1 ; shift
  say "C++ tests of $*"
  "${RUN[@]}" ctest --test-dir "build/$preset" --output-on-failure --no-tests=error -j "$JOBS" -R "^test_($(IFS='|'; echo "$*"))\."
}

check_asan() {
  export ASAN_OPTIONS=detect_stack_use_after_return=1:strict_string_checks=1 UBSAN_OPTIONS=print_stacktrace=1
  build asan tests/all python/c/all fuzzers
  run_tests asan calibration common events fuzz lens metrics sensor view
  say "Python tests of the C interface"
  # Tests that load libpecs, and neither bpy, which brings a TBB of its own, nor the wheel or an installed tree, which
  # have another libpecs, and start no other programs (data sets, `pecs`): with the sanitizer those hang when they end,
  # in p11-kit, which HDF5 brings.
  local tests
  tests=$(grep -rlE --include='test_*.py' '^(import pecs$|from pecs )' tests/python | xargs grep -LE 'bpy|pecs_blender|wheel|cmake|pecs.datasets|pecs_program|pecs.program')
  # Python itself is not instrumented: the sanitizer comes first, and the C++ library whose exceptions it watches. What
  # Python leaves allocated at its end is no leak of ours.
  # shellcheck disable=SC2086
  LD_PRELOAD="$(g++ -print-file-name=libasan.so) $(g++ -print-file-name=libstdc++.so)" \
    ASAN_OPTIONS=$ASAN_OPTIONS:detect_leaks=0 PECS_LIBRARY="$ROOT/build/asan/lib/libpecs.so" "$PY" -m pytest -q $tests
}

# A oneTBB of the installed version that the thread sanitizer can look into.
build_tbb() {
  local folder="$ROOT/build/tsan-tbb" version
  [ -e "$folder/ready" ] && return
  debian_packages dpkg-dev
  version=$(dpkg-query -W -f='${Version}' libtbb-dev)
  say "oneTBB $version with the thread sanitizer (build/tsan-tbb)"
  rm -rf "$folder"
  debian_source "$folder" "onetbb=$version"
  cmake -S "$folder"/onetbb-*/ -B "$folder/build" -G Ninja -DCMAKE_BUILD_TYPE=RelWithDebInfo -DTBB_SANITIZE=thread \
    -DTBB_TEST=OFF -DTBB_STRICT=OFF -DTBBMALLOC_BUILD=OFF -DCMAKE_INSTALL_PREFIX="$folder" -DCMAKE_INSTALL_LIBDIR=lib
  cmake --build "$folder/build" -j "$JOBS" --target install
  touch "$folder/ready"
}

check_tsan() {
  build_tbb
  RUN=(setarch "$(uname -m)" -R)  # the sanitizer's shadow memory requires fixed addresses
  local known=("$ROOT"/build/tsan-tbb/onetbb-*/cmake/suppressions/tsan.suppressions)
  export TSAN_OPTIONS="halt_on_error=1:second_deadlock_stack=1:suppressions=${known[0]}"
  build tsan test_lens test_metrics test_sensor
  ldd build/tsan/bin/test_sensor | grep -q build/tsan-tbb/lib/libtbb ||
    die "check.sh: build/tsan uses the system's oneTBB, wanted build/tsan-tbb: rm -r build/tsan"
  run_tests tsan lens metrics sensor
}

check_tidy() {
  debian_packages clang-19 clang-tidy-19
  build tidy all -- -k 0  # to the last file, whatever the first ones say
}

case "$CHECK $OPTION" in
  "asan ") scripts/setup.sh --tests; check_asan ;;
  "tsan ") scripts/setup.sh --tests; check_tsan ;;
  "tidy ") scripts/setup.sh --tests; check_tidy ;;
  "docs ") exec scripts/docs.sh ;;
  fuzz*)
    debian_packages clang-16 libclang-rt-16-dev llvm-16
    exec scripts/fuzz.sh "${@:2}"
    ;;
  *) die "check.sh: got ${*:-nothing}, wanted asan, tsan, tidy, docs or fuzz [SECONDS]" 2 ;;
esac
say "$CHECK: nothing found"
