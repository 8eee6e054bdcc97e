"""Trading speed for accuracy: the statistics of one setting, the search, and what it recommends."""

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import openmmhelfrich as mh
from membranes import createContext, energyOf
from openmmhelfrich.analysis import gyrationTensor
from openmmhelfrich.runs.config import parseConfig, readConfig
from openmmhelfrich.runs.scene import Scene
from openmmhelfrich.runs.studies import run
from openmmhelfrich.tradeoff import tradeoff
from openmmhelfrich.tradeoff.measure import forceError, measure, timeOf
from openmmhelfrich.tradeoff.settings import apply, forEdges, moduliRatios, tetherOf
from openmmhelfrich.tradeoff.statistics import Motion, shapeSeries, statisticsOf

pytest.importorskip("emcee")
SCENE: dict[str, Any] = {
    "mesh": {"icosphere": 1},
    "membrane": {"bending_modulus": 20, "area_modulus": 1e4, "volume_modulus": 1e4, "reduced_volume": 0.95},
    "tether": {"modulus": 737.3454528339315, "min_length": 0.4367126424657144, "max_length": 0.8151969326026669},
    "sampling": {"seed": 1, "step_size": 1e-4, "steps_per_trajectory": 20},
    "platform": {"threads": 1},
}
# So few vertices fold more easily the softer they are, and all settings shall sample the same shape.
STIFF: dict[str, Any] = {
    **SCENE,
    "membrane": {**SCENE["membrane"], "bending_modulus": 60},
}


def resolved(**sampling):
    config = parseConfig({**SCENE, "sampling": {**SCENE["sampling"], **sampling}})
    scene = Scene.of(config)
    return scene.config, scene.mesh


@pytest.fixture(scope="module")
def searched(tmp_path_factory):
    """A search over all axes of a small membrane."""
    prefix = tmp_path_factory.mktemp("tradeoff") / "a"
    return (*tradeoff(STIFF, prefix, error=1e-2, effort=2.5e5), prefix)


def knownProcess(correlation, length, columns=5):
    """x_n = a x_(n-1) + noise, from its stationary distribution: an integrated autocorrelation time of (1+a)/(1-a), and
    a variance of 1.
    """
    random = np.random.default_rng(1)
    x = [random.normal(size=columns)]
    for noise in random.normal(scale=math.sqrt(1 - correlation**2), size=(length - 1, columns)):
        x.append(correlation * x[-1] + noise)
    return np.array(x)


def test_statistics_of_a_known_process():
    """The time of a series that is long enough, within the error that is stated."""
    result = statisticsOf(knownProcess(0.9, 4000), interval=3)
    assert result.time == pytest.approx(3 * 19, rel=3 * result.timeError) and result.timeError < 0.15
    assert result.deviation == pytest.approx(1, rel=0.05) and abs(result.mean) < 3 * result.error


@pytest.mark.parametrize("correlation", [0.9, 0.99, 0.999, 0.9999])
def test_times_longer_than_a_series(correlation):
    """A series says by how far it moves what its correlation time is, even if that is ten times its length."""
    motion = Motion.of(knownProcess(correlation, 2000), interval=3)
    time, error = motion.time([1.0] * 5, 0.0)
    assert error < 0.35 and time == pytest.approx(3 * (1 + correlation) / (1 - correlation), rel=2.5 * error)
    assert motion.time([1.0] * 5, 0.3)[1] > error


def test_a_slow_creep_behind_a_fast_decay():
    """Where a run is too short to know its time, but knows that there is more than the first decay, this counts."""
    fast, slow = knownProcess(0.9, 20000, 10), knownProcess(0.999, 20000, 10)
    series = math.sqrt(0.7) * fast[:, :5] + math.sqrt(0.3) * slow[:, 5:]
    shape, motion = statisticsOf(series), Motion.of(series)
    time, error = timeOf(shape, motion, [1.0] * 5, 0.0)
    assert shape.timeError > 0.3 and motion.time([1.0] * 5, 0.0)[0] < 0.3 * time
    assert time == pytest.approx(0.7 * 19 + 0.3 * 1999, rel=2.5 * error)


def test_what_does_not_move_has_no_time():
    assert Motion.of(np.ones((100, 2))).time([1.0, 1.0], 0.0) == (math.inf, math.inf)


def test_shape_of_a_sphere_is_its_modes_of_degree_2():
    """Of each mode, the amplitude comes out in one column alone; that of another degree in none."""
    from openmmhelfrich.analysis.fluctuations import realHarmonics

    mesh = mh.Mesh.icosphere(3)
    harmonics = realHarmonics(mesh.vertices, 3)
    series = shapeSeries(
        np.array(
            [
                gyrationTensor(mh.Mesh(mesh.vertices * (1 + 1e-3 * y)[:, np.newaxis], mesh.triangles))
                for y in harmonics[:, 4:].T
            ]
        ),
        True,
    )
    amplitudes = np.abs(series).max(axis=1)
    assert amplitudes[:5] == pytest.approx(amplitudes[0], rel=0.02) and np.all(amplitudes[5:] < 0.02 * amplitudes[0])


@pytest.mark.parametrize("sampling", [{"step_size": "auto"}, {"trajectory_jitter": 0.5, "flip_probability": 0.2}])
def test_exact_settings_agree(sampling):
    """Mean energy, area and volume do not depend on how they are sampled, and trajectories up in energy are accepted as
    often as those down.
    """
    results = []
    for settings in ({"steps_per_trajectory": 10, "step_size": 3e-4}, {"step_size": 2e-4, **sampling}):
        config, mesh = resolved(**settings)
        results.append(measure(config, mesh, 8e5, accuracy=2e-3))
    for result in results:
        mean, error = result.balance
        assert abs(mean) < 4 * error and 0.3 < result.acceptance <= 1
    for name in ("bending", "area", "volume"):
        a, b = (result.observables[name] for result in results)
        assert abs(a.mean - b.mean) < 4 * math.hypot(a.error, b.error) and a.error < 4e-3 * a.mean


def test_long_trajectories_have_statistics():
    """A setting is measured until there are rows to average, however long its trajectories are."""
    config, mesh = resolved(steps_per_trajectory=1000)
    result = measure(config, mesh, 1e4)
    assert result.steps >= 10 and result.evaluations > 1e4 / len(mesh.vertices)
    assert all(math.isfinite(series.time) for series in result.observables.values())


def test_softer_constraints_are_corrected():
    """Weights bring averages of softer constraints to those of the scene's own, which are certainly different."""
    config, mesh = resolved(step_size="auto")
    softer = apply(config, {"membrane.area_modulus": 5e3, "membrane.volume_modulus": 5e3})
    ratios = moduliRatios(config, {"membrane.area_modulus": 5e3, "membrane.volume_modulus": 5e3})
    assert ratios == {"area": 2, "volume": 2}
    hard, soft = measure(config, mesh, 8e5, accuracy=2e-3), measure(softer, mesh, 8e5, moduli=ratios, accuracy=2e-3)
    assert 0.1 < soft.effectiveFraction < 0.95
    for name in ("area", "volume"):
        true, raw, (mean, error) = hard.observables[name], soft.observables[name], soft.reweighted[name]
        assert abs(mean - true.mean) < 4 * math.hypot(error, true.error)
        assert abs(mean - true.mean) < abs(raw.mean - true.mean)


def test_force_error():
    config, mesh = resolved()
    assert 0 < forceError(config, mesh) < 1e-12
    config.platform.precision = "mixed"
    assert 1e-9 < forceError(config, mesh) < 1e-4
    config.platform.name, config.platform.threads, config.platform.precision = "Reference", None, "double"
    assert forceError(config, mesh) == 0


def test_tether_of_a_coarser_mesh():
    """Lengths measured by edges stay what they are, and so does the energy."""
    config, mesh = resolved()
    config.membrane.bending_modulus = config.membrane.area_modulus = config.membrane.volume_modulus = 0.0
    config.tether.min_length, config.tether.max_length = 0.95 * mesh.edgeLengths.mean(), 1.05 * mesh.edgeLengths.mean()
    setting = forEdges({**tetherOf(config), "sampling.steps_per_trajectory": 10}, 2.0)
    assert setting["sampling.steps_per_trajectory"] == 10
    energies = [
        energyOf(createContext(m, Scene.of(c, m).createForce()))
        for c, m in ((config, mesh), (apply(config, setting), mh.Mesh(2 * mesh.vertices, mesh.triangles)))
    ]
    assert energies[0] > 0 and energies[1] == pytest.approx(energies[0], rel=1e-10)


def test_search(searched):
    """All axes are measured, and what is recommended keeps within the error and costs no more than any other."""
    search, best, prefix = searched
    assert [point.axis for point in search.points[:3]] == ["scene", "reference", "step size"]
    assert {
        "tether",
        "moves together",
        "coarser meshes",
        "length",
        "jitter",
        "momenta",
        "acceptance",
        "flip probability",
        "flip fraction",
        "constraints",
        "terms",
    } <= {point.axis for point in search.points}
    assert best is not None and search.bias(best) <= search.error
    assert search.gain(best) > 2, "steps of a tenth of what they could be"
    table = (prefix.parent / "a.md").read_text().splitlines()
    assert len(table) == 2 * (2 + len(search.points) + 1) + 2 + len(search.minima)
    assert len({line.count("|") for line in table[: 2 + len(search.points)]}) == 1
    tolerances, energies = ([getattr(minimum, name) for minimum in search.minima] for name in ("tolerance", "energy"))
    assert (
        np.allclose(np.divide(tolerances[:-1], tolerances[1:]), 10)
        and energies[-1] == pytest.approx(min(energies), abs=1)
        and energies[0] > energies[-1]
    )
    assert (prefix.parent / "a.png").stat().st_size > 10000


def test_what_lacks_a_term_has_a_shape_of_its_own(searched):
    """Its correlation time comes from its own variance, and tells nothing of that of others."""
    search, _, _ = searched
    without = [point for point in search.points if point.axis == "terms" and point.measurement]
    assert any(point.choice == {"tether.modulus": 0.0} for point in without)
    for point in without:
        assert search.time(point) == point.measurement.shapeTime()


def test_recommendation_runs(searched, tmp_path):
    """The configuration that is written is one that runs, and its averages are those of the reference, as far as so
    short a search can tell.
    """
    search, best, prefix = searched
    config = readConfig(f"{prefix}.toml")
    assert config.sampling.step_size == pytest.approx(best.measurement.stepSize, rel=1e-3)
    config.sampling.steps, config.output.prefix, config.output.observables_interval = (
        min(config.sampling.steps, 3000),
        str(tmp_path / "b"),
        2,
    )
    summary = run(config)
    reference = search.reference.measurement.observables
    for name, column in (("bending", "E_bending"), ("area", "area"), ("volume", "volume")):
        assert summary.mean(column) == pytest.approx(
            reference[name].mean, rel=search.error + 4 * search.deviations(best)[name][1]
        )


def test_recommendation_finds_its_mesh(tmp_path, monkeypatch):
    """A scene, its mesh, and what is recommended may be in different folders; however small the effort is, there is a
    recommendation, whose keys all have an effect.
    """
    for folder in ("scenes", "meshes", "results"):
        (tmp_path / folder).mkdir()
    mh.Mesh.icosphere(1).write(tmp_path / "meshes" / "a.ply")
    (tmp_path / "scenes" / "a.toml").write_text(
        '[mesh]\nfile = "../meshes/a.ply"\n[sampling]\nseed = 1\nstep_size = "auto"\nburn_in = 20\n'
        '[platform]\nthreads = 1\n[output]\nprefix = "old"\n'
    )
    monkeypatch.chdir(tmp_path)
    tradeoff("scenes/a.toml", "results/b", error=0.1, effort=1e4, axes=["jitter"])
    config = readConfig("results/b.toml")
    assert Path(config.mesh.file).samefile("meshes/a.ply") and "old" not in str(config.output.prefix)
    assert config.sampling.step_size != "auto" and config.sampling.burn_in is None  # nothing is left that adapts


def test_a_search_goes_on(searched, tmp_path):
    """Points that are in the file are not measured again, and those that are missing come out the same."""
    search, best, prefix = searched
    for file in prefix.parent.glob("a*"):
        (tmp_path / file.name).write_bytes(file.read_bytes())
    data = json.loads((tmp_path / "a.json").read_text())
    removed = data["points"][2:4]
    data["points"] = data["points"][:2]
    (tmp_path / "a.json").write_text(json.dumps(data))
    again, nothing = tradeoff(STIFF, tmp_path / "a", error=1e-2, effort=2.5e5, minutes=0)
    assert nothing is None and len(again.points) == 2
    measured = []
    with pytest.raises(KeyboardInterrupt):

        def stop(point):
            if point.measurement is not None:
                measured.append(point)
                if len(measured) == 2:
                    raise KeyboardInterrupt

        tradeoff(STIFF, tmp_path / "a", error=1e-2, effort=2.5e5, progress=stop)
    for before, now in zip(removed, measured):
        assert now.setting == before["setting"] and now.measurement.steps == before["measurement"]["steps"]
        assert now.measurement.observables["bending"].mean == before["measurement"]["observables"]["bending"]["mean"]


@pytest.mark.parametrize(
    "changes, message",
    [
        ({"stages": [{"kind": "minimize"}]}, "the last stage has the kind 'minimize'"),
        ({"stages": [{"kind": "sample", "temperature": 100.0}]}, "the last stage has the temperature 100 K"),
    ],
)
def test_scenes_that_cannot_be_measured(changes, message, tmp_path):
    with pytest.raises(ValueError, match=message):
        tradeoff({**SCENE, **changes}, tmp_path / "a")


def test_arguments(searched, tmp_path):
    search, best, prefix = searched
    with pytest.raises(ValueError, match="the error is 2"):
        tradeoff(SCENE, tmp_path / "a", error=2)
    with pytest.raises(ValueError, match="there is no axis 'speed'; this scene has tether, "):
        tradeoff(SCENE, tmp_path / "a", axes=["speed"])
    with pytest.raises(ValueError, match="the measurements of another scene"):
        tradeoff({**SCENE, "membrane": {"bending_modulus": 10}}, prefix)
