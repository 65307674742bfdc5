"""What people touch: the command line, the dashboard and batch files."""
