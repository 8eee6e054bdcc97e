"""The version of the package."""

from importlib.metadata import PackageNotFoundError, version

try:
    __version__ = version("openmm-helfrich")
except PackageNotFoundError:  # a source tree on the path, not installed
    __version__ = "unknown"
