"""Scenic with its own Newtonian simulator: six objects that move by their speed, 10 Hz. Arguments: rounds, seconds."""

import json
import sys
import time

import scenic
from scenic.simulators.newtonian import NewtonianSimulator

PROGRAM = """
model scenic.simulators.newtonian.model
ego = new Object at (0, 0), with velocity (0, 15)
for i in range(5):
    new Object at (4 * (i + 1), Range(-20, 20)), with velocity (0, Range(10, 20))
terminate after %d seconds
"""

rounds, seconds = int(sys.argv[1]), int(sys.argv[2])
scenario = scenic.scenarioFromString(PROGRAM % seconds, mode2D=True)
simulator = NewtonianSimulator(render=False)
sim_s, core_s = [], []
for number in range(rounds + 1):
    scene, _ = scenario.generate()
    began = time.process_time()
    simulation = simulator.simulate(scene, maxSteps=10 * seconds, timestep=0.1)
    if number:
        core_s.append(time.process_time() - began)
        sim_s.append(simulation.currentTime * simulation.timestep)
print(json.dumps({"sim_s": sim_s, "core_s": core_s,
                  "what": "Newtonian simulator, six objects without sensors or policies"}))  # fmt: skip
