"""Criticality of dangerous rollouts by the measures of the field, from their traces; none of it decides f.

pair.py      measures of two vehicles at one moment: WTTC, BTN, TTB, TTR
over_time.py measures over a rollout: smallest and largest values, TET, TIT
critical.py  from a job's record to a table of its dangerous rollouts
objects.py   what is told of them, as JSON objects
"""
