"""The lanes kept beside the built-in nets are those that the nets say, with the same bits wherever they are read."""

from dataclasses import fields

import numpy as np
import pytest

from sumo_nets.corridor import BUILT_IN, LANES_FILE, built_in_folder, load_corridor, read_corridor
from sumo_nets.errors import NetworkError
from sumo_nets.stored import store_lanes, stored_lanes

PROCESSORS_M = 1e-6  # far above what processors' last bits make of it, far below what decides anything else


@pytest.mark.parametrize("name", BUILT_IN)
def test_kept_lanes_are_those_of_the_net(name):
    kept = load_corridor(name)
    read = read_corridor(kept.net_path, kept.edges, name=name)
    for field in fields(kept):
        ours, theirs = getattr(kept, field.name), getattr(read, field.name)
        assert type(ours) is type(theirs), field.name
        if isinstance(ours, np.ndarray):
            assert ours.dtype == theirs.dtype, field.name
            np.testing.assert_allclose(ours, theirs, rtol=0, atol=PROCESSORS_M, err_msg=field.name)
        else:
            assert ours == theirs, field.name


def test_lanes_of_another_net_are_not_used_and_a_damaged_file_is_named(tmp_path):
    road = load_corridor("us101")
    file = store_lanes(road, tmp_path / LANES_FILE)
    net = built_in_folder("us101") / "us101.net.xml"
    kept = stored_lanes(file, net)
    assert kept is not None
    assert np.array_equal(kept["ref_x"], road.ref_x)
    other = tmp_path / "us101.net.xml"
    other.write_bytes(net.read_bytes() + b"\n")
    assert stored_lanes(file, other) is None
    assert stored_lanes(tmp_path / "none.npz", net) is None
    file.write_bytes(file.read_bytes()[:500])
    with pytest.raises(NetworkError, match=r"cannot be read .* `python -m sumo_nets\.build lanes`"):
        stored_lanes(file, net)
