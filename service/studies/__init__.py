"""Studies of the product itself: the paper's experiments, how real the drivers are, how fast the world is."""
