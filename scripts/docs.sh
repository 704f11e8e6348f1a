#!/usr/bin/env bash
# Builds the documentation site into out/site (start with index.html): pages of docs/, of the commands (from --help), and
# the C header by Doxygen. Warnings are errors, those of links and anchors too (mkdocs.yml, validation). Can be run
# again; about a minute once its tools are there.
#   scripts/docs.sh            builds and checks
#   scripts/docs.sh --serve    shows it at http://127.0.0.1:8000 and follows changes
source "$(dirname "$0")/lib.sh"
[[ "${1:-}" =~ ^(--serve)?$ ]] || die "docs.sh: got $1, wanted --serve or nothing" 2
DOCS_PY=.venv-docs/bin/python

say "Debian packages"
debian_packages doxygen python3-venv
say "Python packages (.venv-docs)"
[ -x "$DOCS_PY" ] || /usr/bin/python3 -m venv .venv-docs
python_packages .venv-docs docs
[ -x "$PECS" ] && [ -x "$PY" ] || scripts/setup.sh

say "Commands (--help)"
mkdir -p out/docs
"$PY" scripts/docs/commands.py -o out/docs/commands.md
say "C header (Doxygen)"
rm -rf out/docs/c
(cat scripts/cmake/Doxyfile; echo "PROJECT_NUMBER = $(cat VERSION)") | doxygen - >out/docs/doxygen.log || { cat out/docs/doxygen.log; die "docs.sh: doxygen failed"; }

export NO_MKDOCS_2_WARNING=1  # the theme's advertisement, which is not about this site
if [ "${1:-}" = --serve ]; then
  exec "$DOCS_PY" -m mkdocs serve --strict
fi
say "Site (out/site)"
"$DOCS_PY" -m mkdocs build --quiet --strict
say "done"
echo "look at: $ROOT/out/site/index.html"
