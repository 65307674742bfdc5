"""Figures published for drivers learned from NGSIM, the targets taken from them, and how they were made."""

# Targets for held-out vehicles of I-80 after 20 s: the best of the published GAIL families.
TARGET_HORIZON_S = 20.0
TARGETS = {
    "position_m": (12.8, "position, m"),
    "speed_mps": (2.07, "speed, m/s"),
    "lane_offset_m": (1.12, "lane offset, m"),
    "touching_share": (0.031, "frames in collision"),
    "hard_brakes_share": (0.025, "frames with a hard brake (-3 m/s² or harder)"),
    "off_road_share": (0.0003, "frames off the road"),
}
SOURCES = (
    "Kuefler, Morton, Wheeler, Kochenderfer: Imitating driver behavior with generative adversarial networks, IV 2017 "
    "(GAIL)",
    "Bhattacharyya, Phillips, Wulfe, Morton, Kuefler, Kochenderfer: Multi-agent imitation learning for driving "
    "simulation, IROS 2018 (PS-GAIL)",
    "Bhattacharyya, Phillips, Liu, Gupta, Driggs-Campbell, Kochenderfer: Simulating emergent properties of human "
    "driving behavior using multi-agent reward augmented imitation learning, ICRA 2019 (RAIL)",
    "Bhattacharyya et al.: Modeling human driving behavior through generative adversarial imitation learning, 2020",
)
PROTOCOL = (
    "In the published evaluation code (sisl/ngsim_env) 20 to 100 vehicles of a recorded scene are driven by the model "
    "at once and the others replay; nothing ends or is corrected at a collision; a vehicle's figure is its distance "
    "from its recorded self at that moment, and what is plotted is the mean of that over vehicles, called RMSE. The "
    "vehicles are those of US-101's 15-minute files, where most traffic is faster than on I-80."
)
