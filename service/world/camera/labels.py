"""What a pixel of the segmentation image says."""

from enum import IntEnum


class Label(IntEnum):
    """Classes of the scene's fixed parts; vehicles are VEHICLE_ID + their row."""

    SKY = 0
    TERRAIN = 1
    WATER = 2
    ASPHALT = 3
    SHOULDER = 4
    MARKING = 5
    BARRIER = 6
    WALL = 7
    BUILDING = 8
    SIGN = 9
    POLE = 10
    BRIDGE = 11
    PLANT = 12


VEHICLE_ID = 1000  # of the vehicle in row 0
