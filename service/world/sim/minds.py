"""What a driver has in mind, beside where the vehicle is: one row a vehicle, columns by name.

Together with the agents' array this is the whole state of a rollout with human drivers between two steps.
"""

REACTION_S = 0  # its reaction time
HAZARD_S = 1  # how long it has perceived a conflict ahead, quicker where it is urgent
SIDE_S = 2  # how long it has perceived a conflict beside
BRAKE_MPS2 = 3  # the deceleration of its evasive braking; 0 while it does not brake so
AWAY_S = 4  # left of a glance off the road
HELD_MPS2 = 5  # the acceleration that is held during a glance
SPREAD_RADPS = 6  # standard deviation of the turn rate's noise that the network answered last
EVADED = 7  # 1 where its last action was evasive: braking or steering
SINCE_AWAY_S = 8  # since it last looked off the road; large where it never has
LONGEST_AWAY_S = 9  # of the glance that is under way or was the last
LEAKED = 10  # how many glances have begun in a conflict
RESISTED = 11  # how many have been suppressed in one
GIVEN_UP = (
    12  # lateral direction (-1 right, 1 left) back from a lane change given up, until in the middle of a lane
)
COLUMNS = 13
NEVER_S = 1e9
