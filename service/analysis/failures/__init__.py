"""How the ego fails: dangerous rollouts ranked by likelihood, run once more, grouped into failure modes, exported."""
