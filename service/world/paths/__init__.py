"""Rollouts as paths: states that are copied and driven on with other noise, and what is to be seen in them.

states.py      the state of many rollouts between two steps
noise.py       what drivers do in a segment, from its key
begin.py       states at the start, from draws of P0
drive.py       states driven on to a later step
lineage.py     the draw and the noise that a path stands for, so that it can be driven again as a whole
nearest.py     how near two vehicles come if they go on as they move
level.py       what a pilot climbs on its way to a contact
features.py    what of a state bears on danger, for each other vehicle
process.py     all of it for one scenario and a compiled ego
"""
