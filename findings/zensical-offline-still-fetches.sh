#!/usr/bin/env bash
# Zensical 0.0.73: a site built with its `offline` plugin, whose pages are meant to be read without a network, still
# names a script on an outside host in every page.
#
# Expected: no <script src>, <link href> or <img src> of a built page leads to an outside host.
# Seen:     each page loads one script from outside (a shim for search workers in pages opened as files).
# Ends with 0 while that is so, with 1 once it has changed.
set -euo pipefail
folder=$(mktemp -d); trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q --disable-pip-version-check zensical==0.0.73
mkdir "$folder/docs"; cd "$folder"
printf '# Home\n\nA page.\n' > docs/index.md
cat > zensical.toml <<'T'
[project]
site_name = "Offline"
use_directory_urls = false
[project.theme]
font = false
[project.plugins.offline]
T
"$folder/venv/bin/zensical" build > build.log 2>&1 || { cat build.log; exit 2; }
"$folder/venv/bin/python" - <<'P'
import re, sys
from pathlib import Path

page = Path("site/index.html").read_text(encoding="utf-8")
loaded = re.findall(r'<(?:script|img)[^>]+?src="?(https?:[^"\s>]+)|<link[^>]+?rel="?stylesheet"?[^>]+?href="?(https?:[^"\s>]+)', page)
outside = [a or b for a, b in loaded]
print("zensical 0.0.73; expected: nothing is loaded from outside; seen:", len(outside), "of", len(re.findall("<script", page)), "scripts")
sys.exit(0 if outside else 1)
P
