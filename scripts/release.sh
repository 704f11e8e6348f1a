#!/usr/bin/env bash
# The list of what must hold before a release, in order. It stops at the first thing that does not. Nothing is published: the
# last lines say what a person does then.
#   scripts/release.sh              all of it (hours)
#   scripts/release.sh --quick      what needs no build: versions, changelog, clean tree
#   scripts/release.sh --versions   whether all files name the same version
source "$(dirname "$0")/lib.sh"
[[ "${1:-}" =~ ^(--quick|--versions)?$ ]] || die "release.sh: got $1, wanted --quick, --versions or nothing" 2
VERSION=$(cat VERSION)

# same FILE PATTERN: what the file's first match of the pattern (with one group) says must be the version.
same() {
  local found
  found=$(sed -nE "s/.*$2.*/\1/p" "$1" | head -1)
  [ "$found" = "$VERSION" ] || die "release.sh: $1: got ${found:-no version}, wanted $VERSION as in VERSION"
}

say "Versions"
[[ "$VERSION" =~ ^[0-9]+\.[0-9]+\.[0-9]+$ ]] || die "release.sh: VERSION: got $VERSION, wanted MAJOR.MINOR.PATCH"
IFS=. read -r major minor patch <<<"$VERSION"
same python/c/include/pecs.h '^#define PECS_VERSION "([^"]+)"'
for part in "MAJOR $major" "MINOR $minor" "PATCH $patch"; do
  grep -q "^#define PECS_VERSION_$part\$" python/c/include/pecs.h || die "release.sh: python/c/include/pecs.h: wanted PECS_VERSION_$part"
done
same blender_addon/pecs_blender/blender_manifest.toml '^version = "([^"]+)"'
same CITATION.cff '^version: (.+)$'
same README.md '^  version = \{([^}]+)\}$'
echo "all files say $VERSION"
[ "${1:-}" != --versions ] || exit 0

say "Changelog"
grep -qE "^## $VERSION \([0-9]{4}-[0-9]{2}-[0-9]{2}\)$" CHANGELOG.md ||
  die "release.sh: CHANGELOG.md: wanted a heading '## $VERSION (DATE)' in place of 'Unreleased'"
say "Addresses"
for key in repository-code url doi; do # of the repository, the site and the archived version: README and pages have none
  grep -qE "^$key: .+" CITATION.cff || die "release.sh: CITATION.cff: wanted a line '$key: …'"
done
say "Tree"
[ -z "$(git status --porcelain)" ] || die "release.sh: the working tree: got changes, wanted none: git status"
! git rev-parse -q --verify "refs/tags/v$VERSION" >/dev/null || die "release.sh: tag v$VERSION: exists already"
[ "${1:-}" != --quick ] || exit 0

scripts/test.sh
scripts/check.sh asan
scripts/check.sh tsan
scripts/check.sh tidy
scripts/check.sh fuzz 600
scripts/docs.sh
scripts/demo.sh
scripts/packaging/make_sample.sh
scripts/packaging/wheel_libraries.sh
"$PY" scripts/packaging/make_wheels.py
for target in linux-x86_64 linux-aarch64 windows-x86_64; do  # macOS: .github/workflows/platforms.yml
  scripts/platforms/dependencies.sh "$target"
  "$PY" scripts/packaging/make_wheels.py --core "$target"
done
scripts/platforms/try_windows.sh --tests
scripts/platforms/try_linux.sh --tests x86_64  # root
scripts/platforms/try_linux.sh --tests aarch64
scripts/packaging/try_wheels.sh  # root

say "ready: what is left for a person"
cat <<END
1. Look at out/demo/report.html and out/site/index.html.
2. Install dist/*.zip in a Blender, press Preview and Render stack.
3. git tag -s v$VERSION && git push origin v$VERSION
4. Attach dist/* to the release of that tag, with the changelog's part as its text.
5. Put out/site where the pages live.
6. Raise VERSION, python/c/include/pecs.h, blender_manifest.toml and CITATION.cff; begin '## Unreleased' in CHANGELOG.md.
END
