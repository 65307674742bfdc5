"""Driver model and ego policies: what vehicles perceive, the networks that drive them, and their weights."""
