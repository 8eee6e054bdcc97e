import os
import pty
import re
import subprocess
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

import openmmhelfrich as mh
from openmmhelfrich.cli import app
from openmmhelfrich.runs.config import Config, sections
from openmmhelfrich.runs.sections import SpeciesSection
from openmmhelfrich.runs.stagesettings import STAGES

OUTPUTS = [
    "run.checkpoint",
    "run.csv",
    "run.dcd",
    "run.ply",
    "run.psf",
    "run.resolved.toml",
    "run.vtkhdf",
    "run_observables.png",
    "run_shape.png",
]


def invoke(*arguments):
    return CliRunner().invoke(app, list(map(str, arguments)))


@pytest.fixture
def folder(inFolder):
    """A working folder with a mesh and a configuration of a short run."""
    mh.Mesh.icosphere(2).write("sphere.ply")
    configure()
    return inFolder


def configure(mesh='file = "sphere.ply"', sampling="steps = 10\nseed = 1", other=""):
    with open("run.toml", "w") as file:
        file.write(f"[mesh]\n{mesh}\n[sampling]\n{sampling}\n{other}\n")


def results():
    return sorted(set(os.listdir()) - {"sphere.ply", "run.toml"})


def testRun(folder):
    result = invoke("run", "run.toml")
    assert result.exit_code == 0, result.output
    assert results() == OUTPUTS
    words = ("162 vertices", "10 steps in", "area", "volume", "accepted", "E_B/8 pi kappa", "run.dcd", "step 10 of 10")
    for word in words:
        assert word in result.output


def testTheCommandIsInstalled(folder):
    command = os.path.join(os.path.dirname(sys.executable), "openmm-helfrich")
    done = subprocess.run(
        [command, "run", "run.toml", "--quiet", "--output", "deep/folder/a"], capture_output=True, text=True
    )
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
    assert len(os.listdir("deep/folder")) == len(OUTPUTS)
    failed = subprocess.run([command, "run", "nothing.toml"], capture_output=True, text=True)
    assert (failed.returncode, failed.stdout, failed.stderr) == (
        1,
        "",
        "openmm-helfrich: there is no configuration file nothing.toml\n",
    )


def testOptionsTakeThePlaceOfTheConfiguration(folder):
    result = invoke("run", "run.toml", "--platform", "Reference", "--seed", 7, "--steps", 4, "--output", "other")
    assert result.exit_code == 0 and "4 steps in" in result.output and "seed 7" in result.output
    assert mh.readObservables("other.csv")["step"][-1] == 4


STAGES_OF_TWO = """
[[stages]]
name = "warm"
kind = "sample"
steps = 6
[[stages]]
kind = "anneal"
steps = 4
end_temperature = 30
"""


def testStagesAndTheirProgress(folder):
    configure(sampling="seed = 1", other=STAGES_OF_TWO)
    result = invoke("run", "run.toml")
    assert result.exit_code == 0, result.output
    for stage in ("1/2 warm: step 6 of 6", "2/2 anneal: step 4 of 4"):
        assert re.search(stage + r", .*steps/s, energy \d+ kT, accepted \d+%, flips \d+%", result.output)
    result = invoke("run", "run.toml", "--steps", 3, "--output", "b")
    assert result.exit_code == 1 and "stages have steps of their own" in result.output


def testBarsOnATerminal(folder):
    configure(sampling="seed = 1", other=STAGES_OF_TWO)
    shown = []

    def read(terminal):
        shown.append(os.read(terminal, 4096))
        return shown[-1]

    pty.spawn(
        [
            sys.executable,
            "-c",
            "import os; os.environ.update(TERM='xterm', COLUMNS='150'); import openmmhelfrich.cli as c; c.app(['run', "
            "'run.toml'])",
        ],
        read,
    )
    text = b"".join(shown).decode()
    for word in ("1/2 warm", "6/6", "2/2 anneal", "4/4", "\u2501", "steps/s", "kT", "accepted", "162 vertices"):
        assert word in text


def testResume(folder):
    assert invoke("run", "run.toml", "-q").exit_code == 0
    result = invoke("resume", "run")
    assert (
        result.exit_code == 1
        and "openmm-helfrich: the run run is complete, at step 10; ask for more steps to go on" in result.output
    )
    result = invoke("resume", "run", "--steps", 5)
    assert result.exit_code == 0 and "15 steps, of which 5 steps in" in result.output
    result = invoke("resume", "another")
    assert result.exit_code == 1 and "there is no checkpoint another.checkpoint" in result.output
    assert invoke("resume", "run", "--steps", 0).exit_code == 2


def testConfig(folder):
    result = invoke("config")
    assert (
        result.exit_code == 0
        and "bending_modulus = 20.0" in result.output
        and "kappa_B in kT; 20 is typical" in result.output
    )
    result = invoke("config", "--from-trimem", "no.inp")
    assert result.exit_code == 1 and "there is no configuration file no.inp" in result.output


def testVersion():
    result = invoke("--version")
    assert result.exit_code == 0 and mh.__version__ in result.output


def testMeshIsRelativeToTheConfiguration(folder):
    os.mkdir("elsewhere")
    os.chdir("elsewhere")
    assert invoke("run", "../run.toml", "-q").exit_code == 0
    assert sorted(os.listdir()) == OUTPUTS


@pytest.mark.parametrize(
    "text, message",
    [
        (
            {"other": "[membrane]\nbending_modulos = 3"},
            "[membrane] has no key 'bending_modulos'; did you mean 'bending_modulus'?",
        ),
        ({"other": "[membrane]\nsteps = 3"}, "[membrane] has no key 'steps'; it belongs in [sampling]"),
        (
            {"other": "[membrain]\nbending_modulus = 3"},
            "there is no section or key 'membrain'; did you mean 'membrane'?",
        ),
        ({"other": "[output]\nxyzzy = 3"}, "[output] has no key 'xyzzy'; it has prefix, trajectory_interval"),
        ({"mesh": ""}, "[mesh] file is missing"),
        ({"other": "[membrane]\nbending_modulus = -3"}, "[membrane] bending_modulus is -3"),
        ({"other": '[membrane]\nbending_modulus = "20"'}, "[membrane] bending_modulus is '20'; it must be a number"),
        ({"other": "[membrane]\narea_modulus = nan"}, "[membrane] area_modulus is nan; it must be a finite number"),
        ({"other": "[membrane]\ntarget_volume = 0"}, "[membrane] target_volume is 0"),
        (
            {"other": "[membrane]\ntarget_volume = 1\nreduced_volume = 0.9"},
            "target_volume and reduced_volume are both given",
        ),
        ({"other": "[membrane]\nreduced_volume = 1.1"}, "[membrane] reduced_volume is 1.1"),
        ({"other": "[tether]\nmin_length = 0.3\nmax_length = 0.2"}, "[tether] min_length is 0.3 and max_length 0.2"),
        ({"other": "[repulsion]\nexclusion_level = 3"}, "[repulsion] exclusion_level is 3; it must be 0, 1 or 2"),
        ({"sampling": "steps = 0"}, "[sampling] steps is 0"),
        ({"sampling": "steps = 1.5"}, "[sampling] steps is 1.5"),
        ({"sampling": "temperature = 0"}, "[sampling] temperature is 0"),
        ({"sampling": "flip_probability = 1.5"}, "[sampling] flip_probability is 1.5"),
        ({"sampling": "steps = = 3"}, "run.toml is not TOML"),
        ({"mesh": 'file = "nothing.stl"'}, "there is no mesh file nothing.stl"),
        ({"mesh": 'file = "run.toml"'}, "no mesh format has the suffix '.toml'"),
        ({"mesh": 'file = "sphere.ply"\nlength_unit = "two words"'}, "[mesh] length_unit is 'two words'"),
        ({"other": '[platform]\nname = "GPU"'}, "[platform] name is 'GPU'; it must be one of Reference, CPU"),
        (
            {"other": '[platform]\nname = "Reference"\nthreads = 2'},
            "[platform] threads is 2; only the CPU platform has threads",
        ),
    ],
)
def testBadConfiguration(folder, text, message):
    configure(**text)
    result = invoke("run", "run.toml")
    assert result.exit_code == 1
    assert message in result.output and "Traceback" not in result.output
    assert results() == []


def testEveryMistakeIsReported(folder):
    configure(other="[membrane]\na = 1\nbending_modulus = -1\n[output]\nb = 1")
    assert len(invoke("run", "run.toml").output.splitlines()) == 3


def testBadMesh(folder):
    sphere = mh.Mesh.icosphere(2)
    mh.Mesh(sphere.vertices, sphere.triangles[:, ::-1]).write("sphere.ply")
    result = invoke("run", "run.toml")
    assert (
        result.exit_code == 1
        and "sphere.ply: the membrane of vertex 0 is inside out" in result.output
        and results() == []
    )


@pytest.mark.parametrize("existing", OUTPUTS)
def testNothingIsOverwritten(folder, existing):
    with open(existing, "w") as file:
        file.write("precious")
    result = invoke("run", "run.toml")
    assert result.exit_code == 1 and f"{existing} exists already" in result.output
    assert results() == [existing] and Path(existing).read_text() == "precious"


def testOverwriteWhenAsked(folder):
    assert invoke("run", "run.toml", "-q").exit_code == 0
    assert invoke("run", "run.toml", "-q").exit_code == 1
    assert invoke("run", "run.toml", "-q", "--overwrite", "--steps", 5).exit_code == 0
    assert mh.readObservables("run.csv")["step"][-1] == 5
    configure(other="[output]\noverwrite = true")
    assert invoke("run", "run.toml", "-q").exit_code == 0


def testFolderIsNeverOverwritten(folder):
    os.mkdir("run.csv")
    assert "run.csv exists already" in invoke("run", "run.toml", "--overwrite").output and results() == ["run.csv"]


def testTheMeshThatIsReadIsNeverOverwritten(folder):
    before = Path("sphere.ply").read_bytes()
    result = invoke("run", "run.toml", "--output", "sphere", "--overwrite")
    assert result.exit_code == 1 and "would replace the mesh file" in result.output
    assert Path("sphere.ply").read_bytes() == before


def testPlaceThatTakesNoFiles(folder):
    open("file", "w").close()
    result = invoke("run", "run.toml", "--output", "file/a")
    assert result.exit_code == 1 and "file is not a folder" in result.output
    result = invoke("run", "run.toml", "--output", "folder/")
    assert result.exit_code == 1 and "prefix is 'folder/'" in result.output
    if os.path.isdir("/proc/self"):  # where not even the superuser makes files
        result = invoke("run", "run.toml", "--output", "/proc/a")
        assert result.exit_code == 1 and "/proc is not writable" in result.output
    os.mkdir("closed", 0o500)
    if not os.access("closed", os.W_OK):  # the superuser may write anywhere
        result = invoke("run", "run.toml", "--output", "closed/a")
        assert result.exit_code == 1 and "closed is not writable" in result.output
    assert results() == ["closed", "file"]


def testEveryKeyIsDescribed():
    for name, model in (sections() | STAGES | {"species": SpeciesSection}).items():
        assert model.__doc__, name
        assert all(field.description for field in model.model_fields.values()), name
    assert [*sections(), "species", "stages"] == list(Config.model_fields)
