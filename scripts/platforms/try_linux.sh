#!/usr/bin/env bash
# Tries the core's wheel for Linux (dist/, make_wheels.py --core linux-ARCH) in Python 3.11: pip, the demo, and the hashes
# of events, which must be those of the program for this Linux. x86_64 in a chroot of Debian 11, which has glibc 2.31;
# aarch64 with Debian 12's Python by qemu-user (hours). With --tests also builds and runs the C++ tests of the core.
#   scripts/platforms/try_linux.sh [--tests] x86_64|aarch64    root; keeps the systems in ~/.cache/pecs-systems
source "$(dirname "$0")/../lib.sh"
TESTS=''
[ "${1:-}" != --tests ] || { TESTS=1; shift; }
[[ "${1:-}" =~ ^(x86_64|aarch64)$ ]] || die "try_linux.sh: got ${1:-nothing}, wanted x86_64 or aarch64" 2
TARGET=linux-$1
WHEEL=$(compgen -G "dist/pecs_sim-*-manylinux_2_28_$1.whl") ||
  die "try_linux.sh: dist/pecs_sim-*-manylinux_2_28_$1.whl is missing: make_wheels.py --core $TARGET" 3
[ "$(id -u)" = 0 ] || die "try_linux.sh: chroot requires root" 2
debian_packages debootstrap unzip curl qemu-user-static
PLACE=$(mktemp -d)
trap 'rm -rf "$PLACE"' EXIT
SYSTEMS="${PECS_SYSTEMS:-$HOME/.cache/pecs-systems}" EMULATOR=()
if [ "$1" = x86_64 ]; then
  SYSTEM="$SYSTEMS/bullseye" AT='' PYTHON=/opt/python/bin/python3  # AT: the system's root for who runs in it
  MADE=(bullseye)
  python() {
    unshare --mount --fork bash -ec 'mkdir -p "$0$1"; mount --bind "$1" "$0$1"; mount -t proc proc "$0/proc"
      mount --bind /dev "$0/dev"
      exec chroot "$0" env -i HOME=/root PATH=/usr/bin:/bin LANG=C.UTF-8 PYTHONPATH="$1/scripts/lab:/try/packages" \
        "${@:2}"' "$SYSTEM" "$ROOT" "$PYTHON" "$@"
  }
else
  SYSTEM="$SYSTEMS/bookworm-arm64" PYTHON=usr/bin/python3
  AT=$SYSTEM MADE=(--arch=arm64 --foreign --include=python3-pip bookworm) EMULATOR=(qemu-aarch64-static -L "$SYSTEM")
  python() {
    env -u PECS_LIBRARY -u PECS_DATA LC_ALL=C.UTF-8 PECS_PROGRAM="$PLACE/pecs" \
      PYTHONPATH="$ROOT/scripts/lab:$SYSTEM/try/packages" "${EMULATOR[@]}" "$SYSTEM/$PYTHON" "$@"
  }
fi
PROGRAM="$AT/try/packages/pecs/_lib/bin/pecs"

say "A system, and by pip the wheel ($(du -h "$WHEEL" | cut -f1))"
if [ ! -e "$SYSTEM/ready" ]; then
  rm -rf "$SYSTEM" && mkdir -p "$SYSTEM"
  debootstrap --variant=minbase "${MADE[@]}" "$SYSTEM" >"$SYSTEM.log" 2>&1 ||
    { tail -5 "$SYSTEM.log"; die "try_linux.sh: debootstrap failed"; }
  if [ ${#EMULATOR[@]} -gt 0 ]; then # another processor's packages cannot be configured here
    for deb in "$SYSTEM"/var/cache/apt/archives/*.deb; do
      dpkg-deb --fsys-tarfile "$deb" | tar -x --keep-directory-symlink -C "$SYSTEM"
    done
  else maven_python linux-x86_64 "$SYSTEM/opt/python"; fi
  touch "$SYSTEM/ready"
fi
rm -rf "$SYSTEM/try" && mkdir "$SYSTEM/try"
"$PY" -m pip download -q --platform "manylinux_2_28_$1" --platform "manylinux2014_$1" --python-version 311 \
  --only-binary=:all: -d "$SYSTEM/try" "$WHEEL" \
  $(grep -oE '(numpy|opencv-python-headless)==[0-9.]+' pyproject.toml | sort -u)
python -m pip install -q --no-index --find-links "$AT/try" --target "$AT/try/packages" pecs-sim opencv-python-headless
python -c 'import platform; print("   ", *platform.libc_ver(), platform.machine(), "Python", platform.python_version())'
if [ ${#EMULATOR[@]} -gt 0 ]; then # a process that qemu starts is this machine's: a script, which starts qemu again
  printf '#!/bin/sh\nexec %s "%s" "$@"\n' "${EMULATOR[*]}" "$PROGRAM" >"$PLACE/pecs"
  chmod +x "$PLACE/pecs"
  PROGRAM="$PLACE/pecs"
fi

say "pecs demo"
python -m pecs demo -o "$AT/try/demo äöü 北" | sed -n '/^model/,/^icns/p; /^pecs:/p'

say "Hashes of events"
"$PY" scripts/studies/event_hashes.py -o "$SYSTEM/try/here.json" --program "$PECS"
python "$ROOT/scripts/studies/event_hashes.py" -o "$AT/try/there.json" --program "$PROGRAM" \
  --expected "$AT/try/here.json"

if [ -n "$TESTS" ]; then
  say "C++ tests"
  core_tests "$TARGET" "${EMULATOR[@]}"
fi
say "$TARGET: all there"
