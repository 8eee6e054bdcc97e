"""Targets that are far from the mesh are reached by a stage that a run adds by itself."""

import math
from pathlib import Path

import numpy as np
import pytest

import openmmhelfrich as mh
from openmmhelfrich.runs.approach import FAR, STEPS_PER_E_FOLD, UNKNOWN, withApproaches
from openmmhelfrich.runs.config import parseConfig, readTOML
from openmmhelfrich.runs.scene import Scene
from openmmhelfrich.runs.stages import placeOf
from openmmhelfrich.runs.stagesettings import AnnealStage, ContinueStage, MinimizeStage, SampleStage
from test_restarted_runs import StopAt, assertSame, contentsOf

MEASURES = {"area": 12.0, "volume": 4.0}


def sample(**targets):
    return SampleStage(kind="sample", steps=10, **targets)


def kindsOf(stages, targets=MEASURES):
    return [stage.kind for stage in withApproaches(stages, MEASURES, targets, 642)[0]]


def configOf(tmp_path, **sections):
    config = {
        "mesh": {"icosphere": 1},
        "membrane": {"reduced_volume": 0.8},
        "platform": {"threads": 1},
        "sampling": {"seed": 3, "steps": 20, "steps_per_trajectory": 5},
        "output": {"prefix": str(tmp_path / "run"), "observables_interval": 1},
    }
    for name, values in sections.items():
        config[name] = {**config.get(name, {}), **values} if isinstance(values, dict) else values
    return config


@pytest.mark.parametrize("factor", [1 + 0.9 * FAR, 1 / (1 + 0.9 * FAR), 1.0])
def test_near_targets_are_taken_at_once(factor):
    targets = {"area": 12.0, "volume": 4.0 * factor}
    assert withApproaches([sample()], MEASURES, targets, 642) == ([sample()], targets)


@pytest.mark.parametrize("factor", [1 + 1.1 * FAR, 1 / (1 + 1.1 * FAR), 0.1, 10.0])
@pytest.mark.parametrize("numVertices, slowness", [(42, 1), (642, 1), (4 * 642, 2)])
def test_far_targets_are_led_to(factor, numVertices, slowness):
    (approach, last), first = withApproaches([sample()], MEASURES, {"area": 12.0, "volume": 4.0 * factor}, numVertices)
    assert (approach.kind, last, first) == ("approach", sample(), MEASURES)
    assert (approach.target_area, approach.target_volume) == (12.0, 4.0 * factor)
    assert approach.steps == math.ceil(STEPS_PER_E_FOLD * abs(math.log(factor)) * slowness)


def test_stages_that_change_targets_little_by_little_need_no_other():
    far = {"area": 12.0, "volume": 2.0}
    anneal = AnnealStage(kind="anneal", end_temperature=3.0)
    going = ContinueStage(kind="continue", target_volume=2.0)
    assert kindsOf([MinimizeStage(kind="minimize"), sample()], far) == ["minimize", "sample"]
    assert kindsOf([going, sample()]) == ["continue", "sample"]
    assert kindsOf([going, sample()], far) == ["approach", "continue", "sample"]  # it would begin far away
    assert kindsOf([anneal], far) == ["approach", "anneal"]
    assert kindsOf([sample(), sample(target_volume=3.0), sample(target_volume=2.9)]) == [
        "sample",
        "approach",
        "sample",
        "sample",
    ]


def test_a_stage_is_led_to_at_its_own_temperature():
    led, _ = withApproaches([sample(target_volume=3.0, temperature=150.0)], MEASURES, MEASURES, 642)
    assert led[0].temperature == 150.0


def test_terms_that_are_off_ask_for_nothing(tmp_path):
    config = parseConfig(configOf(tmp_path, membrane={"volume_modulus": 0.0, "reduced_volume": None}))
    config.membrane.target_volume = 1.0
    assert [stage.kind for stage in Scene.of(config).stages] == ["sample"]


FAR_AWAY = {"area": 12.0, "volume": 3.0}


def ledOf(stages, targets=FAR_AWAY, held=("area",)):
    return withApproaches(stages, MEASURES, targets, 642, held)[0]


def test_the_moduli_of_the_stage_decide():
    on, off = sample(volume_modulus=1e6), sample(volume_modulus=0.0)
    assert [stage.kind for stage in ledOf([sample()])] == ["sample"]
    assert [stage.kind for stage in ledOf([off], held=("area", "volume"))] == ["sample"]
    approach, last = ledOf([on])
    assert (approach.kind, approach.volume_modulus, approach.target_volume, last) == ("approach", 1e6, 3.0, on)
    going = ContinueStage(kind="continue", volume_modulus=1e6)
    assert [stage.kind for stage in ledOf([going, sample()])] == ["continue", "sample"]


def test_what_was_released_may_be_anywhere():
    """So it is led back, though its target is what the mesh has at the start."""
    on, off = sample(volume_modulus=1e6), sample(volume_modulus=0.0)
    led = ledOf([off, on, on], targets=MEASURES, held=("area", "volume"))
    assert [stage.kind for stage in led] == ["sample", "approach", "sample", "sample"]
    assert led[1].steps == math.ceil(STEPS_PER_E_FOLD * UNKNOWN)
    back = ContinueStage(kind="continue", volume_modulus=0.0, there_and_back=True)
    assert [stage.kind for stage in ledOf([back, on], MEASURES, ("area", "volume"))] == ["continue", "sample"]


def test_an_approach_begins_where_the_membrane_is(tmp_path):
    """A stage that brings a modulus from 0 leads the target from what the membrane has, whatever it was before."""
    stage = {"kind": "approach", "steps": 10, "volume_modulus": 1e4, "reduced_volume": 0.9}
    config = configOf(tmp_path, membrane={"volume_modulus": 0.0, "reduced_volume": None}, stages=[stage])
    del config["sampling"]["steps"]
    table = mh.run(config).table
    start, end = table["volume"][0], 0.9 * table["targetArea"][0] ** 1.5 / (6 * math.sqrt(math.pi))
    assert np.allclose(table["targetVolume"][1:], start + (end - start) * np.arange(1, 11) / 10)
    assert np.allclose(table["volumeModulus"], 1e3 * np.arange(11))


def test_a_target_of_the_membrane_may_wait_for_its_modulus(tmp_path):
    """It is no setting without effect where a stage gives it a modulus."""
    stages = [{"kind": "sample", "steps": 2}, {"kind": "minimize", "max_iterations": 5, "volume_modulus": 1e3}]
    config = configOf(tmp_path, membrane={"volume_modulus": 0.0, "reduced_volume": 0.9}, stages=stages)
    del config["sampling"]["steps"]
    mh.run(config)
    config["stages"][1]["volume_modulus"] = 0.0
    with pytest.raises(ValueError, match=r"reduced_volume is 0\.9, and has no effect, since volume_modulus is 0"):
        mh.run(config)


def test_the_step_size_is_that_of_the_stiffest_stage(tmp_path):
    """Stages without effect on the moduli leave it as it is."""

    def stepSizeOf(modulus, stages):
        config = configOf(tmp_path, membrane={"bending_modulus": modulus, "reduced_volume": None}, stages=stages)
        del config["sampling"]["steps"]
        return Scene.of(config).stepSize

    going = {"kind": "continue", "bending_modulus": 3.0}
    plain = [{"kind": "sample", "steps": 2}]
    assert stepSizeOf(9.0, [*plain, {"kind": "sample", "bending_modulus": 90.0}, *plain]) == stepSizeOf(90.0, plain)
    assert stepSizeOf(90.0, [going]) == stepSizeOf(90.0, plain)
    assert stepSizeOf(90.0, [{**going, "kind": "sample"}]) == stepSizeOf(3.0, plain) > stepSizeOf(90.0, plain)


def test_targets_go_in_equal_parts_to_their_end(tmp_path):
    summary = mh.run(configOf(tmp_path))
    approach = summary.config.stages[0]
    led = summary.table.where(summary.table["stage"] == 1)
    start, steps = mh.Mesh.icosphere(1).volume, led["step"]
    assert np.allclose(
        led["targetVolume"], start + (approach.target_volume - start) * steps / approach.steps, rtol=1e-12
    )
    assert steps[-1] == approach.steps and not led["equilibrated"].any()
    assert summary.mean("reducedVolume") == pytest.approx(0.8, abs=0.01)
    assert any("stage 1, approach: volume from" in note for note in summary.notes)


def test_it_can_be_switched_off(tmp_path):
    scene = Scene.of(parseConfig(configOf(tmp_path, sampling={"approach": "none"})))
    assert [stage.kind for stage in scene.stages] == ["sample"]
    assert scene.targets["volume"] < 0.9 * scene.mesh.volume


def test_resolved_settings_make_the_same_run(tmp_path):
    mh.run(configOf(tmp_path))
    config = readTOML(tmp_path / "run.resolved.toml")
    config["output"]["prefix"] = str(tmp_path / "again")
    mh.run(config)
    for ending in (".csv", ".dcd", ".ply", ".psf"):
        assert Path(f"{tmp_path}/run{ending}").read_bytes() == Path(f"{tmp_path}/again{ending}").read_bytes()


def test_a_run_goes_on_in_the_middle_of_an_approach(tmp_path):
    (tmp_path / "parts").mkdir()
    mh.run(configOf(tmp_path))
    config = configOf(tmp_path / "parts")
    assert mh.run(config, progress=StopAt(7)).interrupted
    mh.resume(config["output"]["prefix"])
    assertSame(config["output"]["prefix"], contentsOf(str(tmp_path / "run")))


def test_errors_number_the_stages_of_the_file(tmp_path):
    """Approaches that are added are not counted, and are named by what they lead to."""
    second = {"kind": "sample", "steps": 5, "step_size": 1e9}
    config = configOf(tmp_path, sampling={"seed": 3}, stages=[{"kind": "sample", "steps": 5}, second])
    del config["sampling"]["steps"]
    with pytest.raises(ValueError, match=r"stage 2 \(sample\): step_size is 1e\+09"):
        mh.run(config)
    led, _ = withApproaches([sample(), sample(target_volume=3.0)], MEASURES, MEASURES, 642)
    assert [placeOf(led, i) for i in range(3)] == [
        "stage 1 (sample)",
        "the approach to stage 2 (sample)",
        "stage 2 (sample)",
    ]


def test_an_approach_needs_a_goal():
    with pytest.raises(ValueError, match="has no target to go to; give one of target_area, target_volume"):
        parseConfig({"mesh": {"icosphere": 1}, "stages": [{"kind": "approach"}]})


def test_an_automatic_step_size_that_is_lost_says_why(tmp_path, monkeypatch):
    """Where no trajectory is accepted, however short, the search ends with what the membrane looks like."""
    monkeypatch.setattr("openmmhelfrich.runs.stages.StepSizeAdapter.lastProbability", staticmethod(lambda *_: 0.0))
    config = configOf(tmp_path, membrane={"reduced_volume": None}, sampling={"step_size": "auto", "steps": 200})
    with pytest.raises(ValueError, match=r"sample: no step size is accepted; .* ps go with .* its edges are .* long"):
        mh.run(config)
    assert Path(f"{tmp_path}/run.checkpoint").exists()
