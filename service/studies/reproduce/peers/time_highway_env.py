"""highway-env: its highway, six lanes, the ego and five IDM vehicles, 10 Hz. Arguments: rounds, seconds."""

import json
import sys
import time

import gymnasium
import highway_env

rounds, seconds = int(sys.argv[1]), int(sys.argv[2])
gymnasium.register_envs(highway_env)
environment = gymnasium.make(
    "highway-v0",
    config={
        "lanes_count": 6,
        "vehicles_count": 5,
        "simulation_frequency": 10,
        "policy_frequency": 10,
        "duration": seconds,
        "observation": {"type": "Kinematics", "vehicles_count": 6},
    },
)
IDLE = 1
sim_s, core_s = [], []
for number in range(rounds + 1):  # the first is left out: it imports and compiles
    environment.reset(seed=number)
    began = time.process_time()
    steps, over = 0, False
    while not over and steps < 10 * seconds:
        _, _, terminated, truncated, _ = environment.step(IDLE)
        steps += 1
        over = terminated or truncated
    if number:
        core_s.append(time.process_time() - began)
        sim_s.append(steps / 10.0)
print(json.dumps({"sim_s": sim_s, "core_s": core_s,
                  "what": "highway-v0, six lanes, five IDM vehicles, kinematics observation"}))  # fmt: skip
