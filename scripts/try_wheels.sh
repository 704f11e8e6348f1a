#!/usr/bin/env bash
# Installs the wheels of dist/ (scripts/make_wheels.py) as a stranger would: in bare systems that have python3-venv and
# nothing else of ours, by pip. Then it runs `pecs demo` and the examples, and says how long each step took. Needs root and
# debootstrap; the systems are kept in ~/.cache/pecs-systems.
#   scripts/try_wheels.sh [SUITE...]           default: bookworm trixie sid
#   scripts/try_wheels.sh --beside             in a bookworm of its own: every module beside torch, OpenCV, bpy and tonic in one process
#   scripts/try_wheels.sh --container          scripts/packaging/container/Containerfile, line by line in a chroot
#   scripts/try_wheels.sh --blender [SUITE...] also pecs-blender with bpy, and `pecs demo --blender`
source "$(dirname "$0")/lib.sh"
SYSTEMS="${PECS_SYSTEMS:-$HOME/.cache/pecs-systems}"
BESIDE='' BLENDER='' CONTAINER=''
while [[ "${1:-}" == --* ]]; do
  case $1 in --beside) BESIDE=1 ;; --blender) BLENDER=1 ;; --container) CONTAINER=1 ;; *) die "try_wheels.sh: got $1" 2 ;; esac
  shift
done
[ $# -gt 0 ] || set -- bookworm trixie sid
[ "$(id -u)" = 0 ] || die "try_wheels.sh: needs root for chroot" 2
compgen -G 'dist/pecs-*.whl' >/dev/null || die "try_wheels.sh: dist/pecs-*.whl is missing: scripts/make_wheels.py" 3
debian_packages debootstrap

# system SUITE: a bare Debian with python3-venv, made once.
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
  reach_network "$root"
}

# reach_network ROOT: as this machine does.
reach_network() {
  local root=$1
  cp /etc/resolv.conf "$root/etc/"
  cp /etc/ssl/certs/ca-certificates.crt "$root/etc/ssl/certs/"
  cp -n /etc/apt/apt.conf.d/*proxy* "$root/etc/apt/apt.conf.d/" 2>/dev/null || true
}

# inside SUITE COMMAND: in a process namespace of its own, with its own /proc and /dev.
inside() {
  unshare --mount --fork bash -c 'mount -t proc proc "$0/proc"; mount --bind /dev "$0/dev"; mount -t tmpfs tmpfs "$0/dev/shm" 2>/dev/null
    cd "$0"; exec chroot "$0" env -i HOME=/root PATH=/usr/sbin:/usr/bin:/sbin:/bin LANG=C.UTF-8 \
      ${https_proxy:+https_proxy="$https_proxy"} ${http_proxy:+http_proxy="$http_proxy"} \
      PIP_CERT=/etc/ssl/certs/ca-certificates.crt PIP_DISABLE_PIP_VERSION_CHECK=1 bash -ec "$1"' "$SYSTEMS/$1" "$2"
}

# timed NAME SUITE COMMAND: says the time on the clock, the CPU time, and how many processes wanted to run (load).
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
  local wheels='dist/pecs-*.whl'
  [ -z "$BLENDER" ] || wheels+=' dist/pecs_blender-*.whl'
  inside "$suite" 'for p in OpenEXR OpenCV libhdf5 libtbb; do ! ls /usr/lib/*/ | grep -qi $p; done' || die "$suite: not bare"
  timed "venv" "$suite" 'cd; python3 -m venv v'
  timed "download" "$suite" "cd; v/bin/pip download -q -d got --find-links dist $wheels"
  timed "pip install" "$suite" "cd; v/bin/pip install -q --no-index --find-links got $wheels"
  timed "pecs demo" "$suite" 'cd; v/bin/pecs demo'
  grep -A7 '^model' "$SYSTEMS/$suite.log"
  inside "$suite" 'cd; ls -s pecs-demo/* | grep -E "png|mp4|html|raw$|aedat4"; ! grep -c dejavu /etc/fonts 2>/dev/null' | sed 's/^/    /'
  timed "examples" "$suite" 'cd; . v/bin/activate; for e in examples/*.py; do echo "$e"; python "$e"; done; pecs info bar.raw'
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

# In one process, pecs first and pecs last: do the libraries of one get in the way of another?
beside() {
  local suite=beside order
  if [ ! -e "$SYSTEMS/beside/ready" ]; then
    system bookworm
    rm -rf "$SYSTEMS/beside" && cp -a "$SYSTEMS/bookworm" "$SYSTEMS/beside"
  fi
  reach_network "$SYSTEMS/beside"
  say "bookworm: beside torch, OpenCV, bpy, tonic"
  inside "$suite" 'apt-get update -qq; DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends python3-torch \
    libx11-6 libxi6 libxxf86vm1 libxfixes3 libxrender1 libxkbcommon0 libsm6 libice6 libgl1 libegl1 libglib2.0-0 >/dev/null'
  mkdir -p "$SYSTEMS/$suite/root/dist" && cp dist/*.whl "$SYSTEMS/$suite/root/dist/"
  inside "$suite" 'cd; rm -rf b; python3 -m venv --system-site-packages b
    b/bin/pip install -q --find-links dist "$(echo dist/pecs-*.whl)[datasets]"
    b/bin/pip install -q --no-deps bpy==4.5.15 dist/pecs_blender-*.whl numpy==1.26.4 tonic importRosbag tqdm expelliarmus cattrs attrs requests'
  for order in 'pecs torch cv2 bpy tonic' 'bpy tonic cv2 torch pecs' 'torch pecs bpy cv2 tonic'; do
    inside "$suite" "cd; b/bin/python -c '
import importlib
for name in \"$order\".split(): importlib.import_module(name)
$EVERY_MODULE
import cv2, bpy, torch, numpy
pecs.simulate(numpy.random.default_rng(1).random((20, 40, 60), numpy.float32), 1000.0 * numpy.arange(20))
cv2.GaussianBlur(numpy.zeros((99, 99), numpy.float32), (9, 9), 2); torch.ones(64, 64) @ torch.ones(64, 64)
bpy.ops.wm.read_factory_settings()
pecs.Lens(\"pecs_lab_15mm\").info()
import os; os._exit(0)'" || die "try_wheels.sh: $order"
    echo "in this order: $order"
  done
}

# The container file without a container engine: each line does in a chroot what it says.
container() {
  local word rest root="$SYSTEMS/container" setting=() path=/usr/bin:/bin
  while read -r word rest; do
    case $word in
      FROM)
        suite=${rest#debian:} suite=${suite%-slim}
        system "$suite"
        rm -rf "$root" && cp -a "$SYSTEMS/$suite" "$root"
        ;;
      COPY)
        # shellcheck disable=SC2086
        cp ${rest% *} "$root${rest##* }"
        ;;
      RUN) inside container "$rest" ;;
      ENV) setting+=("$rest") ;;
      WORKDIR) mkdir -p "$root$rest"; path=$rest ;;
      ENTRYPOINT) say "container: $rest demo"; inside container "export ${setting[*]}; cd $path; $(tr -d '[],"' <<<"$rest") demo" ;;
      CMD | '#'* | '') ;;
      *) die "try_wheels.sh: Containerfile: got $word" ;;
    esac
  done <scripts/packaging/container/Containerfile
}

[ -z "$CONTAINER" ] || { container; exit 0; }
[ -z "$BESIDE" ] || { beside; exit 0; }
for suite in "$@"; do try "$suite"; done
