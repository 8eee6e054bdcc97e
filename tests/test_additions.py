"""A user's own forces, beads and fixed vertices in runs."""

import copy

import mdtraj
import numpy as np
import openmm as mm
import pytest

import openmmhelfrich as mh
from openmmhelfrich.io.conversion import convert
from openmmhelfrich.runs.additions import requireFinite
from openmmhelfrich.sampling.marks import displacement, markedPositions

KT = 0.00831446261815324 * 300
POLES = [[-2, -2, 0.8], [2, 2, 2]]


def configuration(tmp_path, **more):
    sampling = {"seed": 5, "steps_per_trajectory": 20} | more.pop("sampling", {})
    output = {"prefix": str(tmp_path / "run"), "trajectory_interval": 5, "observables_interval": 1}
    return {"mesh": {"icosphere": 2}, "sampling": sampling, "output": output, **more}


def tie(system, scene):
    """Tie a bead outside to the vertex that it is nearest to, and another to nothing but a place."""
    beads = [system.addParticle(3.0) for _ in range(2)]
    bond, well = mm.HarmonicBondForce(), mm.CustomExternalForce("50*((x-2)^2+y^2+z^2)")
    bond.addBond(0, beads[0], 0.3, 100.0)
    well.addParticle(beads[1])
    system.addForce(bond)
    system.addForce(well)
    return np.array([1.3 * scene.mesh.vertices[0], [2.0, 0.0, 0.0]])


def pull(file, vertices=(0,), energy="-20*x"):
    """Write the XML of a force that pulls vertices along x, or has another energy, and return it."""
    force = mm.CustomExternalForce(energy)
    for vertex in vertices:
        force.addParticle(vertex)
    file.write_text(mm.XmlSerializer.serialize(force))
    return force


def test_beads_are_sampled_with_the_membrane(tmp_path):
    """A bead in a harmonic well has the energy 3/2 kT on average, in all that is written."""
    result = mh.run(configuration(tmp_path, sampling={"steps": 600, "step_size": 0.0015}), setup=tie)
    assert any("2 beads, HarmonicBondForce, CustomExternalForce" in note for note in result.notes)
    frames = mh.readMeshTrajectory(tmp_path / "run.vtkhdf")
    beads = np.array([frame.mesh.beads for frame in frames])
    assert beads.shape == (120, 2, 3) and len(frames[0].mesh.vertices) == len(frames[0].data["Area"]) == 162
    wells = 50 * ((beads[10:, 1] - [2, 0, 0]) ** 2).sum(axis=1)
    assert wells.mean() == pytest.approx(1.5 * KT, rel=0.45) and wells.std() > 0.3 * KT
    # the bond's energy makes up the rest, frame by frame
    vertices = np.array([frame.mesh.vertices[0] for frame in frames])
    bonds = 50 * (np.linalg.norm(beads[:, 0] - vertices, axis=1) - 0.3) ** 2
    rows = np.isin(result.table["step"], [frame.step for frame in frames])
    total = bonds + 50 * ((beads[:, 1] - [2, 0, 0]) ** 2).sum(axis=1)
    assert result.table["E_other"][rows] * KT == pytest.approx(total, rel=1e-6)
    assert ("energy of other forces") in dict(result.lines())
    trajectory = mdtraj.load_dcd(str(tmp_path / "run.dcd"), top=str(tmp_path / "run.psf"))
    assert trajectory.n_atoms == 164 and trajectory.xyz[-1, 162:] == pytest.approx(beads[-1], abs=1e-5)
    assert [atom.residue.name for atom in trajectory.topology.atoms][-3:] == ["MEM", "BEA", "BEA"]


def test_a_run_goes_on_with_what_its_checkpoint_has(tmp_path):
    """A run that was stopped, with forces, beads and fixed vertices, writes what it would have written."""
    pull(tmp_path / "pull.xml", [3])
    system = {"forces": str(tmp_path / "pull.xml"), "fixed_box": POLES}
    stages = [{"kind": "minimize", "max_iterations": 5}, {"kind": "sample", "steps": 30}]
    tables = []
    for name, stop in (("whole", 10**6), ("stopped", 12)):
        config = configuration(tmp_path, system=system, stages=copy.deepcopy(stages))
        config["output"]["prefix"] = str(tmp_path / name)

        def progress(study, stop=stop):
            if study.simulation.currentStep >= stop:
                raise KeyboardInterrupt

        assert mh.run(config, progress, tie).interrupted == (name == "stopped")
    (tmp_path / "pull.xml").unlink()
    assert not mh.resume(tmp_path / "stopped").interrupted
    tables = [(tmp_path / f"{name}.csv").read_bytes() for name in ("whole", "stopped")]
    assert tables[0] == tables[1]
    whole, stopped = (mh.readMeshTrajectory(tmp_path / f"{name}.vtkhdf") for name in ("whole", "stopped"))
    assert len(whole) == len(stopped) > 5 and all(stopped.holds(frame, i) for i, frame in enumerate(whole))
    assert (tmp_path / "whole.dcd").read_bytes() == (tmp_path / "stopped.dcd").read_bytes()


def test_a_setup_that_is_given_again_must_be_the_same(tmp_path):
    mh.run(configuration(tmp_path, sampling={"steps": 5}), setup=tie)
    for other, words in (
        (lambda system, scene: None, "makes 162 particles of vertices and beads; the run .*run has 164"),
        (lambda system, scene: [tie(system, scene), system.setParticleMass(0, 5)][0], "other forces or masses"),
    ):
        with pytest.raises(ValueError, match=words):
            mh.resume(tmp_path / "run", steps=5, setup=other)
    assert mh.resume(tmp_path / "run", steps=5, setup=tie).steps == 10


def test_fixed_vertices_stay_and_their_edges_flip(tmp_path):
    sampling = {"shear_wave_probability": 0.2, "flip_probability": 0.4, "step_size": "auto"}
    stages = [
        {"kind": "minimize", "fluid": True, "max_iterations": 20},
        {"kind": "sample", "steps": 30, "reduced_volume": 0.95},
        {"kind": "anneal", "steps": 10, "end_temperature": 200.0},
    ]
    result = mh.run(configuration(tmp_path, system={"fixed_box": POLES}, sampling=sampling, stages=stages))
    first, last = (mh.readMeshTrajectory(tmp_path / "run.vtkhdf")[i].mesh for i in (0, -1))
    start = mh.Mesh.icosphere(2)
    isFixed = np.all((start.vertices >= POLES[0]) & (start.vertices <= POLES[1]), axis=1)
    assert 10 < isFixed.sum() < 30 and result.config.system.fixed == np.flatnonzero(isFixed).tolist()
    assert np.array_equal(last.vertices[isFixed], start.vertices[isFixed])
    assert np.all(np.linalg.norm(last.vertices - start.vertices, axis=1)[~isFixed] > 0)

    def fans(mesh):
        return {tuple(edge) for edge in mesh.edges.tolist() if isFixed[list(edge)].any()}

    assert fans(last) != fans(start)
    masses = mm.XmlSerializer.deserialize(_member(tmp_path / "run.checkpoint", "system.xml"))
    assert [masses.getParticleMass(i)._value == 0 for i in range(162)] == isFixed.tolist()


def _member(archive, name):
    import zipfile

    with zipfile.ZipFile(archive) as file:
        return file.read(name).decode()


def test_forces_of_a_file_act(tmp_path):
    """One force, a list, and a System whose forces are taken pull alike."""
    force = pull(tmp_path / "one.xml")
    system = mh.Mesh.icosphere(2).createSystem()
    system.addForce(copy.deepcopy(force))
    (tmp_path / "system.xml").write_text(mm.XmlSerializer.serialize(system))
    (tmp_path / "run.toml").write_text(
        'mesh = {icosphere = 2}\nsystem.forces = "one.xml"\nsampling = {steps = 3, seed = 1}\n'
        f'output.prefix = "{tmp_path / "file"}"\n'
    )
    tables = [mh.run(tmp_path / "run.toml").table]
    for n, files in enumerate((["one.xml"], "system.xml")):
        names = [str(tmp_path / name) for name in files] if isinstance(files, list) else str(tmp_path / files)
        config = configuration(tmp_path, system={"forces": names}, sampling={"steps": 3, "seed": 1})
        config["sampling"].pop("steps_per_trajectory")
        config["output"] = {"prefix": str(tmp_path / f"other{n}")}
        tables.append(mh.run(config).table)
    for table in tables:
        assert np.array_equal(table["E_other"], tables[0]["E_other"])
    vertex = mh.Mesh.icosphere(2).vertices[0]
    assert tables[0]["E_other"][0] * KT == pytest.approx(-20 * vertex[0], rel=1e-9)


def test_sweeps_have_the_setup(tmp_path):
    (tmp_path / "base.toml").write_text(
        "mesh = {icosphere = 1}\nsampling = {steps = 4, steps_per_trajectory = 5}\n"
        "system = {forces = 'pull.xml'}\noutput = {observables_interval = 1}\n"
    )
    pull(tmp_path / "pull.xml")
    (tmp_path / "grid.toml").write_text("base = 'base.toml'\n[grid]\n'membrane.bending_modulus' = [10.0, 20.0]\n")
    result = mh.sweep(tmp_path / "grid.toml", tmp_path / "out", workers=1, setup=lambda s, scene: tie(s, scene))
    assert result.count("done") == 2, [state.reason for state in result.points]
    for state in result.points:
        frame = mh.readMeshTrajectory(tmp_path / "out" / state.point.name / "run.vtkhdf")[-1]
        assert len(frame.mesh.beads) == 2 and np.isfinite(state.observables["E_other (kT)"])
    context = mm.Context(frame.mesh.createSystem(), mm.VerletIntegrator(0.1))
    with pytest.raises(ValueError, match="the setup cannot go to the processes of the sweep"):
        mh.sweep(tmp_path / "grid.toml", tmp_path / "more", setup=lambda s, scene: context)


def test_frames_of_every_kind_have_the_beads(tmp_path):
    mh.run(configuration(tmp_path, sampling={"steps": 5, "flip_probability": 0.0}), setup=tie)
    (frame,) = mh.readMeshTrajectory(tmp_path / "run.vtkhdf")
    convert(tmp_path / "run.vtkhdf", tmp_path / "copy.vtkhdf")
    (copied,) = mh.readMeshTrajectory(tmp_path / "copy.vtkhdf")
    assert np.array_equal(copied.mesh.beads, frame.mesh.beads)
    convert(tmp_path / "run.dcd", tmp_path / "dcd.vtkhdf", topology=tmp_path / "run.psf")
    (plain,) = mh.readMeshTrajectory(tmp_path / "dcd.vtkhdf")
    assert plain.mesh.beads == pytest.approx(frame.mesh.beads, abs=1e-5)
    assert plain.mesh.vertices == pytest.approx(frame.mesh.vertices, abs=1e-5)
    convert(tmp_path / "run.vtkhdf", tmp_path / "run.xyz")
    lines = (tmp_path / "run.xyz").read_text().splitlines()
    assert lines[0] == "164" and [line[0] for line in lines[2:]] == ["V"] * 162 + ["B"] * 2
    convert(tmp_path / "run.vtkhdf", tmp_path / "run_last.vtu")
    assert len(mh.Mesh.read(tmp_path / "run_last.vtu").vertices) == 162


def test_vtk_reads_the_beads_as_points(tmp_path):
    pyvista = pytest.importorskip("pyvista")
    mesh = mh.Mesh.icosphere(1)
    frames = [
        mh.MeshFrame(step, mh.Mesh(mesh.vertices, mesh.triangles, beads=[[step, 0, 2], [0, step, 3]]), {"Area": areas})
        for step, areas in ((0, mesh.vertexAreas), (5, 2 * mesh.vertexAreas))
    ]
    mh.writeMeshTrajectory(tmp_path / "a.vtkhdf", frames)
    reader = pyvista.get_reader(tmp_path / "a.vtkhdf")
    for i, frame in enumerate(frames):
        reader.reader.SetStep(i)
        reader.reader.Update()
        found = pyvista.wrap(reader.reader.GetOutput())
        assert (found.n_verts, found.n_faces, found.n_points) == (2, 80, 44)
        assert np.array_equal(found.points[42:], frame.mesh.beads) and found.verts.tolist() == [1, 42, 1, 43]
        area = np.asarray(found.point_data["Area"])
        assert np.array_equal(area[:42], np.float32(frame.data["Area"])) and np.all(np.isnan(area[42:]))
    with pytest.raises(ValueError, match="the frame of step 7 has 42 vertices"):
        mh.writeMeshTrajectory(tmp_path / "a.vtkhdf", [frames[0], mh.MeshFrame(7, mesh, frames[0].data)])


def test_a_scene_is_what_a_configuration_makes(tmp_path):
    """Scripts have the defaults of configurations, with a mesh of their own or one that is named."""
    mesh = mh.Mesh.icosphere(2)
    (tmp_path / "a.toml").write_text("mesh = {icosphere = 2}\nsampling = {seed = 1}\n")
    scenes = [
        mh.Scene.of(tmp_path / "a.toml"),
        mh.Scene.of({"mesh": {"icosphere": 2}, "sampling": {"seed": 1}}),
        mh.Scene.of({"sampling": {"seed": 1}}, mesh),
    ]
    energies = []
    for scene in scenes:
        assert (scene.tether, scene.stepSize) == (scenes[0].tether, scenes[0].stepSize)
        simulation = scene.createSimulation(scene.createForce())
        simulation.step(4)
        energies.append(simulation.context.getState(energy=True).getPotentialEnergy()._value)
    assert energies[0] == energies[1] == energies[2]
    default, own = scenes[0].createIntegrator(), mh.HybridMonteCarloIntegrator(300, 0.1)
    for ask in ("getFlipFraction", "getStepsPerTrajectory"):
        assert getattr(default, ask)() == getattr(own, ask)()
    assert [default.getMoveProbability(i) for i in range(2)] == [own.getMoveProbability(i) for i in range(2)]
    with pytest.raises(ValueError, match=r"\[mesh\] is missing"):
        mh.Scene.of({})


def system(count):
    made = mm.System()
    for _ in range(count):
        made.addParticle(1.0)
    return made


@pytest.mark.parametrize(
    "section, words",
    [
        ({"fixed": [3, 162]}, r"\[system\] fixed has the vertex 162; the mesh has 162, from 0 to 161"),
        ({"fixed": [-1]}, r"\[system\] fixed\[0\] is -1; it must be greater than or equal to 0"),
        ({"fixed": list(range(162))}, r"\[system\] fixed has all 162 vertices"),
        ({"fixed_box": [[5, 5, 5], [6, 6, 6]]}, r"fixed_box has no vertex in it; they lie from \[-1, -1, -1\] to"),
        ({"fixed_box": [[1, 0, 0], [0, 1, 1]]}, "the least coordinates must come first"),
        ({"fixed_box": POLES, "fixed": [0]}, "fixed and fixed_box are both given"),
        ({"forces": "none.xml"}, r"\[system\] forces: there is no file .*none.xml"),
        ({"forces": "text.xml"}, "text.xml is not OpenMM's XML of a Force or a System"),
        ({"forces": "integrator.xml"}, "integrator.xml has a VerletIntegrator; it must be a Force or a System"),
        ({"forces": "membrane.xml"}, r"membrane.xml has a HelfrichForce; the membrane's own comes from \[membrane\]"),
        ({"forces": "small.xml"}, r"has 3 particles, and the mesh 162 vertices.*mh.run\(config, setup=...\)"),
        ({"force": "x.xml"}, r"\[system\] has no key 'force'; did you mean 'forces'"),
    ],
)
def test_mistakes_are_named(tmp_path, section, words, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "text.xml").write_text("no XML")
    for name, what in (
        ("integrator", mm.VerletIntegrator(0.1)),
        ("membrane", mh.HelfrichForce()),
        ("small", system(3)),
    ):
        (tmp_path / f"{name}.xml").write_text(mm.XmlSerializer.serialize(what))
    with pytest.raises((ValueError, FileNotFoundError), match=words):
        mh.run(configuration(tmp_path, system=section))
    assert not list(tmp_path.glob("run*"))


@pytest.mark.parametrize(
    "file, words",
    [
        ("unknown", "CustomExternalForce of .*unknown.xml cannot be used: Unknown variable in expression: zz"),
        ("far", "CustomExternalForce of .*far.xml cannot be used: .*Illegal particle index: 200"),
        ("few", "CustomNonbondedForce of .*few.xml cannot be used: .* as many particles as the System"),
        ("stiffer", "CustomExternalForce of .*stiffer.xml cannot be used: .* different default values"),
        ("root", "CustomExternalForce of .*root.xml has the energy nan kJ/mol at the start; it must be finite"),
        ("both", "CustomExternalForce 'the second' of .*both.xml has the energy nan kJ/mol"),
        (
            "kink",
            r"CustomExternalForce of .*kink.xml has the force \(-inf, 0, 0\) kJ/mol/nm on particle 4 at the start",
        ),
    ],
)
def test_forces_that_cannot_be_computed_are_named(tmp_path, file, words):
    """Of several files that one is named, before anything is written, whatever the stages are."""
    everywhere = range(162)
    for name, energy, vertices in (
        ("pull", "-20*x", [0]),
        ("unknown", "20*zz", [0]),
        ("far", "x", [200]),
        ("root", "sqrt(x)", everywhere),
        ("kink", "sqrt(abs(x))", everywhere),
    ):
        pull(tmp_path / f"{name}.xml", vertices, energy)
    few, both = mm.CustomNonbondedForce("r"), system(162)
    for _ in range(100):
        few.addParticle([])
    for name in ("first", "second"):
        force = pull(tmp_path / "again.xml", everywhere, "x" if name == "first" else "log(x)")
        force.setName(f"the {name}")
        both.addForce(force)
    soft, stiffer = mm.CustomExternalForce("k*x"), mm.CustomExternalForce("k*x")
    soft.addGlobalParameter("k", 1)
    stiffer.addGlobalParameter("k", 2)
    for name, what in (("few", few), ("both", both), ("soft", soft), ("stiffer", stiffer)):
        (tmp_path / f"{name}.xml").write_text(mm.XmlSerializer.serialize(what))
    files = [str(tmp_path / f"{name}.xml") for name in ("pull", "soft", file)]
    stages = [{"kind": "minimize"}, {"kind": "sample", "steps": 5}]
    with pytest.raises(ValueError, match=rf"^\[system\] forces: the {words}"):
        mh.run(configuration(tmp_path, system={"forces": files}, stages=stages))
    assert not list(tmp_path.glob("run*")) and not list(tmp_path.glob(".run*"))


@pytest.mark.parametrize(
    "energy, words",
    [("1/r^12", "has the energy inf kJ/mol at the start; it must be finite"), ("q*r", "cannot be used: Unknown var")],
)
def test_forces_of_a_setup_are_named(tmp_path, energy, words):
    """Here of a bead where a vertex is, beside a file with nothing wrong."""
    pull(tmp_path / "pull.xml")

    def setup(system, scene):
        bond = mm.CustomBondForce(energy)
        bond.addBond(0, system.addParticle(1.0))
        system.addForce(bond)
        return scene.mesh.vertices[:1]

    with pytest.raises(ValueError, match=f"^setup: the CustomBondForce {words}"):
        mh.run(configuration(tmp_path, system={"forces": str(tmp_path / "pull.xml")}), setup=setup)
    assert not list(tmp_path.glob("run*"))


def test_energies_that_are_finite_only_alone_are_refused(tmp_path):
    """Also where it is not known from which file a force is, as in a checkpoint."""
    pull(tmp_path / "a.xml", [0], "1e308+x")
    config = configuration(tmp_path, system={"forces": [str(tmp_path / "a.xml")] * 2})
    with pytest.raises(
        ValueError, match="the membrane and all that is beside it have, together, the energy inf kJ/mol"
    ):
        mh.run(config)
    pull(tmp_path / "a.xml", [0], "1e308*(x+20)")
    scene = mh.Scene.of(config)
    context = scene.createSimulation(scene.createForce()).context
    with pytest.raises(ValueError, match=r"^the CustomExternalForce beside the membrane has the energy inf"):
        requireFinite(context, None, 162)


def test_forces_on_fixed_vertices_need_not_be_finite(tmp_path):
    """They move nothing, in trajectories and minimizations."""
    pull(tmp_path / "kink.xml", range(162), "sqrt(abs(x))")
    held = np.flatnonzero(mh.Mesh.icosphere(2).vertices[:, 0] == 0).tolist()
    stages = [{"kind": "minimize", "max_iterations": 5}, {"kind": "sample", "steps": 5}]
    config = configuration(tmp_path, system={"fixed": held, "forces": str(tmp_path / "kink.xml")}, stages=stages)
    result = mh.run(config)
    assert len(held) > 0 and result.steps == 6 and np.all(np.isfinite(result.table["E_other"]))
    assert result.acceptance > 0


def test_the_vertices_that_can_move_tell_how_far_they_have_come(tmp_path):
    """Those that a configuration or a setup holds do not count, and a single one does not drift."""

    def hold(system, scene):
        for vertex in range(82, 162):
            system.setParticleMass(vertex, 0.0)

    config = configuration(tmp_path, system={"fixed": list(range(81))}, sampling={"steps": 30})
    assert "vertices moved" not in str(mh.run(config, setup=hold).verdict)


@pytest.mark.parametrize("held, way", [((), 0.0), ((0,), 2.0)])
def test_a_drift_is_no_way_unless_a_particle_is_held(held, way):
    mesh = mh.Mesh.icosphere(2)
    made = mesh.createSystem()
    for vertex in held:
        made.setParticleMass(vertex, 0.0)
    context = mm.Context(made, mm.VerletIntegrator(0.1), mm.Platform.getPlatformByName("Reference"))
    marks = []
    for x in (0, 2):
        context.setPositions(mesh.vertices + np.array([x, 0, 0]))
        marks.append(markedPositions(context, np.arange(162)))
    assert marks[0].shape == (100, 3) and displacement(*marks) == pytest.approx(way, abs=1e-12)


@pytest.mark.parametrize("positions", [None, [[0, 0]], [[0, 0, float("nan")]], "here"])
def test_a_setup_must_say_where_its_beads_are(tmp_path, positions):
    def setup(system, scene):
        system.addParticle(1.0)
        return positions

    with pytest.raises(ValueError, match=r"the setup added 1 particle to the System; .* of shape \(1, 3\)"):
        mh.run(configuration(tmp_path), setup=setup)


def test_a_setup_is_a_function_that_returns_beads_or_nothing(tmp_path):
    for wrong in ("here", [[0, 0, 0]]):
        with pytest.raises(ValueError, match="the setup returned something, and added no particles; add beads, or"):
            mh.run(configuration(tmp_path), setup=lambda system, scene, wrong=wrong: wrong)
    with pytest.raises(TypeError, match="setup is 3; it must be a function of the System and the Scene"):
        mh.run(configuration(tmp_path), setup=3)
    assert not list(tmp_path.glob("run*"))
