#!/usr/bin/env bash
# Builds the libraries of PECS's core (versions.txt), static, for one platform, which a toolchain file here describes:
#   scripts/platforms/dependencies.sh TARGET    windows-x86_64, linux-x86_64, linux-aarch64, macos-arm64, macos-x86_64
# They go to ~/.cache/pecs-dependencies/TARGET, where the toolchain file finds them; PECS_DEPENDENCIES names another folder
# than ~/.cache/pecs-dependencies. What is there in its version, for this toolchain, stays. Ten minutes of CPU.
source "$(dirname "$0")/../lib.sh"
HERE="$ROOT/scripts/platforms"
TARGET=${1:-} TOOLCHAIN="$HERE/${1:-}.cmake"
[[ "$TARGET" = *-* ]] && [ -f "$TOOLCHAIN" ] ||
  die "dependencies.sh: got '$TARGET', wanted a toolchain file of scripts/platforms, without .cmake" 2
export PECS_DEPENDENCIES="${PECS_DEPENDENCIES:-$HOME/.cache/pecs-dependencies}"
PREFIX="$PECS_DEPENDENCIES/$TARGET" SOURCES="$PECS_DEPENDENCIES/sources"
POOL=${PECS_POOL:-https://deb.debian.org/debian/pool/main}
mkdir -p "$PREFIX/ready" "$PREFIX/build" "$PREFIX/licences" "$SOURCES"

# source_of NAME: unpacks the source with Debian's patches in $SOURCE.
source_of() {
  local name version pack source patches folder file
  read -r name version pack source patches < <(grep "^$1 " "$HERE/versions.txt")
  case $name in lib*) folder=${name:0:4} ;; *) folder=${name:0:1} ;; esac
  file="${name}_${version%-*}.orig.tar.$pack"
  fetched "$POOL/$folder/$name/$file" "$source" "$SOURCES"
  rm -rf "$SOURCE" && mkdir -p "$SOURCE"
  tar -xf "$SOURCES/$file" -C "$SOURCE" --strip-components 1
  [ "$patches" != - ] || { mkdir "$SOURCE/debian" && cp "$SOURCE/COPYING" "$SOURCE/debian/copyright" && return; }
  file="${name}_$version.debian.tar.xz"
  fetched "$POOL/$folder/$name/$file" "$patches" "$SOURCES"
  tar -xf "$SOURCES/$file" -C "$SOURCE"
  [ ! -f "$SOURCE/debian/patches/series" ] || sed 's/#.*//' "$SOURCE/debian/patches/series" | while read -r file; do
    [ -z "$file" ] || patch -d "$SOURCE" -p1 -s -N <"$SOURCE/debian/patches/$file"
  done
}

# library NAME [-S FOLDER] [-e FILE EDIT]... [CMAKE_OPTION=VALUE...]: builds and installs one of versions.txt, unless it is there.
library() {
  local name=$1 key folder=. edits=() options=() started=$SECONDS; shift
  key=$( (grep -E "^($name|ziglang) " "$HERE/versions.txt"; cat "$TOOLCHAIN"; echo "$@") | cksum)
  [ "$(cat "$PREFIX/ready/$name" 2>/dev/null)" != "$key" ] || return 0
  [ "${1:-}" != -S ] || { folder=$2; shift 2; }
  while [ "${1:-}" = -e ]; do edits+=("$2" "$3"); shift 3; done
  for option in "$@"; do options+=("-D$option"); done
  SOURCE="$PREFIX/build/$name" LOG="$PREFIX/build/$name.log"
  (source_of "$name") >"$LOG" 2>&1 || { tail -20 "$LOG"; die "dependencies.sh: $name: no source"; }
  set -- ${edits[@]+"${edits[@]}"}
  while [ $# -gt 0 ]; do sed -i.old "$2" "$SOURCE/$1"; shift 2; done
  { cmake -S "$SOURCE/$folder" -B "$SOURCE/pecs" -G Ninja -DCMAKE_TOOLCHAIN_FILE="$TOOLCHAIN" -DCMAKE_BUILD_TYPE=Release \
      -DCMAKE_INSTALL_PREFIX="$PREFIX" -DCMAKE_INSTALL_LIBDIR=lib -DBUILD_SHARED_LIBS=OFF -DBUILD_TESTING=OFF \
      -DCMAKE_POSITION_INDEPENDENT_CODE=ON -DCMAKE_EXPORT_NO_PACKAGE_REGISTRY=ON ${options[@]+"${options[@]}"} &&
    cmake --build "$SOURCE/pecs" ${JOBS:+-j "$JOBS"} --target install; } >>"$LOG" 2>&1 ||
    { tail -30 "$LOG"; die "dependencies.sh: $name: not built; $LOG"; }
  [ "$name" = googletest ] || cp "$SOURCE/debian/copyright" "$PREFIX/licences/$name.txt"
  [ -n "${PECS_KEEP:-}" ] || rm -rf "$SOURCE"
  printf '%s' "$key" >"$PREFIX/ready/$name"
  printf '%-16s %4d s\n' "$name" $((SECONDS - started))
}

[ "$(uname)" != Linux ] || debian_packages curl patch bzip2 xz-utils cmake ninja-build pkg-config flatbuffers-compiler python3-pip
# The compiler, and the licences of its runtime, which is inside what it links.
case $TARGET in
  linux-*)
    read -r _ version _ sum _ < <(grep '^ziglang ' "$HERE/versions.txt")
    [ -d "$PECS_DEPENDENCIES/zig/ziglang-$version.dist-info" ] || python3 -m pip install -q --no-deps --upgrade --require-hashes \
      --target "$PECS_DEPENDENCIES/zig" -r <(echo "ziglang==$version --hash=sha256:$sum")
    cp "$PECS_DEPENDENCIES/zig/ziglang/lib/libcxx/LICENSE.TXT" "$PREFIX/licences/libcxx.txt" ;;
  windows-*)
    debian_packages g++-mingw-w64-x86-64-posix
    cp /usr/share/doc/gcc-mingw-w64-base/copyright "$PREFIX/licences/libstdc++.txt"
    cp /usr/share/doc/mingw-w64-x86-64-dev/copyright "$PREFIX/licences/mingw-w64.txt" ;;
esac

library fmtlib FMT_TEST=OFF FMT_DOC=OFF
library nlohmann-json3 JSON_BuildTests=OFF
library eigen3 EIGEN_BUILD_DOC=OFF EIGEN_BUILD_PKGCONFIG=ON CMAKE_Fortran_COMPILER=NOTFOUND
library cli11 CLI11_BUILD_TESTS=OFF CLI11_BUILD_EXAMPLES=OFF CLI11_BUILD_DOCS=OFF CLI11_SINGLE_FILE=OFF
library highway -e CMakeLists.txt '/vqsort_\*\.cc/d; /vqsort\.cc/d' HWY_ENABLE_TESTS=OFF HWY_ENABLE_EXAMPLES=OFF  # without the sorts, which take minutes to compile
# Clang 22 has no EVEX512.
library libdeflate -e lib/x86/cpu_features.h 's/!defined(__EVEX512__)/0/' LIBDEFLATE_BUILD_SHARED_LIB=OFF LIBDEFLATE_BUILD_GZIP=OFF
# No option leaves out its shared library and programs, or names the static library libz on Windows.
library zlib -e CMakeLists.txt 's/(zlib SHARED/& EXCLUDE_FROM_ALL/; s/add_executable([a-z0-9]*/& EXCLUDE_FROM_ALL/; s/TARGETS zlib /TARGETS /; s/if(UNIX)/if(NOT MSVC)/; /If present will override/d'
library imath
library openexr OPENEXR_BUILD_TOOLS=OFF OPENEXR_INSTALL_EXAMPLES=OFF OPENEXR_INSTALL_TOOLS=OFF
library onetbb TBB_TEST=OFF TBB_STRICT=OFF TBBMALLOC_BUILD=OFF TBB_DISABLE_HWLOC_AUTOMATIC_SEARCH=ON
library pugixml
library flatbuffers FLATBUFFERS_BUILD_TESTS=OFF FLATBUFFERS_BUILD_FLATC="$([[ "$TARGET" = macos* ]] && echo ON || echo OFF)" FLATBUFFERS_BUILD_FLATLIB=OFF
library lz4 -S build/cmake LZ4_BUILD_CLI=OFF LZ4_BUILD_LEGACY_LZ4C=OFF
library libzstd -S build/cmake ZSTD_BUILD_PROGRAMS=OFF ZSTD_BUILD_SHARED=OFF ZSTD_LEGACY_SUPPORT=OFF
# On Windows, threads of the toolchain, as all else has; before GCC 13, _xgetbv needs -mxsave.
library c-blosc -e blosc/blosc.c '60s/_WIN32/_MSC_VER/; s/!defined(_WIN32)/!defined(_MSC_VER)/' -e blosc/CMakeLists.txt 's/ win32.pthread.c//' \
  -e blosc/shuffle.c 's/defined(_IMMINTRIN_H_INCLUDED)/0/' -e blosc.pc.in 's/^Requires:/& liblz4 libzstd zlib/' \
  BUILD_SHARED=OFF BUILD_TESTS=OFF BUILD_FUZZERS=OFF BUILD_BENCHMARKS=OFF DEACTIVATE_SNAPPY=ON \
  PREFER_EXTERNAL_LZ4=ON PREFER_EXTERNAL_ZLIB=ON PREFER_EXTERNAL_ZSTD=ON
library libzip BUILD_TOOLS=OFF BUILD_REGRESS=OFF BUILD_EXAMPLES=OFF BUILD_DOC=OFF ENABLE_COMMONCRYPTO=OFF ENABLE_GNUTLS=OFF \
  ENABLE_MBEDTLS=OFF ENABLE_OPENSSL=OFF ENABLE_WINDOWS_CRYPTO=OFF ENABLE_BZIP2=OFF ENABLE_LZMA=OFF
library hdf5 HDF5_BUILD_TOOLS=OFF HDF5_BUILD_EXAMPLES=OFF HDF5_BUILD_HL_LIB=OFF HDF5_BUILD_CPP_LIB=OFF HDF5_ENABLE_SZIP_SUPPORT=OFF \
  HDF5_ENABLE_Z_LIB_SUPPORT=ON
library googletest
say "$PREFIX is ready"
