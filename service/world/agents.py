"""The state of all vehicles as one array, a row each; columns by name."""

X_M, Y_M, HEADING_RAD, SPEED_MPS, LENGTH_M, WIDTH_M = 0, 1, 2, 3, 4, 5
COS, SIN = 6, 7  # of the heading
STATION, ALONG_M = 8, 9  # nearest station of the road's reference line, and metres beyond it
OFFSET_M = 10  # from the reference line, positive to the left
LANE = 11  # 0 is the leftmost
LANE_OFFSET_M, LANE_HEADING_RAD, CURVATURE_PER_M, LEFT_MARKING_M, RIGHT_MARKING_M = 12, 13, 14, 15, 16
COLLISION, OFF_ROAD, REVERSING = 17, 18, 19  # 0 or 1
ACTIVE = 20  # 1 while the vehicle is on the road; sensors see active vehicles only
TAKEN_OVER = 21  # 1 once an environment vehicle is driven by the lane-keeping intelligent driver
ACCELERATION_MPS2, TURN_RATE_RADPS = 22, 23  # as applied in the last step
LANE_TO_THE_LEFT, LANE_TO_THE_RIGHT = 24, 25  # 1 where one lies there and goes on
COLUMNS = 26
