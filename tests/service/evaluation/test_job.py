"""A job: what it is made of is what its rollouts are made of."""

import msgspec
import pytest

from policies.egos import ego_digest
from service.errors import StoreError
from service.evaluation.job import Problem, compiled, make_job
from service.world.scenario import load_scenario


def test_an_ego_whose_weights_have_changed_is_not_mixed_in():
    job = make_job(load_scenario("i80-10s"), "lidar", 0.5, "naive", 1, {})
    assert job.ego_sha256 == ego_digest("lidar") != ""
    changed = msgspec.structs.replace(job, ego_sha256="another")
    for start in (Problem(changed).simulator, lambda: compiled(changed)):
        with pytest.raises(StoreError, match="the weights of ego 'lidar' have changed since this run began"):
            start()
    made_before = msgspec.structs.replace(job, ego_sha256="")  # by a version that did not keep it
    Problem(made_before).check_ego_weights()


def test_an_ego_without_weights_has_none_to_change():
    job = make_job(load_scenario("i80-10s"), "idm", 0.5, "naive", 1, {})
    assert job.ego_sha256 == ""
    Problem(job).check_ego_weights()
