"""A rollout in the forms that other programs open: scenario file, SUMO's floating-car data, film, recording, table,
ASAM OpenSCENARIO.

write_exports   runs the rollout once more in this process and writes the files asked for
export_bytes    the same in a process of its own, for one form, as bytes
"""

from service.analysis.exports.apart import export_bytes
from service.analysis.exports.write import Files, write_exports
from service.analysis.rollout_files import FORMATS, SUFFIXES

__all__ = ["FORMATS", "SUFFIXES", "Files", "export_bytes", "write_exports"]
