"""The world: SUMO beside compiled kernels for dynamics, projection, collision and the drivers."""
