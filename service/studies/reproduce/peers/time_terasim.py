"""TeraSim: six vehicles on a straight road of six lanes in SUMO, with its sensors and IDM, 10 Hz. Arguments: rounds, s.

SUMO's programs (`netconvert`) come with TeraSim into the same environment.
"""

import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from terasim.envs.template import EnvTemplate
from terasim.logger.infoextractor import InfoExtractor
from terasim.overlay import traci
from terasim.simulator import Simulator
from terasim.vehicle.controllers.high_efficiency_controller import HighEfficiencyController
from terasim.vehicle.decision_models.idm_model import IDMModel
from terasim.vehicle.factories.vehicle_factory import VehicleFactory
from terasim.vehicle.sensors.ego import EgoSensor
from terasim.vehicle.sensors.local import LocalSensor
from terasim.vehicle.vehicle import Vehicle

NODES = '<nodes><node id="a" x="0" y="0"/><node id="b" x="3000" y="0"/></nodes>'
EDGES = '<edges><edge id="ab" from="a" to="b" numLanes="6" speed="29"/></edges>'
VEHICLE = '<vehicle id="{i}" route="r" depart="0" departLane="{i}" departPos="{at}" departSpeed="{speed}"/>'


class Silent(InfoExtractor):
    """Writes nothing down."""

    def get_snapshot_info(self, control_info: Any) -> None:
        return None

    def get_terminate_info(self, stop: Any, reason: Any, additional_info: Any) -> None:
        return None


class Factory(VehicleFactory):
    def create_vehicle(self, veh_id: Any, simulator: Any) -> Vehicle:
        sensors = [EgoSensor(), LocalSensor(obs_range=40)]
        return Vehicle(veh_id, simulator, sensors, IDMModel(), HighEfficiencyController(simulator))


def written(folder: Path) -> tuple[Path, Path]:
    """The network and SUMO's configuration."""
    (folder / "road.nod.xml").write_text(NODES)
    (folder / "road.edg.xml").write_text(EDGES)
    net = folder / "road.net.xml"
    subprocess.run(
        [Path(sys.executable).parent / "netconvert", "-n", folder / "road.nod.xml", "-e", folder / "road.edg.xml",
         "-o", net], check=True, capture_output=True,
    )  # fmt: skip
    vehicles = "".join(VEHICLE.format(i=i, at=100 + 5 * i, speed=22 + i) for i in range(6))
    (folder / "road.rou.xml").write_text(f'<routes><route id="r" edges="ab"/>{vehicles}</routes>')
    config = folder / "road.sumocfg"
    config.write_text(
        f'<configuration><input><net-file value="{net}"/><route-files value="{folder / "road.rou.xml"}"/></input>'
        '<time><step-length value="0.1"/></time></configuration>'
    )
    return net, config


rounds, seconds = int(sys.argv[1]), int(sys.argv[2])
sim_s, core_s = [], []
with tempfile.TemporaryDirectory() as place:
    net, config = written(Path(place))
    for number in range(rounds + 1):
        simulator = Simulator(
            config, net, additional_sumo_args=["--no-step-log", "true", "--no-warnings", "true"]
        )
        simulator.bind_env(EnvTemplate(Factory(), Silent))
        simulator.start()
        simulator.step_pipeline(simulator, simulator.ctx)  # the vehicles depart
        began = time.process_time()
        for _ in range(10 * seconds):
            simulator.step_pipeline(simulator, simulator.ctx)
        taken = time.process_time() - began
        assert len(traci.vehicle.getIDList()) == 6
        traci.close()
        if number:
            core_s.append(taken)
            sim_s.append(float(seconds))
print(json.dumps({"sim_s": sim_s, "core_s": core_s,
                  "what": "SUMO, six vehicles with its sensors, IDM and MOBIL, no ego under test"}))  # fmt: skip
