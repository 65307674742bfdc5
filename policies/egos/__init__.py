"""Ego policies: the driving policies under test, behind one protocol."""

from policies.egos.protocol import EgoPolicy, Observation
from policies.egos.registry import ego_names, load_ego

__all__ = ["EgoPolicy", "Observation", "ego_names", "load_ego"]
