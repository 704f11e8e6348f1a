#!/usr/bin/env bash
# Tries the core's wheel for Linux (dist/, make_wheels.py --core linux-ARCH) in Python 3.11 of another system: pip, the
# demo, and the hashes of events, which must be those of the program for this Linux. x86_64 in Debian 11, which has glibc
# 2.31; aarch64 in Debian 12, which the kernel runs by qemu-user (hours). With --tests also builds the C++ tests of the
# core and runs them there.
#   scripts/platforms/try_linux.sh [--tests] x86_64|aarch64    root; keeps the systems in ~/.cache/pecs-systems
source "$(dirname "$0")/../lib.sh"
TESTS=''
[ "${1:-}" != --tests ] || { TESTS=1; shift; }
[[ "${1:-}" =~ ^(x86_64|aarch64)$ ]] || die "try_linux.sh: got ${1:-nothing}, wanted x86_64 or aarch64" 2
TARGET=linux-$1
WHEEL=$(compgen -G "dist/pecs_sim-*-manylinux_2_28_$1.whl") ||
  die "try_linux.sh: dist/pecs_sim-*-manylinux_2_28_$1.whl is missing: make_wheels.py --core $TARGET" 3
[ "$(id -u)" = 0 ] || die "try_linux.sh: chroot requires root" 2
debian_packages debootstrap unzip curl qemu-user-static binfmt-support
SYSTEMS="${PECS_SYSTEMS:-$HOME/.cache/pecs-systems}"
if [ "$1" = x86_64 ]; then
  SYSTEM="$SYSTEMS/bullseye" PYTHON=/opt/python/bin/python3 MADE=(bullseye)
else
  SYSTEM="$SYSTEMS/bookworm-arm64" PYTHON=/usr/bin/python3 MADE=(--arch=arm64 --include=python3-pip bookworm)
  mountpoint -q /proc/sys/fs/binfmt_misc || mount -t binfmt_misc none /proc/sys/fs/binfmt_misc
  update-binfmts --enable qemu-aarch64
fi
there() { # COMMAND...: in the system, with the checkout at its own path
  unshare --mount --fork bash -ec 'mkdir -p "$0$1"; mount --bind "$1" "$0$1"; mount -t proc proc "$0/proc"
    mount --bind /dev "$0/dev"
    exec chroot "$0" env -i HOME=/root PATH=/usr/bin:/bin LANG=C.UTF-8 PYTHONPATH="$1/scripts/lab:/try/packages" \
      "${@:2}"' "$SYSTEM" "$ROOT" "$@"
}
python() { there "$PYTHON" "$@"; }

say "A system, and by pip the wheel ($(du -h "$WHEEL" | cut -f1))"
if [ ! -e "$SYSTEM/ready" ]; then
  rm -rf "$SYSTEM" && mkdir -p "$SYSTEM"
  debootstrap --variant=minbase "${MADE[@]}" "$SYSTEM" >"$SYSTEM.log" 2>&1 ||
    { tail -5 "$SYSTEM.log"; die "try_linux.sh: debootstrap failed"; }
  [ "$1" = aarch64 ] || maven_python linux-x86_64 "$SYSTEM/opt/python"
  touch "$SYSTEM/ready"
fi
rm -rf "$SYSTEM/try" && mkdir "$SYSTEM/try"
"$PY" -m pip download -q --platform "manylinux_2_28_$1" --platform "manylinux2014_$1" --python-version 311 \
  --only-binary=:all: -d "$SYSTEM/try" "$WHEEL" \
  $(grep -oE '(numpy|opencv-python-headless)==[0-9.]+' pyproject.toml | sort -u)
python -m pip install -q --root-user-action=ignore --no-index --find-links /try --target /try/packages \
  pecs-sim opencv-python-headless
python -c 'import platform; print("   ", *platform.libc_ver(), platform.machine(), "Python", platform.python_version())'

say "pecs demo"
python -m pecs demo -o "/try/demo äöü 北" | sed -n '/^model/,/^icns/p; /^pecs:/p'

say "Hashes of events"
"$PY" scripts/studies/event_hashes.py -o "$SYSTEM/try/here.json" --program "$PECS"
python "$ROOT/scripts/studies/event_hashes.py" -o /try/there.json --program /try/packages/pecs/_lib/bin/pecs \
  --expected /try/here.json

if [ -n "$TESTS" ]; then
  say "C++ tests"
  core_tests "$TARGET" there
fi
say "$TARGET: all there"
