#!/usr/bin/env bash
# A small data set end to end: sets up, renders eight sequences of a quarter of a second from a stereo hybrid rig (two event cameras,
# two RGB cameras) in a room and in a street with all ground truth, checks them, and writes out/dataset_demo/ (start with
# index.html). About two hours of two cores (the first sequence takes 10 minutes); run again, it continues.
#   scripts/dataset_demo.sh [OPTIONS of pecs dataset]   --plan: what it will take; --only 0: one sequence
source "$(dirname "$0")/lib.sh"
scripts/setup.sh
"$PECS" dataset examples/recipes/demo.toml -o out/dataset_demo "$@"
say "done"
echo "look at: $ROOT/out/dataset_demo/index.html"
