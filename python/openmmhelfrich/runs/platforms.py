"""The platform that a configuration asks for."""

import os
import threading

import openmm as mm

from ..messages import quoted
from .config import Config

# More threads than this for each processor would wait for each other.
THREADS_PER_PROCESSOR = 32


def platformOf(config: Config) -> tuple[mm.Platform, dict[str, str]]:
    """Return the Platform that a Config asks for, and its properties."""
    names = [mm.Platform.getPlatform(i).getName() for i in range(mm.Platform.getNumPlatforms())]
    name, threads = config.platform.name, config.platform.threads
    if name == "CPU":
        _checkThreads(threads)
    if name not in names:
        raise ValueError(f"[platform] name is {quoted(name)}; it must be one of {', '.join(names)}")
    if threads is not None and name != "CPU":
        raise ValueError(f"[platform] threads is {threads}; only the CPU platform has threads, not {name}")
    if config.platform.precision != "double" and name != "CPU":
        raise ValueError(
            f"[platform] precision is '{config.platform.precision}'; only the CPU platform has another than 'double', "
            f"not {name}"
        )
    return mm.Platform.getPlatformByName(name), {} if threads is None else {"Threads": str(threads)}


def _checkThreads(threads: int | None) -> None:
    """Raise a ValueError if the system cannot start so many threads: the program would end without a word."""
    processors = os.cpu_count() or 1
    count, most = threads or processors, THREADS_PER_PROCESSOR * processors
    if count > most:
        raise ValueError(
            f"the number of threads is {count}; it must be at most {most}, {THREADS_PER_PROCESSOR} for each of the "
            f"{processors} processors that there are"
        )
    done, started = threading.Event(), 0
    try:
        for _ in range(2 * count):  # OpenMM's own, and as many of the force's
            threading.Thread(target=done.wait, daemon=True).start()
            started += 1
    except RuntimeError:
        raise ValueError(
            f"the number of threads is {count}, and the system lets this program start {started // 2}; ask for fewer, "
            "or look at its limits of processes and memory"
        ) from None
    finally:
        done.set()
