"""What is wrong with an installation is named with its cure, by the command and where the package is imported."""

import os
import re
import shutil
import subprocess
import sys
from importlib import import_module
from importlib.metadata import requires
from pathlib import Path

import pytest

from conftest import ROOT
from openmmhelfrich import installation
from openmmhelfrich.installation import InstallationError, explained, explainLoading, findFaults

FOREIGN = "_helfrich.cpython-39-x86_64-linux-gnu.so"


@pytest.fixture
def site(tmp_path):
    """A folder of packages with links to those that are installed, in which a test may break something."""
    real, folder = Path(installation.siteFolder()), tmp_path / "site"
    folder.mkdir()
    for entry in real.iterdir():
        if entry.name not in ("openmmhelfrich", "OpenMM.libs", "__pycache__") and entry.suffix != ".pth":
            (folder / entry.name).symlink_to(entry)
    shutil.copytree(real / "OpenMM.libs", folder / "OpenMM.libs", copy_function=os.symlink)
    (folder / "openmmhelfrich").mkdir()
    extension = [real / "openmmhelfrich" / "helfrich.py", *(real / "openmmhelfrich").glob("_helfrich.*")]
    for entry in [*Path(installation.PACKAGE).iterdir(), *extension]:
        link = folder / "openmmhelfrich" / entry.name
        if not link.exists():
            link.symlink_to(entry)
    return folder


def execute(site, *arguments, **environment):
    """Run Python with the packages of a folder only."""
    path = os.pathsep.join(filter(None, [environment.pop("before", None), str(site)]))
    return subprocess.run(
        [sys.executable, "-S", *arguments],
        cwd=site.parent,
        env={**os.environ, "PYTHONPATH": path, "PYTHONDONTWRITEBYTECODE": "1", **environment},
        capture_output=True,
        text=True,
    )


def check(site, **environment):
    return execute(site, "-m", "openmmhelfrich.cli", "info", "--check", **environment)


def replace(path, content):
    path.unlink()
    path.write_bytes(content)


def noOpenMM(site):
    (site / "openmm").unlink()


def otherOpenMM(site):
    noOpenMM(site)
    (site / "openmm").mkdir()
    (site / "openmm" / "__init__.py").touch()
    (site / "openmm" / "version.py").write_text("short_version = '8.5.2'\n")


def otherModule(site):
    noOpenMM(site)
    (site / "openmm.py").touch()


def noPlugin(site):
    (site / "OpenMM.libs/lib/plugins/libOpenMMHelfrichCPU.so").unlink()


def tornPlugin(site):
    replace(site / "OpenMM.libs/lib/plugins/libOpenMMHelfrichCPU.so", b"\x7fELF")


def tornPluginWithoutRecord(site):
    tornPlugin(site)
    for record in site.glob("openmm_helfrich-*"):
        record.unlink()


def otherLibrary(site):
    library = site / "OpenMM.libs/lib/libOpenMMHelfrich.so"
    replace(library, library.read_bytes() + b"\0")


def noMainLibrary(site):
    (site / "openmm").unlink()
    shutil.copytree(Path(installation.openmmFolders()[0]), site / "openmm")
    (site / "OpenMM.libs/lib/libOpenMM.so").unlink()


def otherPython(site):
    (extension,) = (site / "openmmhelfrich").glob("_helfrich.*")
    extension.rename(extension.with_name(FOREIGN))


def oldNumPy(site):
    for record in site.glob("numpy-*.dist-info"):
        record.unlink()
    (site / "numpy-1.26.4.dist-info").mkdir()
    (site / "numpy-1.26.4.dist-info" / "METADATA").write_text("Metadata-Version: 2.1\nName: numpy\nVersion: 1.26.4\n")


def noNumPy(site):
    for entry in site.glob("numpy*"):
        entry.unlink()


def noMeshio(site):
    for entry in site.glob("meshio*"):
        entry.unlink()


def twoVersions(site):
    (site / "openmm_helfrich-0.0.9.dist-info").mkdir()
    record = "Metadata-Version: 2.1\nName: openmm-helfrich\nVersion: 0.0.9\n"
    (site / "openmm_helfrich-0.0.9.dist-info" / "METADATA").write_text(record)


def crash(site):
    version = (Path(installation.openmmFolders()[0]) / "version.py").read_text()
    noOpenMM(site)
    (site / "openmm").mkdir()
    (site / "openmm" / "version.py").write_text(version)
    (site / "openmm" / "__init__.py").write_text("import os\nos.abort()\n")


# What is broken, what is then said, and what cures it; whether a script is told when it imports the package.
CASES = [
    (noOpenMM, "OpenMM is not installed for .*", "pip install 'openmm>=8.6,<8.7'", True),
    (otherOpenMM, r"OpenMM 8.5.2 is installed in .*, and this version .* needs 8.6", "pip install 'openmm>=8.6", True),
    (otherModule, r".*openmm.py is taken for OpenMM, and is none", "give it another name", True),
    (noPlugin, ".*libOpenMMHelfrichCPU.so is missing", "pip install --force-reinstall --no-deps openmm-helfrich", True),
    (otherPython, f"has no extension for this Python .*: there is {FOREIGN} only", "make a new environment", True),
    (tornPlugin, r".*libOpenMMHelfrichCPU.so is not that of the installed openmm-helfrich", "--force-reinstall", True),
    (tornPluginWithoutRecord, "libOpenMMHelfrichCPU.so cannot be loaded: file too short", "--force-reinstall", True),
    (otherLibrary, r".*libOpenMMHelfrich.so is not that of the installed openmm-helfrich", "--force-reinstall", False),
    (noMainLibrary, "a library of OpenMM cannot be loaded .*libOpenMM.so", "--no-deps openmm$", True),
    (oldNumPy, "NumPy 1.26.4 is installed, and openmm-helfrich needs 2.0 or newer", "pip install 'numpy>=2'", False),
    (noNumPy, "NumPy is not installed for .*", "pip install 'numpy>=2'", True),
    (noMeshio, "meshio is not installed, and openmm-helfrich needs it", "pip install openmm-helfrich", False),
    (twoVersions, "there are two versions of openmm-helfrich in .*: 0", "--force-reinstall", False),
    (crash, "OpenMM cannot be loaded: the process ends with SIGABRT", "--force-reinstall", False),
]


@pytest.mark.parametrize("breakIt, what, cure, isImported", CASES, ids=lambda value: getattr(value, "__name__", ""))
def test_a_fault_is_named_with_its_cure(site, breakIt, what, cure, isImported):
    breakIt(site)
    done = check(site)
    assert done.returncode == 1 and "Traceback" not in done.stdout + done.stderr, done.stderr
    assert re.search(f"{what}", done.stdout) and re.search(f"cure: .*{cure}", done.stdout, re.MULTILINE), done.stdout
    if isImported:
        done = execute(site, "-c", "import openmmhelfrich as mh; mh.HelfrichForce")
        *_, last = done.stderr.splitlines()
        assert last.startswith("openmmhelfrich.installation.InstallationError: ") and "Cure: " in last
        assert "ImportError" not in done.stderr.replace("openmmhelfrich.installation.", "")


def test_the_command_says_it_in_a_line(site):
    noOpenMM(site)
    (site.parent / "run.toml").write_text("[mesh]\nicosphere = 1\n")
    done = execute(site, "-m", "openmmhelfrich.cli", "run", "run.toml")
    assert done.returncode == 1
    assert re.fullmatch(r"openmm-helfrich: OpenMM is not installed for .*\. Cure: pip install .*\n", done.stderr)


def test_an_installation_in_order(site, tmp_path):
    for environment in ({}, {"OPENMM_PLUGIN_DIR": str(tmp_path)}):
        done = check(site, **environment)
        assert done.returncode == 0, done.stdout + done.stderr
        assert "is installed as it should be" in done.stdout


def test_a_library_that_comes_first(site, tmp_path):
    (tmp_path / "libOpenMM.so").touch()
    done = check(site, LD_LIBRARY_PATH=f"/nowhere:{tmp_path}")
    assert done.returncode == 1
    assert f"LD_LIBRARY_PATH has {tmp_path}, whose libOpenMM comes before" in done.stdout


def test_two_openmms(site, tmp_path):
    (tmp_path / "after").mkdir()
    (tmp_path / "after" / "openmm").mkdir()
    (tmp_path / "after" / "openmm" / "version.py").write_text("short_version = '8.4.0'\n")
    done = check(site, before=f"{site}{os.pathsep}{tmp_path / 'after'}")
    assert done.returncode == 1
    assert re.search(r"there are two OpenMMs, 8\.6.* in .*site/openmm and 8\.4\.0 in .*after/openmm", done.stdout)


def test_a_wrong_instruction_set(site):
    done = check(site, OPENMM_HELFRICH_SIMD="AVX3")
    assert done.returncode == 1
    assert re.search("OPENMM_HELFRICH_SIMD is 'AVX3'; .* support Baseline.*\n  cure: unset OPENMM_", done.stdout)


def test_what_reports_of_problems_need(site):
    done = execute(site, "-m", "openmmhelfrich.cli", "info", OPENMM_CPU_THREADS="3")
    assert done.returncode == 0, done.stderr
    shown = dict(line.strip().split("  ", 1) for line in done.stdout.splitlines())
    assert {"openmm-helfrich", "OpenMM", "NumPy", "Python", "system", "processor"} < set(shown)
    assert shown["instruction set"] in ("Baseline", "AVX2", "AVX512")
    assert shown["platforms"].startswith("Reference, CPU") and shown["threads"] == "3 by default"
    assert shown["OPENMM_CPU_THREADS"] == "3" and "pyvista" in shown["extra looking"]


def test_what_is_broken_is_described_too(site):
    noOpenMM(site)
    done = execute(site, "-m", "openmmhelfrich.cli", "info")
    assert done.returncode == 0, done.stderr
    assert "OpenMM  not installed" in done.stdout and "loading OpenMM: No module named 'openmm'" in done.stdout


def faults(said=""):
    return "\n".join(map(str, findFaults(said)))


def test_nothing_is_wrong_here():
    assert faults() == ""


@pytest.mark.parametrize(
    "packages, what",
    [
        (["openmm-8.6.1-py311h1_0"], "OpenMM is installed by conda and openmm-helfrich by pip"),
        (["openmm-helfrich-0.2.0-py311h1_0"], "openmm-helfrich is installed by conda and OpenMM by pip"),
        (["openmm-8.6.1-py311h1_0", "openmm-helfrich-0.2.0-py311h1_0"], ""),
        (["openmm-ml-1.2-py_0"], ""),
    ],
)
def test_conda_mixed_with_pip(tmp_path, monkeypatch, packages, what):
    (tmp_path / "conda-meta").mkdir()
    for package in packages:
        (tmp_path / "conda-meta" / f"{package}.json").touch()
    monkeypatch.setattr(sys, "prefix", str(tmp_path))
    assert what in faults() and (what != "") == (faults() != "")


@pytest.mark.parametrize("version, isOld", [("2.31", True), ("2.33.1", True), ("2.34", False), ("2.40", False)])
def test_an_old_glibc(monkeypatch, version, isOld):
    monkeypatch.setattr(os, "confstr", lambda name: f"glibc {version}")
    assert (f"the glibc of this system is {version}, and OpenMM's wheels need 2.34" in faults()) == isOld


@pytest.mark.parametrize(
    "said, what",
    [
        ("/lib/libm.so.6: version `GLIBC_2.38' not found (required by x.so)", "a library needs glibc 2.38"),
        (
            "/conda/libstdc++.so.6: version `GLIBCXX_3.4.29' not found (required by x.so)",
            r"libstdc\+\+ .* no GLIBCXX_3.4.29",
        ),
        ("x.so: undefined symbol: _ZN6OpenMM5ForceE", "a library is of another version"),
        ("libOpenMM.so: cannot open shared object file: No such file", "a library of OpenMM cannot be loaded"),
        ("libz.so.1: cannot open shared object file: No such file", "the system has no libz.so.1"),
        ("numpy.core.multiarray failed to import", "NumPy .* cannot be loaded"),
        ("A module that was compiled using NumPy 1.x cannot be run in\nNumPy 2.1", "NumPy .* cannot be loaded"),
        ("something else", "the libraries of openmm-helfrich cannot be loaded: something else"),
    ],
)
def test_what_loaders_say(said, what):
    sentence = explainLoading(said)
    assert re.search(what, sentence) and ". Cure: " in sentence


def test_errors_of_other_packages_are_theirs():
    with pytest.raises(ModuleNotFoundError, match="No module named 'nowhere'"), explained():
        import_module("nowhere")
    with pytest.raises(ImportError, match=r"^libblas\.so") as raised, explained():
        raise ImportError(
            "libblas.so.3: cannot open shared object file", name="_fblas", path="/site/scipy/linalg/_fblas.so"
        )
    assert not isinstance(raised.value, InstallationError)
    with pytest.raises(InstallationError, match="undefined symbol"), explained():
        raise ImportError("_helfrich.so: undefined symbol: x", name="openmmhelfrich._helfrich")


def test_versions_are_those_of_the_metadata():
    needed = dict(re.fullmatch(r"([\w-]+)([^;]*)(;.*)?", line).groups()[:2] for line in requires("openmm-helfrich"))

    def text(numbers):
        return ".".join(map(str, numbers))

    assert set(needed["openmm"].split(",")) == {f">={text(installation.OPENMM)}", f"<{text(installation.NO_OPENMM)}"}
    assert "find_package(OpenMM 8.6...<8.7 REQUIRED)" in (ROOT / "CMakeLists.txt").read_text()
    assert needed["numpy"] == f">={text(installation.NUMPY)}"
    assert f"pip install 'openmm>={text(installation.OPENMM)},<8.7'" == installation.INSTALL_OPENMM


def test_the_version_is_the_same_everywhere():
    version = re.search(r'^version = "(.*)"$', (ROOT / "pyproject.toml").read_text(), re.MULTILINE)[1]
    assert f"## [{version}]" in (ROOT / "CHANGELOG.md").read_text()
    assert f"\nversion: {version}\n" in (ROOT / "CITATION.cff").read_text()
    assert f'version: "{version}"' in (ROOT / "recipe" / "recipe.yaml").read_text()
