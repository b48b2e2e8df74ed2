"""Coverage of intervals, designed inputs."""
