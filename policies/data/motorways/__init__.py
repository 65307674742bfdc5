"""Recordings of motorways in the layouts of their publishers: DLR Highway Traffic, highD, exiD, I-24 MOTION.

read    the recordings of a file in one of these layouts, in the schema of ngsim_schema.py
layout  which layout a file has, if any
"""

from policies.data.motorways.layouts import Read, layout, read

__all__ = ["Read", "layout", "read"]
