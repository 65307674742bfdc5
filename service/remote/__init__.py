"""Many machines: the fleet of workers and its scheduler, the query API over Zenoh, and the client."""
