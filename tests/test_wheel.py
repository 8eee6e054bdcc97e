"""What tools/check_wheel.py checks holds of what is installed, and it finds what does not."""

import json
import re
import shutil
import subprocess
import sys
import zipfile
from importlib.metadata import distribution
from pathlib import Path

import pytest

from conftest import ROOT

PACKAGE = distribution("openmm-helfrich")
CHECK = ROOT / "tools" / "check_wheel.py"
LIBRARY = "OpenMM.libs/lib/libOpenMMHelfrich.so"
PLUGIN = "OpenMM.libs/lib/plugins/libOpenMMHelfrichCPU.so"

pytestmark = [
    pytest.mark.skipif(
        json.loads(PACKAGE.read_text("direct_url.json") or "{}").get("dir_info", {}).get("editable", False),
        reason="an editable installation is laid out otherwise",
    ),
    pytest.mark.skipif(shutil.which("readelf") is None, reason="there is no readelf"),
]


@pytest.fixture
def files():
    """The files of the wheel that was installed, by their names."""
    records = [file for file in PACKAGE.files if file.parts[0] != ".." and "__pycache__" not in file.parts]
    return {str(file): Path(file.locate()).read_bytes() for file in records}


def check(folder, files):
    wheel = folder / "openmm_helfrich.whl"
    with zipfile.ZipFile(wheel, "w") as archive:
        for name, content in files.items():
            archive.writestr(name, content)
    return subprocess.run([sys.executable, CHECK, wheel], capture_output=True, text=True)


def test_the_installed_files_are_a_wheel_in_order(tmp_path, files):
    done = check(tmp_path, files)
    assert done.returncode == 0 and done.stdout == "wheels in order: 1\n", done.stdout + done.stderr


def bundleOpenMM(files):
    files["openmm_helfrich.libs/libOpenMM-1234.so"] = files[LIBRARY]


def noPlugin(files):
    del files[PLUGIN]


def noHeader(files):
    del files["OpenMM.libs/include/openmmhelfrich/MonteCarloMove.h"]


def strayFile(files):
    files["bin/tool"] = b""


def pathOfTheBuild(files):
    files[LIBRARY] += b"\0/tmp/build-1234/lib\0"


def otherRunPath(files):
    files[PLUGIN] = files[PLUGIN].replace(b"$ORIGIN:$ORIGIN/..\0", b"/where/it/was/made\0")


def otherNeed(files):
    files[LIBRARY] = files[LIBRARY].replace(b"libstdc++.so.6\0", b"libfftw3f.so.3\0")


def withoutOpenMM(files):
    files[LIBRARY] = files[LIBRARY].replace(b"\0libOpenMM.so\0", b"\0libm.so.6\0\0\0\0\0")


@pytest.mark.parametrize(
    "breakIt, said",
    [
        (bundleOpenMM, "its libraries are"),
        (noPlugin, "its libraries are"),
        (noHeader, "HybridMonteCarloIntegrator.h includes MonteCarloMove.h, which is missing"),
        (strayFile, "bin/tool belongs to none of the folders"),
        (pathOfTheBuild, f"{LIBRARY}: it has a path of the build, /tmp/build-1234/lib"),
        (otherRunPath, f"{PLUGIN}: the RUNPATH is ['/where/it/was/made'], and should be $ORIGIN:$ORIGIN/.."),
        (otherNeed, f"{LIBRARY}: it needs libfftw3f.so.3, which is neither OpenMM's nor every system's"),
        (withoutOpenMM, f"{LIBRARY}: libOpenMM.so is not among the libraries that it needs"),
    ],
)
def test_what_is_wrong_is_found(tmp_path, files, breakIt, said):
    breakIt(files)
    done = check(tmp_path, files)
    assert done.returncode == 1 and said in done.stdout, done.stdout + done.stderr


@pytest.mark.skipif(shutil.which("c++") is None, reason="there is no C++ compiler")
def test_a_program_of_users_is_compiled_and_runs(tmp_path):
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    (commands,) = re.findall(r"```sh\n(.*?)```", (ROOT / "docs/how-to/install.md").read_text(), re.DOTALL)
    done = subprocess.run(["bash", "-e", "-c", commands], cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    energies = re.findall(r"(?:Reference|CPU): E_B/8 pi kappa = (.*)", done.stdout)
    assert [float(energy) for energy in energies] == pytest.approx([1, 1], abs=0.01)
