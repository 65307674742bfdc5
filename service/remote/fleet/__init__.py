"""A scheduler and workers on any number of machines: who runs which rollouts, whatever is lost on the way.

Scheduler (scheduler.py)    a state machine: events in, instructions out; no clock, no network, no disk
Hub (hub.py)                carries the instructions out: statistics, replies; writes.py: what the database takes
HubLink (zenoh_link.py)     the scheduler's side of Zenoh
Worker (worker.py)          asks for chunks, runs them in processes of its own, answers
"""
