"""What recorded and simulated traffic is like, measured the same way: motion, gaps, lane changes, distances."""
