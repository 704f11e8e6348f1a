#!/usr/bin/env bash
# Builds the fuzzers (tests/fuzz, with clang) and runs each on the seeds that our own writers make, with those of
# earlier runs, as many at once as there are cores: what is found stands in out/fuzz/found.
#   scripts/fuzz.sh [SECONDS [TARGET...]]   seconds for each (default 10); targets: evt3, chip, … (default all)
source "$(dirname "$0")/lib.sh"
SECONDS_EACH=${1:-10}
[[ "$SECONDS_EACH" =~ ^[1-9][0-9]*$ ]] || die "fuzz.sh: got $SECONDS_EACH, wanted seconds" 2
command -v clang++-16 >/dev/null && ls /usr/lib/llvm-16/lib/clang/*/lib/linux/libclang_rt.fuzzer-*.a >/dev/null 2>&1 ||
  die "fuzz.sh: missing clang 16 (14 does not know all of C++20); run as root: apt-get install -y --no-install-recommends clang-16 libclang-rt-16-dev llvm-16" 3
BUILD="$ROOT/build/fuzz" FUZZ="$ROOT/out/fuzz"

say "Fuzzers (build/fuzz)"
cmake --preset fuzz >/dev/null || die "fuzz.sh: cmake failed"
cmake --build "$BUILD" --target fuzzers >"$BUILD/build.log" 2>&1 || { tail -30 "$BUILD/build.log"; die "fuzz.sh: the build failed"; }
mkdir -p "$FUZZ/found" "$FUZZ/corpus"
PECS_DATA="$ROOT" "$BUILD/bin/fuzz_seeds" "$FUZZ/seeds"

# Other libraries leak on damaged files; HDF5 keeps lists of what it freed. Inputs are short: 8 MiB of freed
# memory are watched for long enough, and 256 MiB of it would only be page faults.
export ASAN_OPTIONS=detect_leaks=0:allocator_may_return_null=0:quarantine_size_mb=8 UBSAN_OPTIONS=print_stacktrace=1

# run TARGET
run() {
  local target=$1 log="$FUZZ/$1.log" words="$BUILD/fuzz_words/$1.dict"
  [ -e "$words" ] || words=
  mkdir -p "$FUZZ/corpus/$target"
  if PECS_DATA="$ROOT" "$BUILD/bin/fuzz_$target" -max_total_time="$SECONDS_EACH" -timeout=20 -rss_limit_mb=2048 -max_len=20000 \
    -artifact_prefix="$FUZZ/found/$target-" ${words:+-dict="$words"} \
    "$FUZZ/corpus/$target" "$FUZZ/seeds/$target" $(ls -d "$ROOT/tests/fuzz/corpus/$target" 2>/dev/null) >"$log" 2>&1; then
    say "$target: $(grep -oE 'Done [0-9]+ runs' "$log"), $(grep -oE 'cov: [0-9]+' "$log" | tail -1)"
  else
    say "$target: FAILED ($log)"
    grep -E -m3 'ERROR|fuzz:|runtime error' "$log" || true
    return 1
  fi
}

TARGETS=("${@:2}")
[ ${#TARGETS[@]} -gt 0 ] || mapfile -t TARGETS < <(cd "$BUILD/bin" && ls fuzz_* | grep -v fuzz_seeds | sed 's/^fuzz_//')
failed=() ; declare -A target_of=()
reap() {  # waits for one of those that run
  local pid
  if ! wait -n -p pid; then failed+=("${target_of[$pid]}"); fi
  unset "target_of[$pid]"
}
for target in "${TARGETS[@]}"; do
  [ ${#target_of[@]} -lt "$(nproc)" ] || reap
  run "$target" & target_of[$!]=$target
done
while [ ${#target_of[@]} -gt 0 ]; do reap; done
[ ${#failed[@]} = 0 ] || die "fuzz.sh: found something in ${failed[*]}; the inputs are in out/fuzz/found"
