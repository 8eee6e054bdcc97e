"""The command that describes the installation."""

import json
import os
import platform
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from importlib.metadata import PackageNotFoundError, version
from typing import Annotated, Any

import typer

from .. import installation
from ..installation import Fault
from ..version import __version__
from . import probe
from .errors import friendly
from .terminal import show

app = typer.Typer()

EXTRAS = ("analysis", "looking", "sweep", "remesh")  # those that bring what users need


@app.command()
@friendly
def info(
    check: Annotated[bool, typer.Option("--check", help="Look for what is wrong, and name the cure.")] = False,
) -> None:
    """Print what reports of problems need: versions, platforms, processor, extras, and plugins that failed to load.

    With --check it looks for the usual causes of trouble instead: no OpenMM, two of them or the wrong one, NumPy,
    glibc, conda mixed with pip, missing or foreign libraries, plugins that cannot be loaded. It ends with exit code 1
    if it finds one.

    Examples:

    openmm-helfrich info

    openmm-helfrich info --check
    """
    found = _probe()
    if not check:
        show(_lines(found))
        return
    faults = list(_faults(found))
    for fault in faults:
        print(f"{fault.what}\n  cure: {fault.cure}")
    if faults:
        raise typer.Exit(1)
    print(f"openmm-helfrich {__version__} is installed as it should be")


def _probe() -> dict[str, Any]:
    """Return what the probe found, with what ended it."""
    command = [sys.executable, probe.__file__, json.dumps(sys.path), installation.libraryFiles()[-1]]
    done = subprocess.run(command, capture_output=True, text=True)
    found = json.loads(done.stdout.splitlines()[-1]) if done.stdout else {"loading": "Python"}
    if done.returncode < 0:
        found["error"] = f"the process ends with {signal.Signals(-done.returncode).name}"
    elif done.returncode > 0:
        found["error"] = done.stderr.strip().splitlines()[-1]
    return found


def _faults(found: dict[str, Any]) -> Iterator[Fault]:
    """Yield what is wrong: what files and the environment tell, and only where they tell nothing, what loading does."""
    failures = [text for text in found.get("failures", []) if "Helfrich" in text]
    said = "\n".join(filter(None, [found.get("error"), *failures]))
    faults = list(installation.findFaults(said))
    loaded = found.get("loaded", [])
    if len(loaded) > 1:
        faults.append(Fault(f"two OpenMMs are loaded, {' and '.join(loaded)}", installation.FRESH))
    instructionSet = found.get("instructionSet", "")
    if ";" in instructionSet:
        faults.append(Fault(instructionSet, "unset OPENMM_HELFRICH_SIMD"))
    lacking = [name for name in found.get("platforms", []) if name in installation.PLATFORMS]
    lacking = [name for name in lacking if name not in found.get("supporting", [])]
    if not faults and said:
        faults.append(Fault(f"{found['loading'] or 'a plugin'} cannot be loaded: {said}", installation.REINSTALL))
    if not faults and lacking:
        faults.append(Fault(f"the plugin of the platform {lacking[0]} is not loaded", installation.REINSTALL))
    yield from faults


def _lines(found: dict[str, Any]) -> Iterator[tuple[str, str]]:
    yield "openmm-helfrich", f"{__version__}, in {installation.siteFolder()}"
    folders = installation.openmmFolders()
    for folder in folders or [""]:
        text = f"{installation.openmmVersion(folder)}, in {os.path.dirname(folder)}" if folder else "not installed"
        yield "OpenMM", text if folder == (folders or [""])[0] else f"{text}; hidden by the one above"
    yield "NumPy", _versionOf("numpy")
    yield "Python", f"{platform.python_version()}, {sys.executable}"
    yield "system", f"{platform.platform()}, glibc {installation.glibcVersion() or 'none'}"
    yield "processor", f"{_processor()}, {_usableCores()} of {os.cpu_count()} cores"
    yield "instruction set", found.get("instructionSet", "unknown")
    yield "platforms", ", ".join(_platforms(found)) or "unknown"
    yield "threads", f"{found.get('threads', 'unknown')} by default"
    for name in EXTRAS:
        yield f"extra {name}", ", ".join(f"{package} {_versionOf(package)}" for package in _packagesOf(name))
    for variable in sorted(os.environ):
        if variable.startswith("OPENMM_") or variable in ("LD_LIBRARY_PATH", "PYTHONPATH", "CONDA_PREFIX"):
            yield variable, os.environ[variable]
    for failure in found.get("failures", []):
        yield "not loaded", " ".join(failure.split())
    if "error" in found:
        yield "error", f"loading {found['loading']}: {found['error']}"


def _platforms(found: dict[str, Any]) -> Iterator[str]:
    for name in found.get("platforms", []):
        yield name if name in found.get("supporting", []) else f"{name} (without membranes)"


def _versionOf(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return "not installed"


def _packagesOf(extra: str) -> Iterator[str]:
    for distribution in installation.ownDistributions()[:1]:
        for requirement in distribution.requires or []:
            if re.search(rf"extra == ['\"]{extra}['\"]", requirement) and "openmm-helfrich" not in requirement:
                yield re.split(r"[^\w.-]", requirement)[0]


def _usableCores() -> int | None:
    """Return the number of cores that this process may use, where the system tells."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()


def _processor() -> str:
    try:
        with open("/proc/cpuinfo", encoding="utf-8") as file:
            found = re.search(r"^model name\s*:\s*(.*)$", file.read(), re.MULTILINE)
    except OSError:
        found = None
    return found[1] if found else platform.processor() or platform.machine()
