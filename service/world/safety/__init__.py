"""Safety measures of a rollout; low is dangerous for all of them."""
