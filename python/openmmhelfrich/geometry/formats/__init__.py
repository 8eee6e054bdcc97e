"""Formats of mesh files, a module each."""
