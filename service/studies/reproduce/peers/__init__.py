"""Other simulators, timed beside ours: each in an environment of its own, six vehicles, ten steps a second.

`timed.py` makes the environments and runs the scripts; `time_*.py` are run by the other environments' Pythons and
import nothing of tailroad. Each prints one JSON object: sim_s and core_s (processor time) of its rounds, and what it
did in words.
"""
