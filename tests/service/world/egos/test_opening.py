"""Which egos a process may use, and where its settings come from."""

from __future__ import annotations

import sys

import pytest

from policies.egos import ego_names
from service.errors import InputError
from service.evaluation.job import make_job
from service.world.egos.open import check_ego, open_ego, usable_egos
from service.world.egos.settings import EgoSettings
from service.world.egos.sumo import NAMES as SUMO_EGOS

MODULE = """
class Careful:
    def reset(self, seed): pass
    def act(self, observation): return -1.0, 0.0
class Mute: pass
class Broken:
    def __init__(self): raise RuntimeError("no licence")
open("imported", "w").close()
"""
NONE = EgoSettings()


@pytest.fixture
def module(tmp_path, monkeypatch):
    """A module of the user's, which leaves a mark when it is imported."""
    (tmp_path / "my_egos.py").write_text(MODULE, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    yield tmp_path / "imported"
    sys.modules.pop("my_egos", None)


def test_a_class_is_imported_only_where_the_process_was_told_so(module, make_scenario, i80):
    with pytest.raises(InputError, match="not one that this process may import"):
        open_ego("my_egos:Careful", make_scenario(), i80, NONE)
    with pytest.raises(InputError, match="not one that this process may import"):
        # as a job that came over the network would
        make_job(make_scenario(), "my_egos:Careful", 0.5, "naive", 1, {})
    assert not module.exists()
    ego = open_ego(
        "my_egos:Careful", make_scenario(), i80, EgoSettings(python=frozenset({"my_egos:Careful"}))
    )
    assert module.exists()
    assert ego.act(None) == (-1.0, 0.0)
    assert ego.name == "my_egos:Careful"


@pytest.mark.parametrize(
    ("name", "told"),
    [
        ("my_egos:Mute", "has no method 'reset'"),
        ("my_egos:Broken", "RuntimeError: no licence"),
        ("my_egos:None_", "AttributeError"),
        ("nowhere:Careful", "No module named 'nowhere'"),
    ],
)
def test_a_class_that_cannot_be_made_says_why(module, make_scenario, i80, name, told):
    with pytest.raises(InputError, match=told):
        open_ego(name, make_scenario(), i80, EgoSettings(python=frozenset({name})))


@pytest.mark.parametrize(
    ("name", "told"),
    [
        ("lidr", "did you mean 'lidar'"),
        ("zenoh:", "1 to 64 letters"),
        ("zenoh:a/b", "1 to 64 letters"),
        ("zenoh:**", "1 to 64 letters"),
        ("zenoh:" + "a" * 65, "1 to 64 letters"),
        ("os.path:join(", "neither MODULE:CLASS nor zenoh:NAME"),
        ("../x:y", "neither MODULE:CLASS nor zenoh:NAME"),
    ],
)
def test_a_name_that_cannot_be_is_refused(name, told):
    with pytest.raises(InputError, match=told):
        check_ego(name, NONE)


def test_settings_survive_the_way_through_the_environment():
    settings = EgoSettings(
        "tls/host:7448", "zenoh.json5", 0.25, 30.0, frozenset({"a.b:C", "d:E"}), "tcp/gpu:7449"
    )
    assert EgoSettings.from_environment(settings.as_environment()) == settings
    assert EgoSettings.from_environment({}) == NONE
    assert usable_egos(settings) == [*ego_names(), *SUMO_EGOS, "a.b:C", "d:E"]


@pytest.mark.parametrize(
    ("variables", "told"),
    [
        ({"TAILROAD_EGO_DEADLINE_S": "soon"}, "TAILROAD_EGO_DEADLINE_S is 'soon'"),
        ({"TAILROAD_EGO_DEADLINE_S": "nan"}, "deadline of nan s cannot be"),
        ({"TAILROAD_EGO_PATIENCE_S": "-1"}, "patience of -1 s cannot be"),
        ({"TAILROAD_EGO_ADDRESS": "localhost"}, "'localhost' is not an address"),
        ({"TAILROAD_EGO_ADDRESS": 'tcp/x:1"], listen: ["tcp/0.0.0.0:1'}, "is not an address"),
        ({"TAILROAD_PYTHON_EGOS": "os.system"}, "'os.system' is not a Python class"),
    ],
)
def test_settings_that_cannot_be_are_refused(variables, told):
    with pytest.raises(InputError, match=told):
        EgoSettings.from_environment(variables)
