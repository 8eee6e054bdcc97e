"""Whole runs and grids of runs: from configurations to results."""
