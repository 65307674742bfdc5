"""The evaluation service, in rooms that stand on each other: each imports those below it and none above.

training    the scripts that train the drivers and the egos
front       what people touch: command line, dashboard, batch files
studies     the paper's experiments, how real the drivers are, how fast the world is
remote      many machines: the fleet, the query API over Zenoh, its client
analysis    what a run says: failure modes, comparisons, risk, replays, reports
evaluation  from a scenario to an estimate; its main path is `service/evaluation/evaluate.py`
world       scenarios, roads, vehicles, sensors, safety measures, egos
"""
