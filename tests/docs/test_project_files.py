"""What a repository says of itself: version, citation, licences."""

from __future__ import annotations

import json
import re
import subprocess
import sys
import tomllib

import pytest
import yaml
from cyclonedx.schema import SchemaVersion
from cyclonedx.validation.json import JsonStrictValidator

from docs.site import bill_of_materials, licences
from docs.site.gather import ROOT

VERSION = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["version"]


def test_the_citation_follows_its_schema_and_names_the_version():
    done = subprocess.run(
        [sys.executable, "-m", "check_jsonschema", "--builtin-schema", "vendor.citation-file-format",
         ROOT / "CITATION.cff"],
        capture_output=True,
        text=True,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    cited = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    assert cited["version"] == VERSION
    released = f"## {VERSION} – {cited['date-released']}"
    assert released in (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")


def test_the_licence_of_everything_that_is_installed_stands_on_the_page():
    rows = re.findall(r"^\| (\S+) \| \S+ \| (.+) \|$", licences.PAGE.read_text(encoding="utf-8"), re.M)
    on_the_page = dict(rows)
    for package in licences.packages():
        assert on_the_page.get(package.name) == package.licence, (
            f"{package.name}: run `python -m docs.site.licences`"
        )
    assert "EPL-2.0" in on_the_page["libsumo"]


def test_the_bill_of_materials_is_of_what_is_installed_and_valid():
    text = bill_of_materials.FILE.read_text(encoding="utf-8")
    assert text == bill_of_materials.bill(), "run `make pins`"
    assert JsonStrictValidator(SchemaVersion.V1_6).validate_str(text) is None
    bill = json.loads(text)
    (ours,) = (d for d in bill["dependencies"] if d["ref"] == bill["metadata"]["component"]["bom-ref"])
    assert any(ref.startswith("pkg:pypi/libsumo@") for ref in ours["dependsOn"])


def test_the_image_installs_what_is_tested_and_nothing_without_a_hash():
    text = (ROOT / "deploy" / "container" / "requirements.txt").read_text(encoding="utf-8")
    pinned = dict(
        re.findall(r"^([\w.-]+)(?:\[[\w,]+\])?==(\S+) \\\n    --hash=sha256:[0-9a-f]{64}", text, re.M)
    )
    assert pinned == {one.name: one.version for one in licences.packages()}, "run `make pins`"
    others = [
        line
        for line in text.splitlines()
        if not re.fullmatch(r"    --hash=sha256:[0-9a-f]{64}(?: \\)?", line)
    ]
    assert len(others) == len(pinned)  # no address of an index, nothing that pip would take from elsewhere


class Unsaid:
    """An installed package whose metadata name no licence."""

    metadata = type("Metadata", (dict,), {"get_all": lambda self, name: []})(Name="silent")


def test_a_package_without_a_licence_is_not_passed_over():
    with pytest.raises(LookupError, match="silent: no licence can be read"):
        licences.licence_of(Unsaid())


def test_pages_refer_to_nothing_that_is_not_in_the_repository():
    """Names of papers that the maintainers once kept elsewhere."""
    listed = subprocess.run(
        ["git", "grep", "-nE", "DESIGN|STYLE( |\\.md)", "--", ":!tests/docs"],
        cwd=ROOT,
        capture_output=True,
        text=True,
    )
    assert listed.stdout == ""
