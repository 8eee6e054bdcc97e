"""What is wrong with an installation, and the cure.

Neither OpenMM nor the extension is imported here: what is looked at are files, the environment, and what loaders say.
"""

import contextlib
import os
import re
import sys
from collections.abc import Iterator
from importlib.machinery import EXTENSION_SUFFIXES
from importlib.util import find_spec
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from importlib.metadata import Distribution, PackagePath

NAME = "openmm-helfrich"
# What pyproject.toml asks for: the first version that will do, and the first that will not.
OPENMM, NO_OPENMM = (8, 6), (8, 7)
NUMPY = (2,)
GLIBC = (2, 34)  # what OpenMM's wheels need
PLATFORMS = ("Reference", "CPU")
PACKAGE = os.path.dirname(os.path.abspath(__file__))

FRESH = f"make a new environment (python -m venv) and pip install {NAME} there"
REINSTALL = f"pip install --force-reinstall --no-deps {NAME}"
INSTALL_OPENMM = "pip install 'openmm>=8.6,<8.7'"


class Fault(NamedTuple):
    """What is wrong, and what to do."""

    what: str
    cure: str

    def __str__(self) -> str:
        return f"{self.what}. Cure: {self.cure}"


class InstallationError(ImportError):
    """An ImportError whose text says the cause and the cure."""


def findFaults(said: str = "") -> Iterator[Fault]:
    """Yield what is wrong, causes before what follows from them.

    Parameters
    ----------
    said : str, default: ""
        what a loader said, where something could not be loaded
    """
    yield from _openmmFaults()
    yield from _systemFaults()
    yield from _condaFaults()
    yield from _pathFaults(said)
    yield from _numpyFaults(said)
    yield from _fileFaults()
    yield from _recordFaults()
    yield from _requirementFaults()
    yield from _loaderFaults(said)


def requireInstallation() -> None:
    """Raise an InstallationError if something is missing or too old that is seen without loading anything."""
    for faults in (_openmmFaults, _systemFaults, _fileFaults):
        for fault in faults():
            raise InstallationError(str(fault))


@contextlib.contextmanager
def explained() -> Iterator[None]:
    """Replace an ImportError of libraries by an InstallationError."""
    try:
        yield
    except ImportError as error:
        if isinstance(error, InstallationError) or not isOfLibraries(error):
            raise
        raise InstallationError(explainLoading(str(error))) from None


def isOfLibraries(error: ImportError) -> bool:
    """Return whether an error is of OpenMM's libraries, NumPy's or ours, and not of another package.

    Loaders name the extension without its package, and have its path; NumPy raises some errors that have neither.
    """
    name = (error.name or "").split(".")[0]
    if name in ("openmm", "_openmm", "_helfrich", "numpy"):
        return True
    isLoaders = re.search(r"\.so|\.dylib|_helfrich|numpy", str(error)) is not None
    return isLoaders and (name in ("", "openmmhelfrich") or "numpy" in (error.path or "").split(os.sep))


def explainLoading(said: str) -> str:
    """Return what to tell a user of libraries that cannot be loaded, as a loader says it."""
    for fault in findFaults(said):
        return str(fault)
    return str(Fault(f"the libraries of {NAME} cannot be loaded: {said}", REINSTALL))


def openmmFolders() -> list[str]:
    """Return the folders of all OpenMM packages on the path, the one that is imported first."""
    folders = [os.path.join(os.path.realpath(path or "."), "openmm") for path in sys.path]
    return list(dict.fromkeys(folder for folder in folders if os.path.isfile(os.path.join(folder, "version.py"))))


def openmmVersion(folder: str) -> str:
    """Return the version of the OpenMM in a folder, "unknown" if it does not say."""
    with open(os.path.join(folder, "version.py"), encoding="utf-8") as file:
        found = re.search(r"^short_version = '(.*)'", file.read(), re.MULTILINE)
    return found[1] if found else "unknown"


def glibcVersion() -> str | None:
    """Return the version of glibc, None where there is another library of C."""
    try:
        name, _, version = (os.confstr("CS_GNU_LIBC_VERSION") or "").partition(" ")
    except (AttributeError, OSError, ValueError):
        return None
    return version if name == "glibc" else None


def siteFolder() -> str:
    """Return the folder that our package, its extension and its libraries are installed to."""
    spec = find_spec("openmmhelfrich._helfrich")
    return os.path.dirname(os.path.dirname(spec.origin)) if spec and spec.origin else os.path.dirname(PACKAGE)


def libraryFiles() -> list[str]:
    """Return the paths of our library and of the plugins."""
    suffix = ".dylib" if sys.platform == "darwin" else ".so"
    folder = os.path.join(siteFolder(), "OpenMM.libs", "lib")
    plugins = [os.path.join("plugins", f"libOpenMMHelfrich{platform}{suffix}") for platform in PLATFORMS]
    return [os.path.join(folder, name) for name in (f"libOpenMMHelfrich{suffix}", *plugins)]


def ownDistributions() -> "list[Distribution]":
    """Return what pip or conda wrote down of our installations in the folder of the package."""
    from importlib.metadata import distributions

    return list(distributions(name=NAME, path=[siteFolder()]))


def _numbers(version: str) -> tuple[int, ...]:
    return tuple(int(number) for number in re.findall(r"\d+", version)[:3])


def _openmmFaults() -> Iterator[Fault]:
    spec = find_spec("openmm")
    if spec is None:
        yield Fault(f"OpenMM is not installed for {sys.executable}", INSTALL_OPENMM)
        return
    places = list(spec.submodule_search_locations or [])
    if not places or not os.path.isfile(os.path.join(places[0], "version.py")):
        taken = places[0] if places else spec.origin
        yield Fault(f"{taken} is taken for OpenMM, and is none", f"give it another name, then {INSTALL_OPENMM}")
        return
    version = openmmVersion(places[0])
    if not OPENMM <= _numbers(version) < NO_OPENMM:
        yield Fault(
            f"OpenMM {version} is installed in {places[0]}, and this version of {NAME} needs 8.6", INSTALL_OPENMM
        )


def _condaPackages(name: str) -> list[str]:
    folder = os.path.join(sys.prefix, "conda-meta")
    files = os.listdir(folder) if os.path.isdir(folder) else []
    return [file for file in files if re.fullmatch(rf"{name}-\d[^-]*-[^-]*\.json", file)]


def _systemFaults() -> Iterator[Fault]:
    version = glibcVersion()
    if version is not None and _numbers(version) < GLIBC and not _condaPackages("openmm"):
        yield Fault(
            f"the glibc of this system is {version}, and OpenMM's wheels need 2.34 or newer",
            "a newer system or container (Debian 12, Ubuntu 22.04, RHEL 9 and what follows them)",
        )


def _condaFaults() -> Iterator[Fault]:
    isOpenMMs, isOurs = bool(_condaPackages("openmm")), bool(_condaPackages(NAME))
    if isOpenMMs and not isOurs:
        yield Fault(f"OpenMM is installed by conda and {NAME} by pip, which do not fit together", FRESH)
    if isOurs and not isOpenMMs:
        yield Fault(f"{NAME} is installed by conda and OpenMM by pip, which do not fit together", FRESH)


def _pathFaults(said: str) -> Iterator[Fault]:
    for variable in ("LD_LIBRARY_PATH", "DYLD_LIBRARY_PATH"):
        for folder in filter(None, os.environ.get(variable, "").split(os.pathsep)):
            own = [os.path.join(os.path.dirname(openmm), "OpenMM.libs", "lib") for openmm in openmmFolders()[:1]]
            names = os.listdir(folder) if os.path.isdir(folder) else []
            if any(name.startswith("libOpenMM.") for name in names) and os.path.realpath(folder) not in own:
                yield Fault(
                    f"{variable} has {folder}, whose libOpenMM comes before that of the installed OpenMM",
                    f"take this folder out of {variable}",
                )
    folders = openmmFolders()
    versions = [openmmVersion(folder) for folder in folders]
    if len(set(versions)) > 1 or (said and len(folders) > 1):
        both = " and ".join(f"{version} in {folder}" for folder, version in zip(folders, versions))
        yield Fault(f"there are two OpenMMs, {both}; the first is used", f"pip uninstall openmm in one; or {FRESH}")


def _numpyFaults(said: str) -> Iterator[Fault]:
    from importlib.metadata import PackageNotFoundError, version

    cure = "pip install 'numpy>=2'"
    try:
        found = version("numpy")
    except PackageNotFoundError:
        found = None
    if found is None:
        if find_spec("numpy") is None:
            yield Fault(f"NumPy is not installed for {sys.executable}", cure)
    elif _numbers(found) < NUMPY:
        yield Fault(f"NumPy {found} is installed, and {NAME} needs 2.0 or newer", cure)
    elif re.search(r"numpy.*multiarray|compiled (using|against).*(NumPy|ABI|API)", said, re.DOTALL):
        yield Fault(f"NumPy {found} cannot be loaded ({said.splitlines()[-1]})", "pip install --force-reinstall numpy")


def _fileFaults() -> Iterator[Fault]:
    for path in libraryFiles():
        if not os.path.isfile(path):
            yield Fault(f"{path} is missing", REINSTALL)
    folder = os.path.join(siteFolder(), "openmmhelfrich")
    extensions = [name for name in os.listdir(folder) if name.startswith("_helfrich.")]
    if not any("_helfrich" + suffix in extensions for suffix in EXTENSION_SUFFIXES):
        there = f"there is {', '.join(extensions)} only" if extensions else "there is none"
        version = ".".join(map(str, sys.version_info[:2]))
        yield Fault(f"{folder} has no extension for this Python {version}: {there}", FRESH)


def _recordFaults() -> Iterator[Fault]:
    found = ownDistributions()
    if len(found) > 1:
        versions = " and ".join(distribution.version for distribution in found)
        yield Fault(f"there are two versions of {NAME} in {siteFolder()}: {versions}", REINSTALL)
    elif found:
        for file in found[0].files or []:
            isLibrary = file.name.startswith(("libOpenMMHelfrich", "_helfrich."))
            if isLibrary and os.path.isfile(file.locate()) and not _isAsRecorded(file):
                yield Fault(f"{file.locate()} is not that of the installed {NAME} {found[0].version}", REINSTALL)


def _requirementFaults() -> Iterator[Fault]:
    from importlib.metadata import PackageNotFoundError, version

    for distribution in ownDistributions()[:1]:
        for requirement in distribution.requires or []:
            name, _, condition = (part.strip() for part in requirement.partition(";"))
            package = re.split(r"[^\w.-]", name)[0]
            try:
                if not condition:  # neither of an extra nor of some versions of Python
                    version(package)
            except PackageNotFoundError:
                yield Fault(f"{package} is not installed, and {NAME} needs it", f"pip install {NAME}")


def _isAsRecorded(file: "PackagePath") -> bool:
    from base64 import urlsafe_b64encode
    from hashlib import new

    if file.hash is None:
        return True
    with open(file.locate(), "rb") as stream:
        digest = new(file.hash.mode, stream.read()).digest()
    return urlsafe_b64encode(digest).decode().rstrip("=") == file.hash.value


def _loaderFaults(said: str) -> Iterator[Fault]:
    version = re.search(r"version [`'](GLIBC|GLIBCXX|CXXABI)_([\d.]+)' not found", said)
    broken = re.search(r"([^\s/]*\.so[\d.]*): (cannot open shared object file|file too short|invalid ELF header)", said)
    if version and version[1] == "GLIBC":
        yield Fault(
            f"a library needs glibc {version[2]}, and this system has {glibcVersion()}", "a newer system or container"
        )
    elif version:
        yield Fault(
            f"the libstdc++ that is loaded is too old: it has no {version[1]}_{version[2]} ({said})",
            "take other folders out of LD_LIBRARY_PATH; in an environment of conda: conda install 'libstdcxx>=12'",
        )
    elif broken and "OpenMM" in broken[1] and "Helfrich" not in broken[1]:
        yield Fault(f"a library of OpenMM cannot be loaded ({said})", "pip install --force-reinstall --no-deps openmm")
    elif broken and "elfrich" in broken[1]:
        yield Fault(f"{broken[1]} cannot be loaded: {broken[2]}", REINSTALL)
    elif broken:
        yield Fault(f"the system has no {broken[1]} ({said})", "install it by the package manager of the system")
    elif "undefined symbol" in said:
        yield Fault(f"a library is of another version than what it is used with ({said})", FRESH)
