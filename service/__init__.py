"""The evaluation service: scenarios, the simulated world, the evaluation loop, its store, reports and command line.

The main path is `service/evaluate.py`.
"""
