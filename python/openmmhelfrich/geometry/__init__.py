"""Triangulated surfaces: their connectivity, measures, files and simple shapes."""
