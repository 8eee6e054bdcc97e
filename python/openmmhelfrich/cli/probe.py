"""A program that loads the libraries one after the other and prints what it has found after each, as JSON.

It runs in a process of its own, since loading can end a process.  Its arguments are the path to find packages on and
the plugin of the CPU platform.
"""

import ctypes
import json
import sys
from importlib import import_module
from typing import Any


def look(plugin: str) -> None:
    """Load NumPy, OpenMM, the extension and the plugin of the CPU platform, and print what is found after each."""
    found: dict[str, Any] = {"loading": "NumPy"}
    try:
        _tell(found)
        import numpy  # noqa: F401

        _tell(found, loading="OpenMM")
        import openmm as mm

        platform = mm.Platform
        _tell(found, library=mm.version.openmm_library_path, failures=list(platform.getPluginLoadFailures()))
        _tell(found, loading="the extension")
        import_module("openmmhelfrich.helfrich")
        platforms = [platform.getPlatform(i) for i in range(platform.getNumPlatforms())]
        _tell(found, platforms=[p.getName() for p in platforms])
        _tell(found, supporting=[p.getName() for p in platforms if p.supportsKernels(["CalcHelfrichForce"])])
        if "CPU" in found["platforms"]:
            _tell(found, threads=platform.getPlatform("CPU").getPropertyDefaultValue("Threads"))
        _tell(found, instructionSet=_instructionSet(plugin))
        _tell(found, loaded=_loadedLibraries(), loading=None)
    except Exception as error:
        _tell(found, error=str(error))


def _tell(found: dict[str, Any], **more: Any) -> None:
    found.update(more)
    print(json.dumps(found), flush=True)


def _instructionSet(plugin: str) -> str:
    function = ctypes.CDLL(plugin).getHelfrichInstructionSet
    function.restype = ctypes.c_char_p
    return function().decode()


def _loadedLibraries() -> list[str]:
    """Return the files that are loaded as OpenMM's main library, where the system tells."""
    try:
        with open("/proc/self/maps", encoding="utf-8") as maps:
            files = {line.split(maxsplit=5)[-1].strip() for line in maps if "/libOpenMM." in line}
    except OSError:
        files = set()
    return sorted(files)


if __name__ == "__main__":
    sys.path[:] = json.loads(sys.argv[1])
    look(sys.argv[2])
