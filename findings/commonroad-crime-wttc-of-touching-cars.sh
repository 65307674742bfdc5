#!/usr/bin/env bash
# commonroad-crime 0.4.5: the worst time to collision of two cars that touch, bumper to bumper, is half a second.
#
# Expected: 0 s, as a bound on how soon vehicles can touch must not be later than the touch itself.
# Seen:     0.52 s with both speeding up at 8 m/s^2: each car of 4.5 m x 1.8 m is one circle at its centre with the radius that
#           covers a third of it (1.17 m), not the three circles that cover the car.
# Ends with 0 while that is so, with 1 once it has changed. Needs a Python from 3.9 to 3.12 and some minutes to install.
set -euo pipefail
folder=$(mktemp -d); trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q --disable-pip-version-check commonroad-crime==0.4.5
"$folder/venv/bin/python" -W ignore - <<'PYTHON'
from commonroad.geometry.shape import Rectangle
from commonroad.prediction.prediction import TrajectoryPrediction
from commonroad.scenario.obstacle import DynamicObstacle, ObstacleType
from commonroad.scenario.state import CustomState, InitialState
from commonroad.scenario.trajectory import Trajectory
from commonroad_crime.utility.solver import solver_wttc
import numpy as np


def car(number, x):
    here, box = np.array([x, 0.0]), Rectangle(length=4.5, width=1.8)
    start = InitialState(position=here, velocity=0.0, orientation=0.0, time_step=0)
    later = CustomState(position=here, velocity=0.0, velocity_y=0.0, orientation=0.0, time_step=1)
    return DynamicObstacle(number, ObstacleType.CAR, box, start, TrajectoryPrediction(Trajectory(1, [later]), box))


roots = solver_wttc(car(1, 0.0), car(2, 4.5), 1, 8.0)
soonest = min(float(t.real) for t in roots if abs(t.imag) < 1e-9 and t.real > 0)
print(f"commonroad-crime 0.4.5, cars that touch: WTTC {soonest:.2f} s; expected: 0 s")
raise SystemExit(not 0.5 < soonest < 0.54)
PYTHON
