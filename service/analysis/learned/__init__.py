"""What a search learned: how the starts and the drivers of dangerous rollouts differ from the base distribution."""
