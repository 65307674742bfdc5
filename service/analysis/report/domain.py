"""Coverage of the domain as a page of its own."""

from importlib.metadata import version

import msgspec

from service.analysis.coverage.objects import Coverage
from service.analysis.report.page import render


def domain_page(found: Coverage) -> str:
    """The HTML page, self-contained: the section of reports on coverage alone."""
    return render("domain.html", facts={"coverage": msgspec.to_builtins(found)}, version=version("tailroad"))
