#!/usr/bin/env python3
"""Checks wheels: which files they have, how libraries find each other, and that these name no folder of the build.

    tools/check_wheel.py WHEEL ...

Prints a line for each fault, and ends with exit code 1 if there is one.  It needs readelf, of the binutils.
"""

import re
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Iterator
from pathlib import Path

# The libraries of a wheel, by their names up to the first dot, and where each looks for others.
RUN_PATHS = {
    "OpenMM.libs/lib/libOpenMMHelfrich": "$ORIGIN",
    "OpenMM.libs/lib/plugins/libOpenMMHelfrichCPU": "$ORIGIN:$ORIGIN/..",
    "OpenMM.libs/lib/plugins/libOpenMMHelfrichReference": "$ORIGIN:$ORIGIN/..",
    "openmmhelfrich/_helfrich": "$ORIGIN/../OpenMM.libs/lib",
}
FOLDERS = ("OpenMM.libs/include/openmmhelfrich/", "openmmhelfrich/")
# What every system has, beside the libraries of OpenMM, which are in OpenMM's wheel.
SYSTEM = re.compile(r"lib(stdc\+\+|gcc_s|m|c|pthread|dl|rt)\.so\.\d+|ld-linux-.*")
BUILD_FOLDERS = [b"/tmp/", b"/home/", b"/root/", b"/build/", b"/project/", str(Path.cwd()).encode()]


def faultsOf(wheel: Path) -> Iterator[str]:
    """Yield what is wrong with a wheel."""
    with tempfile.TemporaryDirectory() as folder, zipfile.ZipFile(wheel) as archive:
        archive.extractall(folder)
        names = [name for name in archive.namelist() if not name.endswith("/")]
        libraries = [name for name in names if Path(folder, name).read_bytes()[:4] == b"\x7fELF"]
        yield from _placeFaults(names, libraries)
        for name in libraries:
            yield from _libraryFaults(Path(folder, name), name)
        yield from _headerFaults(Path(folder, "OpenMM.libs/include"))


def _stem(name: str) -> str:
    return re.match(r"(.*/)?[^/.]*", name)[0]


def _placeFaults(names: list[str], libraries: list[str]) -> Iterator[str]:
    found = sorted(map(_stem, libraries))
    if found != sorted(RUN_PATHS):
        yield f"its libraries are {', '.join(found)}, and should be {', '.join(sorted(RUN_PATHS))}"
    for name in names:
        if name not in libraries and not name.startswith(FOLDERS) and ".dist-info/" not in name:
            yield f"{name} belongs to none of the folders {', '.join(FOLDERS)}"
    if not any(name.endswith("include/openmmhelfrich/HelfrichForce.h") for name in names):
        yield "the headers are missing"


def _libraryFaults(path: Path, name: str) -> Iterator[str]:
    text = subprocess.run(["readelf", "--dynamic", "--wide", path], capture_output=True, text=True, check=True).stdout
    entries = re.findall(r"\((\w+)\)\s+[^\[\n]*\[(.*)\]", text)
    runPaths = [value for key, value in entries if key in ("RPATH", "RUNPATH")]
    if ("RUNPATH", RUN_PATHS.get(_stem(name))) not in entries or len(runPaths) != 1:
        yield f"{name}: the RUNPATH is {runPaths}, and should be {RUN_PATHS.get(_stem(name))}"
    needed = [value for key, value in entries if key == "NEEDED"]
    if "libOpenMM.so" not in needed:
        yield f"{name}: libOpenMM.so is not among the libraries that it needs, {', '.join(needed)}"
    for other in needed:
        if not SYSTEM.fullmatch(other) and other not in ("libOpenMM.so", "libOpenMMHelfrich.so"):
            yield f"{name}: it needs {other}, which is neither OpenMM's nor every system's"
    content = path.read_bytes()
    for folder in BUILD_FOLDERS:
        for match in re.finditer(re.escape(folder) + rb"[\x20-\x7e]*", content):
            yield f"{name}: it has a path of the build, {match[0].decode()}"


def _headerFaults(folder: Path) -> Iterator[str]:
    for header in sorted(folder.rglob("*.h")):
        for name in re.findall(r'#include "([^"]*)"', header.read_text()):
            isOpenMMs = name == "OpenMM.h" or name.startswith("openmm/")
            if not isOpenMMs and not (folder / name).exists() and not (header.parent / name).exists():
                yield f"{header.relative_to(folder)} includes {name}, which is missing"


def main() -> int:
    """Check the wheels that the arguments name, and return the exit code."""
    if not sys.argv[1:]:
        print("usage: tools/check_wheel.py WHEEL ...", file=sys.stderr)
        return 2
    count = 0
    for wheel in map(Path, sys.argv[1:]):
        for fault in faultsOf(wheel):
            print(f"{wheel.name}: {fault}")
            count += 1
    if count == 0:
        print(f"wheels in order: {len(sys.argv[1:])}")
    return int(count > 0)


if __name__ == "__main__":
    sys.exit(main())
