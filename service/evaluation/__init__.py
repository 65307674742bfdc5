"""From a scenario to an estimate: the loop that is Algorithm 1, its jobs, pools, batches and records."""
