#!/usr/bin/env bash
# Makes the data set to download of a release, dist/pecs_sample-VERSION.tar.gz: four short sequences with ground truth, a
# README and a loader, which is run at the end. `pecs dataset` makes the sequences; run the script again to resume.
# 7 CPU minutes, 0.2 GB.
source "$(dirname "$0")/../lib.sh"
NAME=pecs_sample-$(cat VERSION)
SET=out/$NAME
export PATH="$ROOT/build/release/bin:$ROOT/.venv/bin:$PATH"

say "Sequences ($SET)"
pecs dataset examples/recipes/sample.toml -o "$SET"
say "README, loader, archive"
cp examples/sample_set/{README.md,load.py} "$SET"
"$PY" "$SET/load.py"
mkdir -p dist
tar -czf "dist/$NAME.tar.gz.partial" -C out --exclude='*.log' --exclude='.*' "$NAME"
mv "dist/$NAME.tar.gz.partial" "dist/$NAME.tar.gz"
ls -l "dist/$NAME.tar.gz"
