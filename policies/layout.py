"""What a vehicle perceives: the 51 values that driver networks and ego policies are given (Kuefler et al. 2017).

All values are in physical units; networks fold their own standardisation into their first layer.
"""

LANE_OFFSET_M = 0  # of the vehicle's centre from its lane's centre, positive to the left
LANE_HEADING_RAD = 1  # relative to the lane, counter-clockwise
SPEED_MPS = 2
LENGTH_M = 3
WIDTH_M = 4
LANE_CURVATURE_PER_M = 5  # positive where the lane turns left
LEFT_MARKING_M = 6  # from the vehicle's centre to its lane's left marking, >= 0 inside the lane
RIGHT_MARKING_M = 7
# flags, 0 or 1: a lane open to everybody lies beyond the left marking, here and for LANE_AHEAD_M
LANE_TO_THE_LEFT = 8
LANE_TO_THE_RIGHT = 9
INCIDENT = 10  # collision, off the road, or reversing
RANGE_M = 11  # the first of BEAMS ranges from the vehicle's centre; LIDAR_RANGE_M where nothing is hit
RANGE_RATE_MPS = 31  # the first of BEAMS relative velocities along the beam; negative when closing

LANE_AHEAD_M = 120.0  # a lane that ends sooner (a ramp's) does not invite anybody

BEAMS = 20  # beam i points at heading + 2 pi i / BEAMS, counter-clockwise; beam 0 straight ahead
LIDAR_RANGE_M = 100.0
OBSERVATION_SIZE = 51

# Limits of what a vehicle can do; every action is clipped to them.
MAX_ACCELERATION_MPS2 = 4.0
MAX_DECELERATION_MPS2 = 8.0
MAX_TURN_RATE_RADPS = 0.3
MIN_TURN_RADIUS_M = 5.0  # a car's turning circle: a standing vehicle does not turn

# The driver network: 51 -> 200 -> 100 -> 4 (means and log standard deviations of acceleration and turn rate).
HIDDEN_1 = 200
HIDDEN_2 = 100
OUTPUTS = 4
HEAD_SIZE = (HIDDEN_2 + 1) * OUTPUTS  # 404: the weights xi
LOG_STD_MIN = -5.0
LOG_STD_MAX = 0.5
