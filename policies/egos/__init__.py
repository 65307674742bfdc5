"""Ego policies: the driving policies under test, behind one protocol."""

from policies.egos.protocol import EgoPolicy, Observation
from policies.egos.registry import ego_digest, ego_names, ego_weights, load_ego

__all__ = ["EgoPolicy", "Observation", "ego_digest", "ego_names", "ego_weights", "load_ego"]
