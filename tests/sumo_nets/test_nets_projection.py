"""UTM zone 10, against published values and itself."""

from __future__ import annotations

import numpy as np
import pytest

from sumo_nets import i80_geometry as sources
from sumo_nets.corridor import load_corridor
from sumo_nets.projection import from_utm, to_utm


def test_there_and_back_is_exact_to_a_tenth_of_a_millimetre():
    lon, lat = np.meshgrid(np.linspace(-126.0, -120.0, 13), np.linspace(-60.0, 70.0, 27))
    again = from_utm(*to_utm(lon, lat))
    assert again[0] == pytest.approx(lon, abs=1e-9)
    assert again[1] == pytest.approx(lat, abs=1e-9)


def test_the_network_of_openstreetmap_gives_the_same_frame():
    # node 35833157 (the Ashby gore) of the OSM extract and where PROJ put it in the SUMO network made from it
    east, north = to_utm(-122.2976575, 37.8440031)
    assert (east - 561541.56, north - 4187906.01) == pytest.approx((253.02, 833.43), abs=0.01)
    # the central meridian is at 500 km east, the equator at 0
    assert to_utm(-123.0, 0.0) == pytest.approx((500_000.0, 0.0), abs=1e-6)


def test_longitude_and_latitude_of_the_built_in_road():
    road = load_corridor("i80")
    lon, lat = from_utm(
        road.ref_x[[0, -1]] - sources.NET_OFFSET[0], road.ref_y[[0, -1]] - sources.NET_OFFSET[1]
    )
    assert lat == pytest.approx([37.8338, 37.8519], abs=3e-4)
    assert lon == pytest.approx([-122.2942, -122.2994], abs=5e-4)
