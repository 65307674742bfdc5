"""A renderer as a service: it has a scenario's scene and camera, and makes the pictures that workers ask for.

python -m service.world.egos.renderer i80-10s --listen tcp/127.0.0.1:7449
TAILROAD_RENDERER=tcp/127.0.0.1:7449 tailroad rollout i80-10s --ego vision
"""

import contextlib
import uuid
from collections.abc import Sequence

import click
import numpy as np
from google.protobuf.message import DecodeError

from service.errors import InputError
from service.world.camera import Camera, Weather, build_scene
from service.world.egos import ego_pb2 as pb
from service.world.egos import messages
from service.world.egos.listening import Listening
from service.world.egos.remote_camera import RENDERER
from service.world.egos.sdk import refusal
from service.world.scenario import load_scenario
from service.world.scenario.check import check_road
from service.world.scenario.load import digest
from service.world.scenario.schema import Scenario
from sumo_nets.corridor import Corridor

POSE = 6  # numbers a vehicle
MOST_VEHICLES = 2000


class Rendering:
    """What a renderer answers: requests in, pictures out, no network."""

    def __init__(self, scenario: Scenario, corridor: Corridor):
        self.instance = uuid.uuid4().hex
        self._digest = digest(scenario)
        self._scene = build_scene(corridor)
        self._camera = Camera(scenario.camera)
        self._workers: set[str] = set()

    def answer(self, payloads: Sequence[bytes]) -> list[pb.Reply | None]:
        return [self._answer(payload) for payload in payloads]

    def _answer(self, payload: bytes) -> pb.Reply | None:
        try:
            request = pb.Request.FromString(payload)
        except DecodeError:
            return refusal("not a Request of ego.proto")
        kind = request.WhichOneof("kind")
        if kind == "hello":
            if request.hello.version != messages.VERSION:
                return refusal(f"speaks version {messages.VERSION} of ego.proto, not {request.hello.version}")
            welcome = pb.Welcome(
                version=messages.VERSION, instance=self.instance, sessions=len(self._workers)
            )
            return pb.Reply(welcome=welcome)
        if kind == "goodbye":
            self._workers.discard(request.goodbye.worker)
            return None
        if kind != "render":
            return refusal("a renderer makes pictures and nothing else")
        self._workers.add(request.render.worker)
        try:
            return pb.Reply(picture=self._picture(request.render))
        except InputError as error:
            return refusal(str(error))

    def _picture(self, render: pb.Render) -> pb.Picture:
        if render.scenario != self._digest:
            raise InputError("the worker's scenario is not the one that this renderer was started with")
        numbers = np.array([*render.pose, *render.weather])
        if not np.isfinite(numbers).all():
            raise InputError("a pose or the weather is not finite")
        if len(render.pose) % POSE or not 0 < len(render.pose) <= POSE * MOST_VEHICLES:
            raise InputError(
                f"poses are {POSE} numbers each, of 1 to {MOST_VEHICLES} vehicles, not {len(render.pose)}"
            )
        poses = np.array(render.pose).reshape(-1, POSE)
        if render.ego >= len(poses):
            raise InputError(f"there is no vehicle {render.ego} to carry the camera")
        if len(render.weather) not in (0, 5):
            raise InputError(f"the weather is 5 numbers, not {len(render.weather)}")
        weather = Weather(*render.weather)
        frame = self._camera.render(self._scene, poses, render.ego, weather, render.seed, render.frame)
        return messages.picture_of(frame, pb.CAMERA_RAW)


@click.command()
@click.argument("scenario")
@click.option("--listen", default="tcp/127.0.0.1:7449", show_default=True, help="Where workers find it.")
def main(scenario: str, listen: str) -> None:
    """Make the pictures of SCENARIO's camera for workers elsewhere."""
    loaded = load_scenario(scenario)
    answers = Rendering(loaded, check_road(loaded, scenario))
    with Listening(answers, RENDERER, listen=listen) as service, contextlib.suppress(KeyboardInterrupt):
        click.echo(f"renderer of {loaded.name} is ready")
        service.run()


if __name__ == "__main__":
    main()
