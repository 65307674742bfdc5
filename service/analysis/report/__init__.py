"""The report of a run: one self-contained HTML file for people, and the same facts as JSON for programs.

    write_report(RunDirectory.open(Path("runs/i80-10s")))      # RUN/report.html and RUN/report.json
    report_of("j1", [fleet.record("j1")])                      # the same of a fleet's job, as text and facts

The facts come first: `replay` reads the record, `dangerous` picks rollouts and runs them once more, `facts` turns both
into one JSON-ready dictionary. `figures` and `drawings` make pictures of the same, and `page` sets everything in type,
a template for each section in `templates/`.
"""

from service.analysis.report.write import Made, report_of, write_report

__all__ = ["Made", "report_of", "write_report"]
