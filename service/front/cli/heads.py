"""What the findings of a run are printed under."""

from rich.console import Console

from service.analysis.job_findings import JobFindings, MethodFindings


def headed(found: JobFindings, counts: str, highlight: bool = True) -> Console:
    """The console that findings go to, with their first line: which run, and of how many rollouts."""
    method = f", {found.method}" if isinstance(found, MethodFindings) else ""
    console = Console()
    console.print(
        f"\n{found.run}: scenario {found.scenario}, ego {found.ego}{method}; {counts}", highlight=highlight
    )
    return console
