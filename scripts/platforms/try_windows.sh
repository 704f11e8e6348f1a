#!/usr/bin/env bash
# Tries the wheel for Windows (dist/, make_wheels.py --core windows-x86_64) in Wine, in a new prefix, against the program
# for Linux: events of all models, all formats, and the names and files that Windows has and Linux has not; then pip, the
# hashes of event_hashes.py and try_python.py in a Python for Windows, with the extension in Blender. With --tests also
# builds and runs the C++ tests of the core (minutes).
#   scripts/platforms/try_windows.sh [--tests]
source "$(dirname "$0")/../lib.sh"
[[ "${1:-}" =~ ^(--tests)?$ ]] || die "try_windows.sh: got $1, wanted --tests or nothing" 2
debian_packages wine64 wine unzip curl
WHEEL=$(compgen -G 'dist/pecs_sim-*-win_amd64.whl') || die "try_windows.sh: dist/pecs_sim-*-win_amd64.whl is missing: make_wheels.py --core windows-x86_64" 3
PLACE=$(mktemp -d)
trap 'wineserver-stable -k || true; rm -rf "$PLACE"' EXIT
export WINEPREFIX="$PLACE/prefix" WINEDEBUG=-all PECS_DATA= LC_ALL=C.UTF-8  # of the arguments
DISK="$WINEPREFIX/drive_c"
exec 3>/dev/null  # what the program prints of what went well
windows() { local folder=$1; shift; (cd "$DISK/$folder" && wine-stable "$DISK/pecs/_lib/bin/pecs.exe" "$@" >&3); }

say "A new prefix, $(du -h "$WHEEL" | cut -f1) of wheel"
wine-stable wineboot -i >/dev/null 2>&1
unzip -q "$WHEEL" -d "$DISK"
windows . --version 3>&1

say "Events of all models, in a folder with umlauts"
FOLDER='Messung äöü 北'
mkdir "$DISK/$FOLDER"
"$PY" -c 'import sys; from pathlib import Path; from pecs.demo import write_stack; write_stack(Path(sys.argv[1]))' "$DISK/$FOLDER/stack"
for model in pecs esim v2e voltmeter icns; do
  windows "$FOLDER" sense "C:\\$FOLDER\\stack" -o "C:\\$FOLDER\\$model.raw" --model $model --quiet
  "$PECS" sense "$DISK/$FOLDER/stack" -o "$PLACE/$model.raw" --model $model --quiet >&3
  if cmp -s "$PLACE/$model.raw" "$DISK/$FOLDER/$model.raw"; then echo "    $model: as on Linux"
  else differs+="$model "; echo "    $model: DIFFERS from Linux"; fi
done

say "The library: all functions of pecs.h, and a program in C on it"
LIBRARY="$DISK/pecs/_lib/libpecs.dll"
diff <(grep -oE '\bpecs_[a-z0-9_]+\(' python/c/include/pecs.h | tr -d '(' | sort -u) \
  <(x86_64-w64-mingw32-objdump -p "$LIBRARY" | grep -oE '\bpecs_[a-z0-9_]+$' | sort -u) && echo "    all there"
x86_64-w64-mingw32-gcc-posix -static-libgcc -Ipython/c/include examples/c/simulate_frames.c "$LIBRARY" -o "$DISK/pecs/_lib/example.exe"
(cd "$DISK/$FOLDER" && wine-stable "$DISK/pecs/_lib/example.exe" bar.raw)
cc -Ipython/c/include examples/c/simulate_frames.c build/release/lib/libpecs.so -Wl,-rpath,"$ROOT/build/release/lib" -o "$PLACE/example"
"$PLACE/example" "$PLACE/bar.raw" >/dev/null
cmp "$PLACE/bar.raw" "$DISK/$FOLDER/bar.raw" && echo "    as on Linux"

say "All formats, written there and read here; text with CRLF"
for format in $("$PY" -c 'import pecs; print(*(f["name"] + f["extensions"][0] for f in pecs.event_formats() if f["writes"]))'); do
  name=${format%%.*} file=events.$format
  windows "$FOLDER" convert pecs.raw "$file" --format "$name" --quiet
  windows "$FOLDER" convert "$file" back.csv --input-format "$name" --quiet
  "$PECS" convert "$DISK/$FOLDER/$file" "$PLACE/here.csv" --input-format "$name" --quiet >&3
  cmp "$PLACE/here.csv" "$DISK/$FOLDER/back.csv" && echo "    $name"
done
sed 's/$/\r/' "$DISK/$FOLDER/back.csv" >"$DISK/$FOLDER/crlf.csv"
windows "$FOLDER" convert crlf.csv crlf.raw --quiet
windows "$FOLDER" convert back.csv lf.raw --quiet
cmp "$DISK/$FOLDER/crlf.raw" "$DISK/$FOLDER/lf.raw"

say "Long paths, files that are missing or in use, Ctrl-C"
long=$(printf 'a%.0s' {1..120})
mkdir -p "$DISK/$long/$long/$long"
windows "$FOLDER" convert pecs.raw "C:\\$long\\$long\\$long\\events.raw" --quiet && cmp "$DISK/$FOLDER/pecs.raw" "$DISK/$long/$long/$long/events.raw"
expect() { # CODE COMMAND...: its exit code
  local wanted=$1 code=0; shift
  "$@" || code=$?
  [ $code = "$wanted" ] || die "try_windows.sh: $*: got exit code $code, wanted $wanted"
}
expect 3 windows . info 'D:\none.raw'
mkdir "$DISK/folder.raw"
expect 5 windows . convert "$FOLDER\\pecs.raw" folder.raw
expect 6 windows . view "$FOLDER\\pecs.raw" -o a.png
interrupted() { # SIGINT, which Wine turns into Ctrl-C
  (cd "$DISK/$FOLDER" && exec timeout --preserve-status -s INT 3 wine-stable "$DISK/pecs/_lib/bin/pecs.exe" sense stack -o long.raw --duration 100s --quiet)
}
expect 130 interrupted
[ ! -e "$DISK/$FOLDER/long.raw" ] || die "try_windows.sh: Ctrl-C: got long.raw, wanted only its .partial"

say "Python and Blender for Windows: pip, the demo, try_python.py"
maven_python windows-x86_64 "$DISK/python"
mv "$DISK/python/lib" "$DISK/python/Lib"  # OSL looks at the case of names
# It lacks python3.dll, which OpenCV requires and which only forwards to python311.dll.
{ echo EXPORTS; x86_64-w64-mingw32-objdump -p "$DISK/python/python311.dll" |
  awk '/Ordinal\/Name Pointer/ {on = 1; next} on && /^\t\[/ {print $NF " = python311." $NF}'; } >"$PLACE/python3.def"
x86_64-w64-mingw32-gcc-posix -shared -nostdlib -Wl,--entry=0 -o "$DISK/python/python3.dll" "$PLACE/python3.def"
"$PY" -m pip install -q --no-deps --platform win_amd64 --python-version 311 --only-binary=:all: \
  --target "$DISK/python/Lib/site-packages" \
  $(grep -oE '(bpy|numpy|opencv-python-headless)==[0-9.]+' pyproject.toml | sort -u)
cp "$WHEEL" "$DISK"
# Python's streams must be pipes: Wine's handles of files do not have what it asks for.
python() { (cd "$DISK/python" && env -u PYTHONPATH -u PECS_LIBRARY -u PECS_PROGRAM wine-stable "$DISK/python/python.exe" "$@" </dev/null 2>&1 | cat); }
python -m pip install -q --no-deps --no-index --no-warn-script-location "C:\\${WHEEL##*/}"
python -m pecs demo -o 'demo äöü 北' | sed -n '/^model/,/^icns/p; /^pecs:/p'
HERE="Z:${ROOT//\//\\}\\"
"$PY" scripts/studies/event_hashes.py -o "$DISK/python/here.json" --program "$PECS"
python -c 'import sys; sys.path[:0] = sys.argv[1:]; import pecs; from pathlib import Path; from event_hashes import main
main(output=Path("there.json"), program=Path(pecs.program()), expected=Path("here.json"))' \
  "${HERE}scripts\\studies" "${HERE}scripts\\lab"
RENDER=(--time adaptive --fps 2800 --frames 0:4 --width 48 --samples 2 --bands 2)
python "${HERE}scripts\\platforms\\try_python.py" "$HERE$(compgen -G 'dist/pecs_blender-*-windows-x64.zip')" "${HERE}scenes\\rotating_disk" "${RENDER[@]}"
"$PY" -m pecs_blender render scenes/rotating_disk "${RENDER[@]}" -o "$PLACE/stack" --quiet
for file in stack.json motion_000000.exr; do cmp "$PLACE/stack/$file" "$DISK/python/try python/stack/$file"; done

if [ "${1:-}" = --tests ]; then
  say "C++ tests"
  core_tests windows-x86_64 wine-stable
fi
[ -z "${differs:-}" ] || die "try_windows.sh: events differ from those on Linux: $differs"
say "Windows: all there"
