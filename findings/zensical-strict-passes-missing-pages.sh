#!/usr/bin/env bash
# Zensical 0.0.73: `build --strict` ends with 0 where the navigation names a page that does not exist and a page shows
# a picture that does not exist.
#
# Expected: as with MkDocs 1.6.1 --strict, a build with a navigation entry that names no page fails.
# Seen:     Zensical ends with 0 and writes the entry as a link that leads nowhere; MkDocs fails.
# Ends with 0 while that is so, with 1 once it has changed.
set -euo pipefail
folder=$(mktemp -d); trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q --disable-pip-version-check zensical==0.0.73 mkdocs==1.6.1
mkdir "$folder/docs"; cd "$folder"
printf '# Home\n\n![a picture](missing.png)\n' > docs/index.md
cat > zensical.toml <<'T'
[project]
site_name = "Strict"
nav = [{ "Home" = "index.md" }, { "Gone" = "gone.md" }]
T
printf 'site_name: Strict\nnav:\n  - Home: index.md\n  - Gone: gone.md\n' > mkdocs.yml
zensical=0; "$folder/venv/bin/zensical" build --strict -f zensical.toml > zensical.log 2>&1 || zensical=$?
linked=$(grep -c 'gone' site/index.html || true)
mkdocs=0; "$folder/venv/bin/mkdocs" build --strict -d other > mkdocs.log 2>&1 || mkdocs=$?
echo "exit codes with a missing page in the navigation: zensical 0.0.73 --strict $zensical, mkdocs 1.6.1 --strict $mkdocs"
echo "expected: neither is 0; lines of the built page that link to it: $linked"
[ "$zensical" = 0 ] && [ "$mkdocs" != 0 ] && [ "$linked" != 0 ]
