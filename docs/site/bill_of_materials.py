"""What the container image holds, as a software bill of materials: deploy/container/sbom.cdx.json (CycloneDX 1.6).

python -m docs.site.bill_of_materials    writes it anew, from the installed packages' metadata
"""

from __future__ import annotations

import json
import tomllib

from cyclonedx.contrib.license.factories import LicenseFactory
from cyclonedx.model.bom import Bom
from cyclonedx.model.component import Component, ComponentType
from cyclonedx.output import make_outputter
from cyclonedx.schema import OutputFormat, SchemaVersion
from packageurl import PackageURL

from docs.site.gather import ROOT
from docs.site.licences import Package, names_of, own_requirements, packages

FILE = ROOT / "deploy" / "container" / "sbom.cdx.json"


def bill() -> str:
    """The bill; of the same packages always the same text, so without a time and a serial number."""
    about = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    ours = Package(about["name"], about["version"], about["license"], names_of(own_requirements()))
    found = packages()
    product = _component(ours, ComponentType.APPLICATION)
    components = {one.name: _component(one, ComponentType.LIBRARY) for one in found}
    bom = Bom(components=components.values())
    bom.metadata.component = product
    for one, component in [(ours, product), *((one, components[one.name]) for one in found)]:
        bom.register_dependency(component, [components[n] for n in one.needs if n in components])
    said = json.loads(make_outputter(bom, OutputFormat.JSON, SchemaVersion.V1_6).output_as_string())
    del said["serialNumber"], said["metadata"]["timestamp"]
    return json.dumps(said, indent=1, sort_keys=True, ensure_ascii=False) + "\n"


def _component(package: Package, kind: ComponentType) -> Component:
    address = PackageURL("pypi", None, package.name, package.version)
    return Component(
        name=package.name,
        version=package.version,
        type=kind,
        licenses=[LicenseFactory().make_from_string(package.licence)],
        purl=address,
        bom_ref=str(address),
    )


if __name__ == "__main__":
    FILE.write_text(bill(), encoding="utf-8")
