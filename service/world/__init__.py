"""The simulated world: scenarios, vehicles, roads, sensors, safety measures, the camera and the egos."""
