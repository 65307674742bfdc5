"""The film: a picture a state with the road, the camera, f so far and the actions in their places."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

import ce
from service.analysis.trace import Trace, record
from service.analysis.video import EgoView, write_frames, write_video
from service.analysis.video.charts import BOTTOM, LEFT, RIGHT, TOP, action_chart, measure_chart
from service.analysis.video.film import CAMERA_WIDTH, FOOT, HEAD, HEIGHT, MIDDLE, WIDTH, pictures
from service.analysis.video.ink import DANGER, EGO
from service.analysis.video.top_down import ASPHALT, SCALE, TopDown
from service.errors import InputError
from service.evaluation.job import Problem, make_job
from service.world import agents as A
from service.world.safety.measure import with_measure


def traced(scenario) -> tuple[Trace, Problem, np.ndarray, int]:
    problem = Problem(make_job(scenario, "idm", 0.5, "naive", 1, {}))
    x, noise_seeds = ce.draw(problem.base, 3, "estimate", 0, 0, 1)
    with problem.simulator() as simulator:
        return record(problem, simulator, x[0], int(noise_seeds[0])), problem, x[0], int(noise_seeds[0])


@pytest.fixture(scope="module")
def short(make_scenario):
    """A rollout of a second, its problem, its draw and its noise seed."""
    return traced(make_scenario({"horizon_s = 10.0": "horizon_s = 1.0"}))


def near(image: np.ndarray, colour: tuple[int, int, int]) -> np.ndarray:
    """Where the picture has that colour."""
    return (np.abs(image.astype(int) - colour) <= 12).all(axis=-1)


def test_there_is_a_picture_for_each_state_with_road_and_camera_side_by_side(short):
    trace, problem, x, noise_seed = short
    view = EgoView(problem.job.scenario, problem.corridor, x, noise_seed)
    images = list(pictures(trace, problem.corridor, "title", view))
    assert len(images) == len(trace.time_s) == 11
    assert {image.shape for image in images} == {(HEIGHT, WIDTH, 3)}
    road = images[5][HEAD : HEAD + MIDDLE, : WIDTH - CAMERA_WIDTH]
    camera = images[5][HEAD : HEAD + MIDDLE, WIDTH - CAMERA_WIDTH :]
    assert near(road, ASPHALT).mean() > 0.3
    assert (near(road, EGO) | near(road, DANGER)).any()
    expected = view.pictures(trace, CAMERA_WIDTH, MIDDLE).draw(5)
    assert np.array_equal(camera, expected)
    # the sky is brighter than the asphalt
    assert camera[: MIDDLE // 3].mean() > camera[2 * MIDDLE // 3 :].mean()
    assert not np.array_equal(camera, images[0][HEAD : HEAD + MIDDLE, WIDTH - CAMERA_WIDTH :])


def test_without_a_camera_the_road_takes_its_place(short):
    trace, problem, _, _ = short
    image = next(pictures(trace, problem.corridor, "title"))
    assert near(image[HEAD : HEAD + MIDDLE, WIDTH - CAMERA_WIDTH :], ASPHALT).mean() > 0.3


def test_the_ego_stands_where_the_trace_has_it(short):
    trace, problem, _, _ = short
    trace.ttc_s[:] = 9.0
    top_down = TopDown(trace, problem.corridor, 900, MIDDLE, 20)
    rows, columns = np.nonzero(near(top_down.draw(4), EGO))
    assert columns.mean() == pytest.approx(0.42 * 900, abs=4)
    offset = trace.agents[4, trace.ego, A.OFFSET_M] - top_down._middle
    assert rows.mean() == pytest.approx(0.5 * MIDDLE - offset * SCALE, abs=4)


def test_a_ray_is_red_where_the_ego_runs_into_something(short):
    trace, problem, _, _ = short
    agents = trace.agents.copy()
    ego, other = agents[3, trace.ego], agents[3, (trace.ego + 1) % len(trace.names)]
    other[:] = ego
    other[[A.X_M, A.Y_M]] += 15.0 * ego[[A.COS, A.SIN]]
    other[A.ALONG_M] += 15.0
    other[A.SPEED_MPS] = ego[A.SPEED_MPS] - 10.0
    calm = TopDown(trace, problem.corridor, 900, MIDDLE, 20).draw(3)
    closing = Trace(**{**trace.__dict__, "agents": agents, "ttc_s": np.full_like(trace.ttc_s, 9.0)})
    image = TopDown(closing, problem.corridor, 900, MIDDLE, 20).draw(3)
    ahead = slice(int(0.42 * 900 + 4 * SCALE), int(0.42 * 900 + 12 * SCALE))
    redder = image.astype(int)[:, ahead, 2] - image.astype(int)[:, ahead, 0] > 60
    assert redder.any()
    assert not (calm.astype(int)[:, ahead, 2] - calm.astype(int)[:, ahead, 0] > 60).any()


def test_the_charts_show_what_has_been_and_nothing_of_what_comes(short):
    trace, _, _, _ = short
    for chart in (measure_chart(trace, 600, FOOT), action_chart(trace, 600, FOOT)):
        early = near(chart.draw(3)[TOP + 2 : FOOT - BOTTOM - 2], EGO)
        late = near(chart.draw(10)[TOP + 2 : FOOT - BOTTOM - 2], EGO)
        third = LEFT + 0.3 * (600 - LEFT - RIGHT)
        assert np.nonzero(early)[1].max() <= third + 6
        assert np.nonzero(late)[1].max() > third + 100


@pytest.mark.parametrize(
    ("measure", "told"), [("ttc", True), ("rss", True), ("stl: always(ttc_s >= 1)", False), ("drac", True)]
)
def test_f_so_far_is_drawn_for_every_measure_that_has_one(make_scenario, measure, told):
    trace, _, _, _ = traced(with_measure(make_scenario({"horizon_s = 10.0": "horizon_s = 1.0"}), measure))
    chart = measure_chart(trace, 600, FOOT).draw(10)
    assert near(chart, EGO).any()
    assert near(chart, DANGER).any() == told


def test_pictures_are_written_one_by_one_and_as_a_film(short, tmp_path):
    trace, problem, _, _ = short
    paths = write_frames(trace, problem.corridor, tmp_path / "frames", "title")
    assert [path.name for path in paths] == [f"{k:05d}.png" for k in range(11)]
    assert np.array_equal(cv2.imread(str(paths[4])), list(pictures(trace, problem.corridor, "title"))[4])
    write_video(trace, problem.corridor, tmp_path / "film.mp4", "title")
    film = cv2.VideoCapture(str(tmp_path / "film.mp4"))
    assert film.get(cv2.CAP_PROP_FRAME_COUNT) == 11
    assert film.get(cv2.CAP_PROP_FPS) == pytest.approx(10.0)
    with pytest.raises(InputError, match=r"films are written as \.mp4"):
        write_video(trace, problem.corridor, tmp_path / "film.avi", "title")
