"""Preventable or not: dangerous rollouts driven again by reference drivers, from the onset of the conflict on.

onset.py     when a conflict begins
conflict.py  one rollout again: as it was, then with each reference driver at the wheel
prevent.py   from a job's record to p = preventable + unpreventable, with intervals, by failure mode
objects.py   what is told of it, as JSON objects
kept.py      what was found, kept in the run directory
"""
