"""Sensors of the simulated vehicles."""
