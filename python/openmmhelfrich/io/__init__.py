"""Files of topologies and trajectories."""
