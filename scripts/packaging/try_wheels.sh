#!/usr/bin/env bash
# Installs the wheels of dist/ (make_wheels.py) by pip in bare systems that have only python3-venv. Then it runs `pecs demo`
# and the examples, and prints the time of each step. Requires root and debootstrap; keeps the systems in ~/.cache/pecs-systems.
#   scripts/packaging/try_wheels.sh [--blender] [SUITE...]    default: bookworm trixie sid
#   --blender: also installs pecs-blender with bpy and runs `pecs demo --blender`
source "$(dirname "$0")/../lib.sh"
SYSTEMS="${PECS_SYSTEMS:-$HOME/.cache/pecs-systems}"
BLENDER=''
[ "${1:-}" != --blender ] || { BLENDER=1; shift; }
[ $# -gt 0 ] || set -- bookworm trixie sid
[ "$(id -u)" = 0 ] || die "try_wheels.sh: chroot requires root" 2
compgen -G 'dist/pecs_sim-*.whl' >/dev/null || die "try_wheels.sh: dist/pecs_sim-*.whl is missing; run scripts/packaging/make_wheels.py" 3
debian_packages debootstrap

# system SUITE: makes a bare Debian with python3-venv, once, and gives it this machine's network settings.
system() {
  local root="$SYSTEMS/$1" mirror
  mirror=$(grep -hsE '^URIs' /etc/apt/sources.list.d/debian.sources | awk '{print $2}' | head -1)
  [ -n "$mirror" ] || mirror=$(awk '/^deb /{print $2; exit}' /etc/apt/sources.list)
  if [ ! -e "$root/ready" ]; then
    say "$1: a bare system"
    rm -rf "$root" && mkdir -p "$root"
    debootstrap --variant=minbase --include=python3-venv,ca-certificates "$1" "$root" "$mirror" >"$SYSTEMS/$1.log" 2>&1 ||
      { tail -5 "$SYSTEMS/$1.log"; die "try_wheels.sh: debootstrap failed"; }
    touch "$root/ready"
  fi
  cp /etc/resolv.conf "$root/etc/"
  cp /etc/ssl/certs/ca-certificates.crt "$root/etc/ssl/certs/"
  cp -n /etc/apt/apt.conf.d/*proxy* "$root/etc/apt/apt.conf.d/" 2>/dev/null || true
}

# inside SUITE COMMAND: runs it in a chroot with its own mounts of /proc and /dev.
inside() {
  unshare --mount --fork bash -c 'mount -t proc proc "$0/proc"; mount --bind /dev "$0/dev"; mount -t tmpfs tmpfs "$0/dev/shm" 2>/dev/null
    cd "$0"; exec chroot "$0" env -i HOME=/root PATH=/usr/sbin:/usr/bin:/sbin:/bin LANG=C.UTF-8 \
      ${https_proxy:+https_proxy="$https_proxy"} ${http_proxy:+http_proxy="$http_proxy"} \
      PIP_CERT=/etc/ssl/certs/ca-certificates.crt PIP_DISABLE_PIP_VERSION_CHECK=1 bash -ec "$1"' "$SYSTEMS/$1" "$2"
}

# timed NAME SUITE COMMAND: prints wall time, CPU time and load average.
timed() {
  local TIMEFORMAT='%R %U %S' taken
  taken=$({ time inside "$2" "$3" >"$SYSTEMS/$2.log" 2>&1; } 2>&1) || { tail -20 "$SYSTEMS/$2.log"; die "try_wheels.sh: $2: $1 failed"; }
  awk -v suite="$2" -v name="$1" -v load="$(cut -d' ' -f1 /proc/loadavg)" \
    '{ printf "%-10s %-22s %6.1f s, %6.1f s of CPU, load %s\n", suite, name, $1, $2 + $3, load }' <<<"$taken"
}

try() {
  local suite=$1 root="$SYSTEMS/$1"
  system "$suite"
  rm -rf "$root/root" && mkdir -p "$root/root/dist"
  cp dist/*.whl "$root/root/dist/"
  cp -r examples "$root/root/"
  say "$suite: $(inside "$suite" 'python3 --version; ldd --version | head -1' | tr '\n' ' ')"
  local wheels="pecs-sim==$(cat VERSION)"  # dist/ may also have the core's wheels, of other systems
  [ -z "$BLENDER" ] || wheels+=" pecs-blender==$(cat VERSION)"
  inside "$suite" 'for p in OpenEXR OpenCV libhdf5 libtbb; do ! ls /usr/lib/*/ | grep -qi $p; done' || die "$suite: not bare"
  timed "venv" "$suite" 'cd; python3 -m venv v'
  timed "download" "$suite" "cd; v/bin/pip download -q -d got --find-links dist $wheels"
  timed "pip install" "$suite" "cd; v/bin/pip install -q --no-index --find-links got $wheels"
  timed "pecs demo" "$suite" 'cd; v/bin/pecs demo'
  grep -A7 '^model' "$SYSTEMS/$suite.log"
  inside "$suite" 'cd; ls -s pecs-demo/* | grep -E "png|mp4|html|raw$|aedat4"; ! grep -c dejavu /etc/fonts 2>/dev/null' | sed 's/^/    /'
  timed "examples" "$suite" 'cd; . v/bin/activate; for e in examples/*/*.py; do echo "$e"; python "$e"; done; pecs info bar.raw'
  timed "every module" "$suite" "cd; v/bin/python -c '$EVERY_MODULE'"
  [ -z "$BLENDER" ] || timed "pecs demo --blender" "$suite" 'cd; v/bin/pecs demo --blender -o blender-demo'
}

EVERY_MODULE='
import importlib, pkgutil, pecs
optional = {"h5py", "cv2", "pycocotools", "scipy", "torch", "bpy"}
names = [m.name for m in pkgutil.walk_packages(pecs.__path__, "pecs.", onerror=lambda name: None) if not m.name.endswith("__main__")]
for name in names:
    try:
        importlib.import_module(name)
    except ModuleNotFoundError as e:
        if e.name.split(".")[0] not in optional: raise
        print(name, "needs", e.name)
print(len(names), "modules")
'

for suite in "$@"; do try "$suite"; done
