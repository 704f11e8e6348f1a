#!/usr/bin/env bash
# Builds the Debian packages of scripts/packaging/debian from what is committed, into dist/debian, and asks lintian about them.
# Needs the packages of scripts/setup.sh; it takes as long as a build of PECS.
#   scripts/packaging/make_debian.sh
source "$(dirname "$0")/../lib.sh"
debian_packages debhelper dh-python dpkg-dev fakeroot lintian
VERSION=$(cut -d' ' -f1 VERSION)
OUT="$ROOT/dist/debian"
rm -rf "$OUT" && mkdir -p "$OUT"
say "Source"
git archive --prefix="pecs-$VERSION/" HEAD | xz -1 >"$OUT/pecs_$VERSION.orig.tar.xz"
tar -C "$OUT" -xf "$OUT/pecs_$VERSION.orig.tar.xz"
cp -r scripts/packaging/debian "$OUT/pecs-$VERSION/debian"
say "Packages"
(cd "$OUT/pecs-$VERSION" && dpkg-buildpackage --no-sign --build=full) >"$OUT/build.log" 2>&1 || { tail -30 "$OUT/build.log"; die "make_debian.sh: $OUT/build.log"; }
rm -rf "${OUT:?}/pecs-$VERSION"
ls -s "$OUT"/*.deb
say "lintian"
lintian --allow-root --fail-on error "$OUT"/*.changes
