"""Coverage of the operational design domain: which of its cells P0, the rollouts and the dangerous ones lie in.

attributes.py  what a rollout's start says of road, weather, light and traffic, in classes; headings after ISO 34503
domain.py      a domain that a file declares
cover.py       from a job's record to shares by cell, and cells never seen
objects.py     what is told of it, as JSON objects
"""
