"""Formats of mesh files, a module each."""

# The suffixes of the files that are written, the first one by default.
WRITTEN = (".ply", ".stl", ".obj", ".off", ".vtu", ".vtk", ".msh", ".tsi", ".q", ".h5")
