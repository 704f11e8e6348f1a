#!/usr/bin/env bash
# The main job end to end: sets up, renders the rotating disk of the PECS paper through its lens with Cycles, simulates the events
# of an IMX636, compares them with a real recording of that disk, and writes out/demo/ (start with report.html).
#   scripts/demo.sh [--real FILE]   FILE: a recording of the disk; by default ../shared/data/real/R_360_L.hdf5 if there
source "$(dirname "$0")/lib.sh"
REAL=../shared/data/real/R_360_L.hdf5
case "${1:-}" in
  "") [ -e "$REAL" ] || REAL= ;;
  --real) REAL=${2:-}; [ -e "$REAL" ] || die "demo.sh: --real: got '$REAL', wanted a file" 3 ;;
  *) die "demo.sh: got $1, wanted --real FILE or nothing" 2 ;;
esac

scripts/setup.sh
OUT=out/demo
mkdir -p "$OUT"

# A quarter of the sensor's resolution, so that two cores render half a turn in minutes: each pixel is a full pixel of the
# chip, on a grid four times coarser; the recording is thinned to the same grid. The parameters are those of R_360_L.
say render
"$PY" -m pecs_blender render scenes/rotating_disk -o $OUT/stack --fps 2800 --frames period --width 320 --height 180 \
  --time adaptive --overwrite --set @scenes/rotating_disk/sequences/R_360_L.json

report_inputs=(--sim $OUT/sim.raw --stack $OUT/stack --lens-svg $OUT/lens.svg)
start_us=0
if [ -n "$REAL" ]; then
  say "real recording"
  "$PECS" convert "$REAL" $OUT/real.raw --decimate 4
  start_us=$("$PECS" info $OUT/real.raw --json | "$PY" -c 'import json, sys; print(json.load(sys.stdin)["t_first_us"])')
  report_inputs+=(--real $OUT/real.raw)
fi
say sense
"$PECS" sense $OUT/stack -o $OUT/sim.raw --chip imx636 --seed 1 --warmup-loops 12 --start "$start_us" --duration 54.3ms

say pictures
for kind in png mp4 html; do "$PECS" view $OUT/sim.raw -o $OUT/sim.$kind; done
"$PECS" lens draw pecs_lab_15mm --stop-diameter 1mm --focus 1.56m -o $OUT/lens.svg
[ -z "$REAL" ] || "$PECS" compare $OUT/real.raw $OUT/sim.raw --json >$OUT/compare.json
"$PECS" report "${report_inputs[@]}" -o $OUT/report.html

say "done"
echo "look at: $ROOT/$OUT/report.html (report), sim.html (3-D), sim.mp4 (slow motion), sim.raw (events)"
[ -n "$REAL" ] || echo "no recording to compare with: scripts/demo.sh --real FILE"
