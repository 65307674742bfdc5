#!/usr/bin/env bash
# MkDocs 1.6.1: `mkdocs build --strict --quiet` ends with 0 on warnings that `mkdocs build --strict` fails for.
#
# Expected: --quiet only silences; a build with a navigation entry that names no page fails under --strict either way.
# Seen:     --strict ends with 1, --strict --quiet with 0.
# Ends with 0 while that is so, with 1 once it has changed.
set -euo pipefail
folder=$(mktemp -d); trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q --disable-pip-version-check mkdocs==1.6.1
mkdir "$folder/docs"; cd "$folder"
printf '# Home\n' > docs/index.md
printf 'site_name: Strict\nnav:\n  - Home: index.md\n  - Gone: gone.md\n' > mkdocs.yml
loud=0; "$folder/venv/bin/mkdocs" build --strict > loud.log 2>&1 || loud=$?
quiet=0; "$folder/venv/bin/mkdocs" build --strict --quiet > quiet.log 2>&1 || quiet=$?
echo "mkdocs 1.6.1, a missing page in the navigation: --strict ends with $loud, --strict --quiet with $quiet; expected: neither with 0"
[ "$loud" != 0 ] && [ "$quiet" = 0 ]
