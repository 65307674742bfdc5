import json
import math

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

from service.analysis.failures.recording import write_recording
from service.errors import InputError
from service.world import agents as A
from tests.service.analysis.failures.conftest import Moves, at_speed


@pytest.fixture(scope="module")
def recorded(play, i80, tmp_path_factory):
    trace = play(
        [Moves(3, at_speed(300, 20.0)), Moves(3, at_speed(330, 12.0)), Moves(2, at_speed(310, 15.0))]
    )
    path = tmp_path_factory.mktemp("log") / "rollout.mcap"
    write_recording(trace, i80, path, 1.0, 20, {"scenario.toml": "format = 1\n"})
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        messages = {}
        for _, channel, message, decoded in reader.iter_decoded_messages(
            topics=["/scene", "/road", "/tf", "/lidar"]
        ):
            messages.setdefault(channel.topic, []).append((message.log_time, decoded))
        plots = [json.loads(m.data) for _, _, m in reader.iter_messages(topics=["/ego"])]
        schemas = {s.name: s.encoding for s in reader.get_summary().schemas.values()}
        attached = {a.name: a.data.decode() for a in reader.iter_attachments()}
    return trace, messages, plots, schemas, attached


def test_vehicles_are_where_the_trace_has_them(recorded):
    trace, messages, _, _, _ = recorded
    origin = trace.agents[0, 0, [A.X_M, A.Y_M]]
    assert len(messages["/scene"]) == len(trace.time_s)
    for k, (log_time, scene) in enumerate(messages["/scene"]):
        assert log_time == round(trace.time_s[k] * 1e9)
        assert [entity.id for entity in scene.entities] == [f"vehicle/v{i}" for i in range(3)]
        for entity, agent in zip(scene.entities, trace.agents[k], strict=True):
            (box,) = entity.cubes
            position = (box.pose.position.x, box.pose.position.y)
            assert position == pytest.approx(tuple(agent[[A.X_M, A.Y_M]] - origin))
            turned = 2.0 * math.atan2(box.pose.orientation.z, box.pose.orientation.w)
            assert math.cos(turned - agent[A.HEADING_RAD]) == pytest.approx(1.0)
            assert (box.size.x, box.size.y) == (4.5, 1.8)


def test_the_ego_is_red_in_danger(recorded):
    trace, messages, _, _, _ = recorded
    red = [scene.entities[0].cubes[0].color.r > 0.5 for _, scene in messages["/scene"]]
    collided = trace.agents[:, 0, A.COLLISION] != 0.0
    assert red == ((trace.ttc_s <= 1.0) | collided).tolist()
    assert any(red)
    assert not all(red)


def test_the_lidar_sees_the_leader_ahead(recorded):
    trace, messages, _, _, _ = recorded
    first = messages["/lidar"][0][1]
    assert len(first.ranges) == 20
    gap = trace.station_m[0, 1] - trace.station_m[0, 0] - 2.25
    assert first.ranges[0] == pytest.approx(gap, abs=0.2)


def test_plots_have_what_was_driven(recorded):
    trace, _, plots, _, _ = recorded
    assert [p["speed_mps"] for p in plots] == pytest.approx(trace.agents[:, 0, A.SPEED_MPS])
    known = np.isfinite(trace.ttc_s)
    assert [p["ttc_s"] is not None for p in plots] == known.tolist()
    assert plots[-1]["acceleration_mps2"] is None


def test_the_road_is_there_and_schemas_are_foxgloves(recorded):
    _, messages, _, schemas, attached = recorded
    assert len(messages["/road"][0][1].entities[0].lines) > 8
    assert schemas == {
        "foxglove.SceneUpdate": "protobuf",
        "foxglove.FrameTransform": "protobuf",
        "foxglove.LaserScan": "protobuf",
        "tailroad.Ego": "jsonschema",
    }
    assert attached == {"scenario.toml": "format = 1\n"}


def test_the_same_rollout_makes_the_same_file(recorded, i80, tmp_path):
    for name in ("a.mcap", "b.mcap"):
        write_recording(recorded[0], i80, tmp_path / name, 1.0, 20)
    assert (tmp_path / "a.mcap").read_bytes() == (tmp_path / "b.mcap").read_bytes()


def test_another_format_is_refused(recorded, i80, tmp_path):
    with pytest.raises(InputError, match=r"\.mcap"):
        write_recording(recorded[0], i80, tmp_path / "a.rrd", 1.0, 20)
