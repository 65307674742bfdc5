"""`tailroad schema NAME`: the JSON Schema of what commands print with --json."""

import json

import click
import msgspec

from service.analysis.acceptance.objects import Acceptance
from service.analysis.comparison.objects import Comparison
from service.analysis.coverage.objects import Coverage
from service.analysis.criticality.objects import Criticality
from service.analysis.failures.objects import Failure, Failures
from service.analysis.learned.objects import Learned
from service.analysis.prevention.objects import Prevention
from service.analysis.report.objects import Report
from service.analysis.risk import Risk
from service.analysis.severity.objects import Severity

SCHEMAS = {
    "failures": Failures,
    "failure": Failure,
    "comparison": Comparison,
    "learned": Learned,
    "risk": Risk,
    "prevention": Prevention,
    "severity": Severity,
    "acceptance": Acceptance,
    "coverage": Coverage,
    "criticality": Criticality,
    "report": Report,
}


@click.command()
@click.argument("name", metavar="NAME", type=click.Choice(sorted(SCHEMAS)))
def command(name: str) -> None:
    """Print the JSON Schema (2020-12) of NAME: acceptance, comparison, failure (of `replay`), failures, learned,
    prevention, report, risk or severity."""
    click.echo(json.dumps(msgspec.json.schema(SCHEMAS[name]), indent=2))
