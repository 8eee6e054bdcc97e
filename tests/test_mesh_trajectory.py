"""Mesh trajectories: what is written is what every reader reads, whatever happens to the writer."""

import random
import signal
import subprocess
import sys
import time

import h5py
import numpy as np
import openmm as mm
import pytest
from openmm import app

import openmmhelfrich as mh
from openmmhelfrich.io.vtkhdf import MeshTrajectoryWriter
from test_composition import createPair


def same(frame, other):
    return (
        frame.step == other.step
        and set(frame.data) == set(other.data)
        and np.array_equal(frame.mesh.vertices, other.mesh.vertices)
        and np.array_equal(frame.mesh.triangles, other.mesh.triangles)
        and all(np.array_equal(np.float32(frame.data[name]), np.float32(other.data[name])) for name in frame.data)
    )


def readWithVTK(file):
    """Return the step, points, triangles and data of each time step, in a shuffled order of reading."""
    vtk = pytest.importorskip("vtkmodules.vtkIOHDF")
    from vtkmodules.util.numpy_support import vtk_to_numpy
    from vtkmodules.vtkCommonExecutionModel import vtkStreamingDemandDrivenPipeline

    reader, times = vtk.vtkHDFReader(), vtkStreamingDemandDrivenPipeline.TIME_STEPS()
    reader.SetFileName(str(file))
    reader.UpdateInformation()
    information = reader.GetOutputInformation(0)
    # VTK tells no times if there is one step.
    steps = [information.Get(times, i) for i in range(information.Length(times))] or [0.0]
    found = {}
    for step in random.Random(1).sample(steps, len(steps)):
        reader.UpdateTimeStep(step)
        shape = reader.GetOutputDataObject(0)
        data = shape.GetPointData()
        found[step] = (
            vtk_to_numpy(shape.GetPoints().GetData()).copy(),
            vtk_to_numpy(shape.GetPolys().GetConnectivityArray()).reshape(-1, 3).copy(),
            {data.GetArrayName(i): vtk_to_numpy(data.GetArray(i)).copy() for i in range(data.GetNumberOfArrays())},
        )
    return [(step, *found[step]) for step in steps]


def testReadersAgree(frames, tmp_path):
    mh.writeMeshTrajectory(tmp_path / "a.vtkhdf", frames)
    trajectory = mh.readMeshTrajectory(tmp_path / "a.vtkhdf")
    assert (
        len(trajectory) == 6
        and list(trajectory.steps) == [frame.step for frame in frames]
        and trajectory.lengthUnit == "nm"
    )
    assert len({frame.mesh.triangles.tobytes() for frame in trajectory}) == 6, (
        "the connectivity should differ in every frame"
    )
    assert all(same(a, b) for a, b in zip(trajectory, frames, strict=True))
    assert same(trajectory[-1], frames[5]) and [frame.step for frame in trajectory[1:6:2]] == [10, 30, 50]
    for frame, (step, points, triangles, data) in zip(frames, readWithVTK(tmp_path / "a.vtkhdf"), strict=True):
        assert (
            step == frame.step
            and np.array_equal(points, frame.mesh.vertices)
            and np.array_equal(triangles, frame.mesh.triangles)
        )
        assert set(data) == {"MeanCurvature", "SmoothMeanCurvature", "Area"} and all(
            np.array_equal(data[name], np.float32(frame.data[name])) for name in data
        )


def testReadWithPyvista(frames, tmp_path):
    pyvista = pytest.importorskip("pyvista")
    mh.writeMeshTrajectory(tmp_path / "a.vtkhdf", frames)
    reader = pyvista.get_reader(tmp_path / "a.vtkhdf")
    for i in (4, 0):
        reader.reader.SetStep(i)
        shape = reader.read()
        assert shape.is_manifold and np.array_equal(shape.regular_faces, frames[i].mesh.triangles)
        assert shape.volume == pytest.approx(frames[i].mesh.volume, rel=1e-12)


def testFileOfAnotherProgram(frames, tmp_path):
    """VTK's own writer, which gives each step a part of its own and Offsets of its own."""
    vtk = pytest.importorskip("vtkmodules.vtkIOHDF")
    mh.writeMeshTrajectory(tmp_path / "a.vtkhdf", frames)
    reader, writer = vtk.vtkHDFReader(), vtk.vtkHDFWriter()
    reader.SetFileName(str(tmp_path / "a.vtkhdf"))
    writer.SetInputConnection(reader.GetOutputPort())
    writer.SetFileName(str(tmp_path / "b.vtkhdf"))
    writer.SetWriteAllTimeSteps(True)
    writer.Write()
    with h5py.File(tmp_path / "b.vtkhdf") as file:
        assert file["VTKHDF/NumberOfPoints"].shape == (6,)
    assert all(same(a, b) for a, b in zip(mh.readMeshTrajectory(tmp_path / "b.vtkhdf"), frames, strict=True))


def testSinglePrecision(frames, tmp_path):
    for precision in ("double", "single"):
        mh.writeMeshTrajectory(tmp_path / precision, frames, precision=precision, lengthUnit="um")
    single = mh.readMeshTrajectory(tmp_path / "single")
    assert np.array_equal(single[3].mesh.vertices, np.float32(frames[3].mesh.vertices)) and single.lengthUnit == "um"
    assert (tmp_path / "single").stat().st_size < (tmp_path / "double").stat().st_size
    with pytest.raises(ValueError, match="precision is 'half'; it must be 'double' or 'single'"):
        mh.writeMeshTrajectory(tmp_path / "half", frames, precision="half")


def testGoingOnFromAFrame(frames, tmp_path):
    """A file cut and continued holds the same as one written at once, and takes no more room."""
    mh.writeMeshTrajectory(tmp_path / "once", frames)
    mh.writeMeshTrajectory(tmp_path / "parts", frames[:4] + frames[:1])
    mh.writeMeshTrajectory(tmp_path / "parts", frames[4:], keep=4)
    assert all(same(a, b) for a, b in zip(mh.readMeshTrajectory(tmp_path / "parts"), frames, strict=True))
    assert [step for step, *_ in readWithVTK(tmp_path / "parts")] == [0, 10, 20, 30, 40, 50]
    assert (tmp_path / "parts").stat().st_size < 1.2 * (tmp_path / "once").stat().st_size


def testOnlyFramesOfOneKind(frames, tmp_path):
    mh.writeMeshTrajectory(tmp_path / "a", frames[:2])
    before = (tmp_path / "a").read_bytes()
    for other in (mh.meshFrame(20, mh.Mesh.icosphere(1)), frames[2]._replace(data={})):
        with pytest.raises(ValueError, match="the frame of step 20 has"):
            mh.writeMeshTrajectory(tmp_path / "a", [other], keep=2)
    with pytest.raises(ValueError, match="has 2 frames; it should have 3 or more"):
        mh.writeMeshTrajectory(tmp_path / "a", frames[2:], keep=3)
    with pytest.raises(ValueError, match="there are no frames to write"):
        mh.writeMeshTrajectory(tmp_path / "b", [])
    assert (tmp_path / "a").read_bytes() == before and [path.name for path in tmp_path.iterdir()] == ["a"]


# --- damaged files


def testNoSuchFrame(frames, tmp_path):
    mh.writeMeshTrajectory(tmp_path / "a.vtkhdf", frames)
    for index in (6, -7):
        with pytest.raises(IndexError, match=f"a.vtkhdf has no frame {index}; it has 6: 0 to 5"):
            mh.readMeshTrajectory(tmp_path / "a.vtkhdf")[index]


def testNotATrajectory(frames, tmp_path):
    (tmp_path / "text").write_text("not HDF5")
    with h5py.File(tmp_path / "other", "w") as out:
        out["x"] = [1, 2]
    with h5py.File(tmp_path / "image", "w") as out:
        out.create_group("VTKHDF").attrs["Type"] = np.bytes_(b"ImageData")
    mh.writeMeshTrajectory(tmp_path / "cut", frames)
    (tmp_path / "cut").write_bytes((tmp_path / "cut").read_bytes()[:-2000])
    for name, message in (
        ("text", "is not a VTKHDF file, or not a complete one"),
        ("cut", "not a complete one"),
        ("other", "it has no group VTKHDF"),
        ("image", "holds ImageData without time steps"),
    ):
        with pytest.raises(ValueError, match=message):
            mh.readMeshTrajectory(tmp_path / name)
    with pytest.raises(FileNotFoundError, match="there is no mesh trajectory"):
        mh.readMeshTrajectory(tmp_path / "nothing")


@pytest.mark.parametrize(
    "damage, message",
    [
        (
            lambda root: root["Polygons/Connectivity"].__setitem__(7, 5000),
            "damaged at frame 0: triangle 2 has the vertex 5000",
        ),
        (lambda root: root["Points"].__setitem__((3, 1), np.nan), "damaged at frame 0: the position of vertex 3"),
        (lambda root: root["Steps/PointOffsets"].__setitem__(0, 10**6), "damaged at frame 0"),
        (lambda root: root["Points"].resize(10, axis=0), "damaged at frame 0"),
        (lambda root: root["PointData"].__delitem__("Area"), "damaged at frame 0"),
        (lambda root: root["Polygons/Offsets"].__setitem__(4, 13), "cells that are not triangles"),
        (lambda root: root["Steps"].__delitem__("Values"), "is damaged"),
    ],
)
def testDamage(frames, tmp_path, damage, message):
    mh.writeMeshTrajectory(tmp_path / "a", frames)
    with h5py.File(tmp_path / "a", "a") as file:
        damage(file["VTKHDF"])
    with pytest.raises(ValueError, match=message):
        mh.readMeshTrajectory(tmp_path / "a")[0]


def testChangedBytesAreNoticed(frames, tmp_path):
    """The compressed arrays carry checksums."""
    mh.writeMeshTrajectory(tmp_path / "a", frames)
    with h5py.File(tmp_path / "a") as file:
        place = file["VTKHDF/Points"].id.get_chunk_info(2)
    content = bytearray((tmp_path / "a").read_bytes())
    content[place.byte_offset + place.size // 2] ^= 0x40
    (tmp_path / "a").write_bytes(content)
    trajectory = mh.readMeshTrajectory(tmp_path / "a")
    assert same(trajectory[1], frames[1])
    with pytest.raises(ValueError, match="damaged at frame 2"):
        trajectory[2]


# --- the writer, whatever happens to it

WRITER = """
import itertools, sys, numpy as np, openmmhelfrich as mh
from openmmhelfrich.io.vtkhdf import MeshTrajectoryWriter
mesh = mh.Mesh.icosphere(1)
writer = MeshTrajectoryWriter(sys.argv[1], numFrames=None)
for step in itertools.count(writer.numFrames):
    writer.add(mh.MeshFrame(step, mh.Mesh(mesh.vertices*(1+step), mesh.triangles), {"Step": np.full(42, step)}))
    writer.flush()
    print(step, flush=True)
"""


def testKilledAtAnyMoment(tmp_path):
    """After SIGKILL the file is complete: it has every frame that was flushed, each once, and the writer goes on from
    it.
    """
    generator, written = random.Random(3), 0
    for _ in range(5):
        process = subprocess.Popen([sys.executable, "-c", WRITER, tmp_path / "a"], stdout=subprocess.PIPE, text=True)
        assert int(process.stdout.readline()) == written
        time.sleep(generator.uniform(0, 0.1))
        process.send_signal(signal.SIGKILL)
        last = int((process.communicate()[0].split() or [written])[-1])
        trajectory = mh.readMeshTrajectory(tmp_path / "a")
        written = len(trajectory)
        assert written >= last + 1 and list(trajectory.steps) == list(range(written))
        for frame in (trajectory[0], trajectory[-1]):
            assert np.allclose(np.linalg.norm(frame.mesh.vertices, axis=1), 1 + frame.step) and np.all(
                frame.data["Step"] == frame.step
            )
        assert len(readWithVTK(tmp_path / "a")) == written
    assert written >= 5


FULL = """
import resource, signal, sys, openmmhelfrich as mh
from openmmhelfrich.io.vtkhdf import MeshTrajectoryWriter
frame = mh.meshFrame(0, mh.Mesh.icosphere(3))
writer = MeshTrajectoryWriter(sys.argv[1])
writer.add(frame)
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
limit = resource.getrlimit(resource.RLIMIT_FSIZE)
resource.setrlimit(resource.RLIMIT_FSIZE, (40000, limit[1]))
writer.add(frame)
try:
    writer.flush()
except OSError as error:
    print(error)
assert len(mh.readMeshTrajectory(sys.argv[1])) == 1
resource.setrlimit(resource.RLIMIT_FSIZE, limit)
writer.close()
"""


def testNoRoom(tmp_path):
    """Where a file cannot grow, flush() says so, the last complete file stays, and no frame is lost if there is room
    later.
    """
    done = subprocess.run([sys.executable, "-c", FULL, tmp_path / "a"], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert "a cannot be written" in done.stdout
    assert len(mh.readMeshTrajectory(tmp_path / "a")) == 2 and [path.name for path in tmp_path.iterdir()] == ["a"]


def testPlaceIsCheckedAtOnce(tmp_path):
    for place, kind in ((tmp_path / "nowhere" / "a", FileNotFoundError), (tmp_path, IsADirectoryError)):
        with pytest.raises(kind, match=str(tmp_path)):
            MeshTrajectoryWriter(place)


# --- the reporter


def simulate(sphere, seed=1, integrator=None):
    force = mh.HelfrichForce()
    force.setTriangles(sphere.triangles)
    force.setBendingModulus(30)
    force.setTether(1e4, 0.2, 0.5, 2)
    system = sphere.createSystem()
    system.addForce(force)
    if integrator is None:
        integrator = mh.HybridMonteCarloIntegrator(300, 1e-3, 10)
        integrator.setRandomNumberSeed(seed)
    simulation = app.Simulation(sphere.topology(), system, integrator, mm.Platform.getPlatform("Reference"))
    simulation.context.setPositions(sphere.vertices)
    return simulation, force


def testReporterWritesTheLiveMesh(sphere, tmp_path):
    simulation, force = simulate(sphere)
    simulation.reporters.append(mh.MeshReporter(tmp_path / "a.vtkhdf", 5, force))
    for step in (5, 10, 15):
        simulation.step(5)
        simulation.reporters[0].flush()
        frame = mh.readMeshTrajectory(tmp_path / "a.vtkhdf")[-1]
        positions = simulation.context.getState(positions=True).getPositions(asNumpy=True)
        assert frame.step == step and np.array_equal(frame.mesh.vertices, positions._value)
        assert np.array_equal(frame.mesh.triangles, force.getTrianglesInContext(simulation.context))
        assert frame.data["Area"] == pytest.approx(frame.mesh.vertexAreas, rel=1e-6)
        assert frame.data["MeanCurvature"] == pytest.approx(
            frame.mesh.vertexMeanCurvatures / frame.mesh.vertexAreas, rel=1e-5
        )
    assert simulation.reporters[0].getNumFrames() == 3 and not np.array_equal(frame.mesh.edges, sphere.edges)


def testReporterGoesOnFromACheckpoint(sphere, tmp_path):
    """Frames beyond a checkpoint are dropped and made again: none is missing, none is there twice."""
    simulation, force = simulate(sphere)
    reporter = mh.MeshReporter(tmp_path / "a", 5, force)
    simulation.reporters.append(reporter)
    simulation.step(20)
    reporter.flush()
    count = reporter.getNumFrames()
    simulation.saveCheckpoint(str(tmp_path / "checkpoint"))
    simulation.step(20)
    reporter.close()
    once = mh.readMeshTrajectory(tmp_path / "a")[:]

    simulation, force = simulate(sphere, seed=2)
    simulation.loadCheckpoint(str(tmp_path / "checkpoint"))
    reporter = mh.MeshReporter(tmp_path / "a", 5, force, append=True, numFrames=count)
    assert reporter.getNumFrames() == 4
    simulation.reporters.append(reporter)
    simulation.step(20)
    reporter.close()
    again = mh.readMeshTrajectory(tmp_path / "a")
    assert list(again.steps) == [5, 10, 15, 20, 25, 30, 35, 40] and all(
        same(a, b) for a, b in zip(again, once, strict=True)
    )


def testCutWithoutNewFrames(sphere, tmp_path, frames):
    mh.writeMeshTrajectory(tmp_path / "a", frames)
    simulation, force = simulate(sphere)
    mh.MeshReporter(tmp_path / "a", 5, force, append=True, numFrames=2).close()
    assert list(mh.readMeshTrajectory(tmp_path / "a").steps) == [0, 10]


def testReporterOfOneMembraneAmongOthers(tmp_path):
    """Other particles and other membranes are left out, and the vertices numbered without gaps."""
    meshes, forces, context = createPair("Reference")

    class Simulation:
        currentStep = 7

    Simulation.context = context
    state = context.getState(positions=True)
    for force, mesh, name in zip(forces, meshes, "ab"):
        reporter = mh.MeshReporter(tmp_path / name, 1, force)
        reporter.report(Simulation, state)
        reporter.close()
        frame = mh.readMeshTrajectory(tmp_path / name)[0]
        assert np.array_equal(frame.mesh.triangles, mesh.triangles)
        assert frame.mesh.vertices - [5 * (name == "b"), 0, 0] == pytest.approx(mesh.vertices, abs=1e-12)
        assert frame.data["Area"] == pytest.approx(mesh.vertexAreas, rel=1e-6)


SCRIPT = """
import openmm as mm, openmmhelfrich as mh, test_mesh_trajectory as t
simulation, force = t.simulate(mh.Mesh.icosphere(2))
simulation.reporters.append(mh.MeshReporter("end.vtkhdf", 2, force))
simulation.step(6)
"""


def testScriptThatJustEnds(inFolder, examples):
    script = f"import sys; sys.path.insert(0, {str(examples.parent / 'tests')!r})\n{SCRIPT}"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    assert done.returncode == 0 and done.stderr == ""
    assert list(mh.readMeshTrajectory("end.vtkhdf").steps) == [2, 4, 6]


def testReporterRefuses(sphere, tmp_path, frames):
    simulation, force = simulate(sphere)
    mh.writeMeshTrajectory(tmp_path / "a", frames)
    mh.writeMeshTrajectory(tmp_path / "small", [mh.meshFrame(0, mh.Mesh.icosphere(1))])
    (tmp_path / "torn").write_bytes((tmp_path / "a").read_bytes()[:5000])
    for arguments, message in (
        ({"file": "a", "append": True, "numFrames": 9}, "has 6 frames; it should have 9 or more"),
        (
            {"file": "small", "append": True},
            "has frames of 42 vertices and 80 triangles; this membrane has 162 and 320",
        ),
        ({"file": "torn", "append": True}, "not a complete one"),
        ({"file": "a", "numFrames": 3}, "numFrames is for appending"),
        ({"file": "a", "reportInterval": 0}, "reportInterval is 0"),
    ):
        arguments = {"reportInterval": 5, **arguments}
        with pytest.raises(ValueError, match=message):
            mh.MeshReporter(tmp_path / arguments.pop("file"), arguments.pop("reportInterval"), force, **arguments)
    assert all(same(a, b) for a, b in zip(mh.readMeshTrajectory(tmp_path / "a"), frames, strict=True)), (
        "nothing should have been lost"
    )
