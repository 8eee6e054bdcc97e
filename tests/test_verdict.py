"""The verdict on runs: what each check finds and what it lets pass, and where it is shown."""

import csv
import itertools
import json
import math
import re
import warnings
from dataclasses import replace

import numpy as np
import openmm as mm
import pytest
from distributed import LocalCluster
from typer.testing import CliRunner

import openmmhelfrich as mh
from conftest import ROOT
from openmmhelfrich.analysis.verdict import CHECKS, LEAST_TRIED, Evidence, Verdict, judge, ratesOf, verdictOfStages
from openmmhelfrich.cli import app
from openmmhelfrich.pictures.report import writeReport
from openmmhelfrich.runs import sweeps
from openmmhelfrich.runs.checkpoint import verdictOf
from openmmhelfrich.runs.grids import coarsePoints, readGrid
from openmmhelfrich.sampling import minimization
from openmmhelfrich.sampling.moves import Counters
from openmmhelfrich.tables import Table

SPHERE = 8 * np.pi * 20  # its bending energy in kT


def rowsOf(count=40, **columns):
    """Return a table of a vesicle in equilibrium at a reduced volume of 0.95."""
    noise = np.random.default_rng(1).normal(size=(3, count))
    area, volume = 12.55 * (1 + 3e-4 * noise[0]), 3.97 * (1 + 3e-4 * noise[1])
    rows = {
        "step": np.arange(count),
        "E_bending": SPHERE * (1.75 + 0.01 * noise[2]),
        "area": area,
        "volume": volume,
        "reducedVolume": 6 * np.sqrt(np.pi) * volume / area**1.5,
        "stage": np.ones(count),
        "window": np.zeros(count),
        "equilibrated": np.ones(count),
        "targetArea": np.full(count, 12.55),
        "targetVolume": np.full(count, 3.97),
    }
    return Table(rows | columns)


def ellipsoid():
    mesh = mh.Mesh.icosphere(3)
    return mh.Mesh(mesh.vertices * [1.25, 0.9, 0.9], mesh.triangles)


def moved(mesh, vertex, position):
    vertices = mesh.vertices.copy()
    vertices[vertex] = position
    return mh.Mesh(vertices, mesh.triangles)


def collapsed(mesh, count):
    """Return a mesh whose first vertices are each where a neighbor is."""
    vertices = mesh.vertices.copy()
    for vertex in range(count):
        vertices[vertex] = vertices[mesh.edges[mesh.edges[:, 0] == vertex][0, 1]]
    return mh.Mesh(vertices, mesh.triangles)


def dented(depth, subdivisions=3):
    """Return a sphere with a cap that is mirrored, so that it has a sharp rim."""
    mesh = mh.Mesh.icosphere(subdivisions)
    x, y, z = mesh.vertices.T
    return mh.Mesh(np.column_stack((x, y, np.where(z > depth, 2 * depth - z, z))), mesh.triangles)


def dimpled():
    """Return a sphere with a dent at each of twelve places."""
    mesh, twelve = mh.Mesh.icosphere(3), mh.Mesh.icosphere(0).vertices
    nearest = (mesh.vertices @ twelve.T).max(axis=1)
    return mh.Mesh(mesh.vertices * (1 - 0.2 * np.clip((nearest - 0.8) / 0.2, 0, 1))[:, np.newaxis], mesh.triangles)


MESH, RAMP = ellipsoid(), np.linspace(-1, 1, 40)
NEIGHBOR = MESH.triangles[0, 1]
GOOD = Evidence(
    rows=rowsOf(),
    mesh=MESH,
    moduli={"bending": 20.0, "area": 1e6, "volume": 1e6, "areaDifference": 0.0, "tether": 50.0, "repulsion": 0.0},
    acceptance=0.75,
    divergence=0.0,
    flipAcceptance=0.07,
    stepSize=5e-4,
    timeScale=6e-4,
    moved=2.0,
    fall=0.0,
    excess=2.0,
)
FOUND = [
    ("finite numbers", "failed", {"rows": rowsOf(energy=np.full(40, np.nan))}),
    ("equilibrated rows", "doubtful", {"rows": rowsOf(equilibrated=np.zeros(40))}),
    ("targets", "doubtful", {"rows": rowsOf(targetVolume=np.full(40, 3.92))}),
    ("targets", "failed", {"rows": rowsOf(targetVolume=np.full(40, 2.4))}),
    ("targets", "doubtful", {"rows": rowsOf(targetVolume=np.full(40, 2.4)), "moduli": GOOD.moduli | {"volume": 100.0}}),
    ("acceptance of trajectories", "doubtful", {"acceptance": 0.1}),
    ("acceptance of trajectories", "failed", {"acceptance": 0.0}),
    ("acceptance of trajectories", "doubtful", {"acceptance": None, "few": {"trajectories": (1, 4)}}),
    ("acceptance of trajectories", "doubtful", {"acceptance": None, "few": {"trajectories": (0, 0)}}),
    ("acceptance of late trajectories", "doubtful", {"lately": (1, 22)}),
    ("acceptance of late trajectories", "failed", {"lately": (0, 150)}),
    ("diverged trajectories", "doubtful", {"divergence": 0.05}),
    ("diverged trajectories", "failed", {"divergence": 1.0}),
    ("acceptance of flips", "doubtful", {"flipAcceptance": 5e-4}),
    ("acceptance of flips", "failed", {"flipAcceptance": 0.0}),
    ("acceptance of flips", "doubtful", {"flipAcceptance": None, "few": {"flips": (0, 900)}}),
    ("step size", "doubtful", {"stepSize": 6e-6}),
    ("step size", "failed", {"stepSize": 1e-10}),
    ("displacement", "doubtful", {"moved": 0.05}),
    ("displacement", "failed", {"moved": 0.0}),
    ("bending energy", "doubtful", {"rows": rowsOf(E_bending=np.full(40, 4.0 * SPHERE))}),
    ("bending energy", "failed", {"rows": rowsOf(E_bending=np.full(40, 31.0 * SPHERE))}),
    ("bound of the continuum", "doubtful", {"rows": rowsOf(E_bending=np.full(40, SPHERE))}),
    ("bound of the continuum", "failed", {"rows": rowsOf(E_bending=np.full(40, 0.8 * SPHERE))}),
    ("folds", "doubtful", {"mesh": dented(0.3)}),
    ("folds", "failed", {"mesh": dented(0.3, 2)}),
    ("triangles without area", "doubtful", {"mesh": moved(MESH, 0, MESH.vertices[NEIGHBOR])}),
    ("triangles without area", "failed", {"mesh": collapsed(MESH, 20)}),
    ("self-intersections", "doubtful", {"mesh": moved(MESH, 0, -1.2 * MESH.vertices[0])}),
    ("rows to average", "doubtful", {"rows": rowsOf(10)}),
    ("drift", "doubtful", {"rows": rowsOf(E_bending=SPHERE * (1.75 + 0.2 * RAMP))}),
    ("minimum", "doubtful", {"fall": 0.01}),
    ("minimum", "failed", {"fall": 0.2}),
    ("forces", "doubtful", {"excess": 128.0}),
    ("forces", "doubtful", {"slack": 128.0}),
    ("symmetry", "doubtful", {"mesh": dimpled()}),
    ("acceptance of exchanges", "doubtful", {"exchanges": [(30, 100), (0, 100)]}),
    ("acceptance of exchanges", "doubtful", {"exchanges": [(1, 6), (30, 100)]}),
    ("passages through the states", "doubtful", {"passages": 0}),
]


def testWhatIsGood():
    assert judge(GOOD) == Verdict() and judge(Evidence()) == Verdict()
    assert str(judge(GOOD)) == "good"


@pytest.mark.filterwarnings("error::RuntimeWarning")
@pytest.mark.parametrize("check, level, other", FOUND)
def testWhatEachCheckFinds(check, level, other):
    found = [finding for finding in judge(replace(GOOD, **other)).findings if finding.check == check]
    assert [finding.level for finding in found] == [level]
    assert np.isfinite(found[0].value) and np.isfinite(found[0].limit)
    assert Verdict.ofData(json.loads(json.dumps(Verdict(tuple(found)).toData()))).findings == tuple(found)


def testEveryCheckIsTestedAndDescribed():
    """The page has each check with its limits, but for those that are computed."""
    page = (ROOT / "docs/reference/verdicts.md").read_text(encoding="utf-8")
    rows = {cells[1].strip(): cells for cells in (line.split("|") for line in page.splitlines()) if len(cells) == 7}
    assert {check for check, *_ in FOUND} == {check.title for check in CHECKS}
    for check in CHECKS:
        for limit, cell in ((check.doubtful, rows[check.title][3]), (check.failed, rows[check.title][4])):
            isNever = np.isinf(limit) or (check.isLeast and limit == 0)
            expected = "see below" if check.title == "targets" else "never" if isNever else f"{limit:g}"
            assert cell.strip() == expected, check.title


def testFewTriesAreJudgedByTheLeastRate():
    """Of a few, so many must be accepted that a rate below the limit is unlikely: 5% or less."""
    for accepted, tried in itertools.product(range(10), repeat=2):
        if accepted <= tried:
            few = {"acceptance": None, "few": {"trajectories": (accepted, tried)}}
            chance = sum(math.comb(tried, k) * 0.2**k * 0.8 ** (tried - k) for k in range(accepted, tried + 1))
            assert (judge(replace(GOOD, **few)).level == "good") == (chance <= 0.05), (accepted, tried)
    ten = judge(replace(GOOD, acceptance=None, few={"trajectories": (3, 7)})).findings[0]
    assert ten.what == "3 of 7 trajectories were accepted, too few to tell whether enough are"


def testARunThatFreezesIsNotGood():
    """Of the second half, so few must be accepted that a rate above the limit is unlikely: 5% or less."""
    for accepted, tried in itertools.product(range(60), repeat=2):
        if accepted <= tried:
            chance = sum(math.comb(tried, k) * 0.2**k * 0.8 ** (tried - k) for k in range(accepted + 1))
            late = judge(replace(GOOD, lately=(accepted, tried)))
            assert (late.level == "good") == (chance > 0.05), (accepted, tried)
    assert judge(replace(GOOD, lately=(0, 30))).findings[0].what == (
        "of the last 30 trajectories 0 were accepted, and 75% of all"
    )
    few = judge(replace(GOOD, acceptance=0.1, lately=(0, 30))).findings
    assert [finding.check for finding in few] == ["acceptance of trajectories"], "once is enough"


def testWhatIsNotTriedIsNotMissed():
    """Few tries are told where a move is made, and not where its probability or its fraction is 0."""
    nothing = Counters(0, 0, 0, 0, 0)
    for fraction, probability, few in ((0.3, 0.5, {"trajectories", "flips"}), (0, 0.5, {"trajectories"})):
        assert set(ratesOf(nothing, mh.HybridMonteCarloIntegrator(300, 1e-4, 10, fraction, probability))["few"]) == few
    assert set(ratesOf(nothing, mh.HybridMonteCarloIntegrator(300, 1e-4, 10, 0.3, 0))["few"]) == {"trajectories"}
    assert set(ratesOf(nothing, mh.HybridMonteCarloIntegrator(300, 1e-4, 10, 0.3, 1))["few"]) == {"flips"}
    many = ratesOf(Counters(10, 8, 1000, 70, 1), mh.HybridMonteCarloIntegrator(300, 1e-4))
    assert many == {"acceptance": 0.8, "divergence": 0.1, "flipAcceptance": 0.07, "few": {}}


def testWhatAnAdviceIs():
    """A smaller step is advised where the step is long, and not where the mesh is the cause."""
    none = {"acceptance": 0.0}
    for other, words in (
        ({"stepSize": 2e-3}, 'a smaller step_size helps, or step_size = "auto"'),
        ({"stepSize": 1e-6}, "remesh it, or minimize before sampling"),
        ({"stepSize": 2e-3, "weight": 2.0}, "a multilevel_weight below 2, or 0, helps"),
        ({"stepSize": 1e-6, "weight": 2.0}, "go with the moduli: a multilevel_weight below 2, or 0, helps"),
        ({"stepSize": 2e-3, "mesh": dented(0.3)}, "the membrane has crumpled"),
        ({"stepSize": 2e-3, "moduli": GOOD.moduli | {"tether": 0.0}}, "a tether keeps triangles well shaped"),
    ):
        found = judge(replace(GOOD, **none, **other)).findings
        (finding,) = (finding for finding in found if finding.check == "acceptance of trajectories")
        assert words in finding.advice
        isLong = "mesh" not in other and "moduli" not in other and other["stepSize"] > 1e-3
        assert ("a smaller step_size helps" in finding.advice) == isLong


@pytest.mark.parametrize(("weight", "isToBlame"), [(2, True), (0, False)])
def testAWeightTooGreatForTheModuliOfAStageIsNamed(inFolder, weight, isToBlame):
    stage = {"kind": "sample", "steps": 40, "volume_modulus": 1e8, "step_size": 1e-3}
    config = configure(mesh=3, stages=[stage], steps_per_trajectory=10, multilevel_weight=weight)
    (found,) = (each for each in mh.run(config).verdict.findings if each.check == "acceptance of trajectories")
    assert ("a multilevel_weight below 2, or 0, helps" in found.advice) == isToBlame
    assert "a smaller step_size helps" in found.advice


def testWhatIsZeroOnAverageDoesNotDrift():
    """The area difference of a sheet, whose sides are alike, may have changed its sign by chance."""
    fluctuating, drifting = 0.05 * np.sign(RAMP) + 0.01 * np.sin(40 * RAMP), 25 + RAMP
    for values, expected in ((fluctuating, []), (drifting, ["drift"])):
        found = judge(replace(GOOD, rows=rowsOf(areaDifference=values))).findings
        assert [finding.check for finding in found] == expected


def testASheetWithoutRoomForItsUndulationsIsToHaveALargerArea():
    """Its box holds it; a vesicle, or a sheet that is short of its target, has nothing to gain by that."""

    def adviceAt(ratio, mesh):
        rows = rowsOf(targetArea=np.full(40, 12.55 / ratio))
        evidence = replace(GOOD, mesh=mesh, rows=Table({n: v for n, v in rows.items() if "olume" not in n}))
        (finding,) = (each for each in judge(evidence).findings if each.check == "targets")
        return finding.advice

    sheet = mh.Mesh.sheet(8, 8, 1)
    assert "give a larger target_area" in adviceAt(1.1, sheet) and "let it be approached" in adviceAt(1.1, sheet)
    assert adviceAt(1.03, sheet).startswith("give a larger target_area or area_modulus"), "it is there already"
    for advice in (adviceAt(0.9, sheet), adviceAt(1.1, ellipsoid())):
        assert "let it be approached" in advice and "larger target_area" not in advice


def testARunThatCreepsToItsTargetsIsToHaveALargerStep():
    """Where all trajectories of a given, short step are accepted, an approach would not be what is missing."""
    rows = rowsOf(targetArea=np.full(40, 11.0))

    def adviceWith(**changes):
        found = judge(replace(GOOD, rows=rows, **changes)).findings
        return next(each.advice for each in found if each.check == "targets")

    short = adviceWith(acceptance=1.0, stepSize=1e-4, timeScale=2e-3)
    assert short.startswith('give a larger step_size, or "auto", or none: it is 0.0001 ps, where 0.002 ps go')
    assert "let it be approached" in short
    for changes in ({"acceptance": 0.3}, {"stepSize": 1e-3}, {"adaptation": "a longer burn_in"}):
        assert "step_size" not in adviceWith(**({"acceptance": 1.0, "stepSize": 1e-4, "timeScale": 2e-3} | changes))


def testAnAreaDifferenceOfTheOtherSignIsTold():
    """However soft its modulus: no way leads through 0; of a sheet, which has about 0 on average, it is not known."""
    for modulus, mean, isOther in ((1e3, -25.0, True), (1e6, -25.0, True), (1e3, 25.0, False), (10.0, -0.1, False)):
        rows = rowsOf(areaDifference=mean + RAMP, targetAreaDifference=np.full(40, 10.0))
        found = judge(replace(GOOD, rows=rows, moduli=GOOD.moduli | {"areaDifference": modulus})).findings
        told = [finding for finding in found if "its sign is not that of its target" in finding.advice]
        assert len(told) == isOther


def testTheKindOfStageSaysHowItsStepSizeComesOutBetter(inFolder, monkeypatch):
    """A burn-in is of a stage that samples, and not of one whose temperature or targets change."""
    found = []
    monkeypatch.setattr(
        "openmmhelfrich.analysis.verdict.judge", lambda evidence, checks: found.append(evidence) or judge(evidence, ())
    )
    path = {"kind": "continue", "windows": 1, "equilibration": 2, "steps": 2, "reduced_volume": 0.98}
    given = {"kind": "sample", "steps": 5, "step_size": 1e-4}
    mh.run(configure(stages=[path, {"kind": "sample", "steps": 5}, given], step_size="auto"))
    advice = [
        [
            finding.advice
            for finding in judge(replace(GOOD, divergence=0.1, stepSize=2e-3, adaptation=e.adaptation)).findings
        ]
        for e in found
    ]
    assert ["let targets and temperature change more slowly" in first for (first,) in advice] == [True, False, False]
    assert ["a longer burn_in" in first for (first,) in advice] == [False, True, False]


def pulledBy(energy):
    """Return a setup that adds a force of this energy on every vertex."""

    def setup(system, scene):
        force = mm.CustomExternalForce(energy)
        for i in range(len(scene.mesh.vertices)):
            force.addParticle(i, [])
        system.addForce(force)

    return setup


@pytest.mark.parametrize("energy, isBlamed", [("-1000*x^2", True), ("-10*x", True), ("5*x^2", False)])
def testAMinimizationThatAForceDroveTellsOfThatForce(inFolder, energy, isBlamed):
    """No more iterations, no slower way to the targets and no other mesh help where its energy has no lower bound."""
    stages = [{"kind": "minimize", "fluid": False, "max_iterations": 60}]
    verdict = mh.run(configure(stages=stages), setup=pulledBy(energy)).verdict
    words = (
        r"what is beside the membrane \(CustomExternalForce\) lost .* kT, and the membrane took up .* kT: a force of"
    )
    assert isBlamed == bool(re.search(words, str(verdict))) == (verdict.level == "failed")
    assert not isBlamed or len({finding.advice for finding in verdict.findings}) == 1 < len(verdict.findings)


def testAMinimumBesideAForceIsHeldByALargerModulus(inFolder):
    """It has come to its end, so that neither more iterations nor another way to the targets help."""
    stages = [{"kind": "minimize", "fluid": False}]
    verdict = mh.run(configure(stages=stages), setup=pulledBy("500*x^2")).verdict
    assert [finding.check for finding in verdict.findings] == ["targets", "targets"]
    words = r"minimum there, with what is beside the membrane \(CustomExternalForce\): a larger area_modulus holds it"
    assert re.search(words, str(verdict)) and "let the minimization go on" not in str(verdict)


def testAnAdviceIsShownOnceAndKeptByEachFinding():
    found = judge(replace(GOOD, divergence=0.9, lately=(0, 150), stepSize=2e-3))
    first, second = found.findings
    assert first.advice == second.advice == 'a smaller step_size helps, or step_size = "auto"'
    assert str(found).count(first.advice) == found._repr_html_().count("a smaller step_size helps") == 1


def testARepulsionThatIsThereIsToReachFurther():
    """What keeps a surface from passing through itself: a repulsion, or if it has one a larger onset."""
    for modulus, words in ((0.0, "a repulsion prevents this"), (100.0, "a larger onset of the repulsion")):
        pierced = replace(
            GOOD, mesh=moved(MESH, 0, -1.2 * MESH.vertices[0]), moduli=GOOD.moduli | {"repulsion": modulus}
        )
        (finding,) = (finding for finding in judge(pierced).findings if finding.check == "self-intersections")
        assert finding.advice.startswith(words)


def testTheRunsVerdictIsThatOfItsLastStage():
    failed, doubtful = (judge(replace(GOOD, acceptance=rate)) for rate in (0.0, 0.1))
    assert (failed.level, doubtful.level) == ("failed", "doubtful")
    titles = ["warm", "cool"]
    assert verdictOfStages(titles, {0: doubtful, 1: Verdict()}).level == "good"
    assert verdictOfStages(titles, {0: Verdict(), 1: failed}) == failed
    verdict = verdictOfStages(titles, {0: failed, 1: Verdict()})
    assert verdict.level == "doubtful" and str(verdict).startswith("doubtful\nstage 1, warm, failed: only 0.0%")
    assert verdictOfStages(titles, {0: failed}) is None


def configure(prefix="run", mesh=2, stages=None, membrane=None, **sampling):
    return {
        "mesh": {"icosphere": mesh},
        "membrane": membrane or {},
        "platform": {"threads": 1},
        "stages": stages or [{"kind": "sample", "steps": 200}],
        "sampling": {"seed": 1, "steps_per_trajectory": 50, **sampling},
        "output": {"prefix": str(prefix), "observables_interval": 5, "mesh_trajectory": False, "psf": False},
    }


COLD = [
    {"kind": "sample", "steps": 300},
    {"kind": "anneal", "steps": 300, "end_temperature": 3.0},
    {"kind": "minimize"},
]
SCENES = {
    "a vesicle": (configure(), "good", ""),
    "a deflated vesicle": (configure(membrane={"reduced_volume": 0.95}), "good", ""),
    "a soft membrane": (configure(membrane={"bending_modulus": 2, "reduced_volume": 0.95}), "good", ""),
    "no bending": (configure(membrane={"bending_modulus": 0}), "good", ""),
    "soft constraints": (configure(membrane={"area_modulus": 1e4, "volume_modulus": 1e4}), "good", ""),
    "a tension": (configure(membrane={"area_modulus": 0, "tension": 10}), "good", ""),
    "a short run": (configure(stages=[{"kind": "sample", "steps": 40}]), "doubtful", "averages are over 5 rows"),
    "a stage of few trajectories": (
        configure(stages=[{"kind": "anneal", "steps": 9, "end_temperature": 290}], step_size=2e-2, flip_probability=0),
        "doubtful",
        "0 of 9 trajectories were accepted, too few to tell whether enough are; make more steps",
    ),
    "nothing accepted": (configure(step_size=1e-2), "failed", "only 0.0% of the trajectories were accepted; a smaller"),
    "a target out of reach": (
        configure(membrane={"reduced_volume": 0.6}, approach="none"),
        "failed",
        "off its target.*let it be approached .sampling.approach, or a stage of kind approach or continue",
    ),
    "a loose minimization": (
        configure(membrane={"reduced_volume": 0.9}, stages=[{"kind": "minimize", "tolerance": 1e6}]),
        "failed",
        "off its target.*let the minimization go on [^;]*times the default tolerance, as its own is looser; a smaller",
    ),
    "a creeping step": (configure(step_size=1e-9), "failed", "the step size of 1e-09 ps creeps.*a larger step_size"),
    "a soft volume": (
        configure(membrane={"volume_modulus": 100, "reduced_volume": 0.6}),
        "doubtful",
        "modulus, 100 kT, is too soft to hold it; a larger volume_modulus",
    ),
    "no room for flips": (
        {**configure(), "tether": {"min_length": 0.29, "max_length": 0.32}},
        "failed",
        "of the flips were accepted.*wider bounds of the tether",
    ),
    "no tether": ({**configure(), "tether": {"modulus": 0.0}}, "doubtful", "a tether keeps triangles well shaped"),
    "a hasty path": (
        configure(stages=[{"kind": "continue", "windows": 5, "equilibration": 5, "steps": 5, "reduced_volume": 0.7}]),
        "failed",
        "off its target",
    ),
    "a path": (
        configure(stages=[{"kind": "continue", "windows": 4, "equilibration": 60, "steps": 40, "reduced_volume": 0.9}]),
        "good",
        "",
    ),
    "a coarse mesh": (configure(mesh=1, membrane={"reduced_volume": 0.95}, stages=COLD), "failed", "is folded by more"),
    "a fine mesh": (configure(membrane={"reduced_volume": 0.95}, stages=COLD), "good", ""),
    "a minimization that is cut short": (
        configure(stages=[{"kind": "sample", "steps": 100}, {"kind": "minimize", "max_iterations": 20}]),
        "doubtful",
        "cut short while the energy fell, by [0-9.e-]+% in the last tenth of its iterations; a larger max_iterations",
    ),
    "a minimization of one iteration": (
        configure(stages=[{"kind": "sample", "steps": 100}, {"kind": "minimize", "max_iterations": 1}]),
        "doubtful",
        "cut short while the energy fell, .*; a larger max_iterations",
    ),
    "a minimization that finds no way down": (
        {
            **configure(
                stages=[{"kind": "sample", "steps": 20}, {"kind": "minimize", "fluid": False, "reduced_volume": 0.8}]
            ),
            "tether": {"modulus": 0.0},
        },
        "doubtful",
        "found no lower energy along forces that are .* times its tolerance; more iterations do not help",
    ),
    "an icosphere and less volume": (
        configure(stages=[{"kind": "minimize", "reduced_volume": 0.9}]),
        "good",
        "",
    ),
    "an icosphere and less volume, its triangles as they are": (
        configure(stages=[{"kind": "minimize", "fluid": False, "reduced_volume": 0.9}]),
        "good",
        "",
    ),
}


def testADentedSphere(inFolder, monkeypatch):
    """Where a minimization does not leave the symmetry of its mesh, the verdict says so."""
    monkeypatch.setattr(minimization, "displacementsOut", lambda positions, *_: np.zeros(positions.shape))
    result = mh.run(configure(stages=[{"kind": "minimize", "fluid": False, "reduced_volume": 0.9}]))
    assert result.verdict.level == "doubtful"
    words = "it has kept the symmetry of the mesh that it began with, and others have less energy; begin with another"
    assert words in str(result.verdict)


@pytest.mark.parametrize("name", SCENES)
def testScenes(inFolder, name):
    config, level, words = SCENES[name]
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        result = mh.run(config)
    assert result.verdict.level == level, str(result.verdict)
    assert [str(w.message) for w in said if "verdict" in str(w.message)] == (
        [f"run: the verdict is {result.verdict}"] if level == "failed" else []
    )
    assert re.search(words, str(result.verdict))
    assert (
        dict(result.lines())["verdict"] == level
        and f"# stage {len(config['stages'])}, " in (inFolder / "run.resolved.toml").read_text()
    )
    assert verdictOf("run.checkpoint") == result.verdict


def testTooFewVerticesAreToldBefore(inFolder):
    said = []
    mh.run(configure(mesh=1), lambda study: said.append(list(study.notes)))
    assert "42 vertices are too few for a reduced volume of 0.977" in said[0][0]
    path = [{"kind": "continue", "windows": 2, "equilibration": 1, "steps": 1, "reduced_volume": 0.5}]
    notes = mh.run(configure("b", stages=path)).notes
    assert any("162 vertices are too few for a reduced volume of 0.5" in note for note in notes)
    notes = mh.run(configure("c", stages=[{"kind": "sample", "steps": 2, "reduced_volume": 0.9}])).notes
    assert not any("too few" in note for note in notes)


def testAStoppedRunHasTheSameVerdictLater(inFolder):
    def stop(study):
        if study.simulation.currentStep == 120:
            raise KeyboardInterrupt

    whole = mh.run(configure("a", step_size=1e-9))
    stopped = mh.run(configure("b", step_size=1e-9), stop)
    assert stopped.verdict is None and "verdict" not in dict(stopped.lines()) and verdictOf("b.checkpoint") is None
    assert mh.resume("b").verdict == whole.verdict


def rare(prefix, *stages):
    """Return a configuration whose table has a row every 50 steps."""
    config = configure(prefix, stages=list(stages), steps_per_trajectory=5, approach="none")
    return {**config, "output": {**config["output"], "observables_interval": 50}}


@pytest.mark.parametrize(
    ("last", "level", "checks"),
    [
        (
            {"kind": "sample", "step_size": 1.0, "reduced_volume": 0.95},
            "failed",
            {"acceptance of trajectories", "diverged trajectories", "targets", "rows to average"},
        ),
        ({"kind": "sample"}, "doubtful", {"rows to average"}),
        ({"kind": "anneal", "end_temperature": 100, "reduced_volume": 0.8}, "failed", {"folds"}),
        ({"kind": "approach", "reduced_volume": 0.98}, "good", set()),
    ],
)
def testAStageBetweenRowsIsJudgedByOneAtItsEnd(inFolder, monkeypatch, last, level, checks):
    monkeypatch.setitem(LEAST_TRIED, "flips", 10)
    result = mh.run(rare("a", {"kind": "sample", "steps": 100}, {**last, "steps": 45}))
    assert (result.table["step"][-1], result.table["stage"][-1]) == (145, 2)
    assert result.verdict.level == level and checks <= {finding.check for finding in result.verdict.findings}
    assert result.lines()[2] == ("values", "at step 145, the only row of the table to average:")
    assert "always" not in dict(result.lines())["area"]
    assert not any("on average" in finding.what for finding in result.verdict.findings)


def testTheRowOfTheStartIsNotOfTheFirstStage(inFolder):
    first = {"kind": "sample", "steps": 30, "step_size": 1.0, "reduced_volume": 0.95}
    result = mh.run(rare("a", first, {"kind": "sample", "steps": 60, "reduced_volume": 0.95}))
    assert result.table["step"].tolist() == [0, 30, 50]
    assert "targets" in [finding.check for finding in result.stageVerdicts[0][1].findings]


def testAStageThatHasARowGetsNoOther(inFolder):
    stages = {"kind": "sample", "steps": 70}, {"kind": "minimize", "max_iterations": 5}, {"kind": "sample", "steps": 79}
    assert mh.run(rare("a", *stages)).table["step"].tolist() == [0, 50, 71, 100, 150]
    assert mh.resume("a", steps=20).table["step"].tolist() == [0, 50, 71, 100, 150]


@pytest.mark.parametrize(
    ("first", "second", "line"),
    [
        (
            {"kind": "sample", "steps": 110},
            {"kind": "sample", "steps": 30},
            ("averages", "over the second half of stage 1 (sample); the table has no row of stage 2 (sample) yet:"),
        ),
        (
            {"kind": "sample", "steps": 60},
            {"kind": "minimize"},
            ("values", "at step 50, the only row of the table to average; the table has no row of stage 2"),
        ),
        (
            {"kind": "minimize"},
            {"kind": "sample", "steps": 30},
            ("values", "at the end of stage 1 (minimize); the table has no row of stage 2 (sample) yet:"),
        ),
    ],
)
def testAStoppedRunSaysOfWhichStageItsAveragesAre(inFolder, first, second, line):
    """And goes on to what it would have been."""

    def stop(study):
        if study.index == 1 and study.stage.position == 20:
            raise KeyboardInterrupt

    stages = first, {**second, "reduced_volume": 0.97}
    whole, stopped = mh.run(rare("a", *stages)), mh.run(rare("b", *stages), stop)
    assert stopped.lines()[2][0] == line[0] and stopped.lines()[2][1].startswith(line[1])
    if first["kind"] == "sample":
        rates = dict(stopped.lines())["accepted"]
        assert rates.endswith(", in stage 2 (sample)" if second["kind"] == "sample" else ", in all stages")
    mh.resume("b")
    assert whole.outputs.table.read_bytes() == stopped.outputs.table.read_bytes()


def testARunThatFreezesLateIsTold(inFolder):
    """Also where it was interrupted since, and not where all of its second half was accepted."""

    def freezeAt(step, stop=None):
        def progress(study):
            if study.simulation.currentStep >= step:
                study.simulation.integrator.setStepSize(0.02)
            if study.simulation.currentStep == stop:
                raise KeyboardInterrupt

        return progress

    whole = mh.run(configure("a"), freezeAt(90)).verdict.findings
    assert [finding.check for finding in whole] == ["diverged trajectories", "acceptance of late trajectories"]
    assert " 0 were accepted" in whole[1].what
    assert mh.run(configure("b"), freezeAt(90, stop=150)).verdict is None
    resumed = mh.resume("b", progress=freezeAt(90)).verdict.findings  # its first step is a short one
    assert [finding.check for finding in resumed] == [finding.check for finding in whole]
    assert resumed[1].what.split()[3] == whole[1].what.split()[3], "as many were tried"
    assert mh.run(configure("c")).verdict.level == "good"


def testAPathThereAndBackIsJudgedByTheModuliAtItsEnd(inFolder):
    """They are those of its beginning, with which its last window is averaged, whether it is the last stage or not."""
    path = {"kind": "continue", "windows": 2, "equilibration": 10, "steps": 30, "there_and_back": True}
    back = {**path, "bending_modulus": 200}
    result = mh.run(configure("a", stages=[back, {**path, "bending_modulus": 2.0}, {"kind": "sample", "steps": 100}]))
    levels = dict(result.stageVerdicts)
    assert result.verdict.level == "good" and {verdict.level for verdict in levels.values()} == {"good"}
    (line,) = (line for name, line in mh.run(configure("b", stages=[back])).lines() if name == "E_B/8 pi kappa")
    assert 1 < float(line.split(",")[0]) < 1.3


def testARunThatIsExtendedWhileItFreezesIsTold(inFolder):
    """What counts are the last trajectories of the whole, also if each extension is short."""

    def freeze(study):
        if study.simulation.currentStep > 100:
            study.simulation.integrator.setStepSize(0.02)

    for prefix, parts in (("a", [260]), ("b", [110, 50, 50, 50])):
        result = mh.run(configure(prefix, stages=[{"kind": "sample", "steps": parts[0]}]), freeze)
        for steps in parts[1:]:
            result = mh.resume(prefix, steps=steps, progress=freeze)
        late = [each for each in result.verdict.findings if each.check == "acceptance of late trajectories"]
        assert len(late) == 1 and int(late[0].what.split()[3]) < 0.6 * 260 / 2 + 20


def invoke(*arguments):
    return CliRunner().invoke(app, list(map(str, arguments)))


def writeConfig(name, sampling, mesh=1):
    with open(name, "w") as file:
        file.write(
            f"[mesh]\nicosphere = {mesh}\n[sampling]\nseed = 1\n{sampling}\n[output]\nobservables_interval = 2\n"
        )


def testExitCodes(inFolder):
    """A failed run keeps its files and is complete; who knows better gets 0."""
    bad = "steps = 60\nstep_size = 0.02\nsteps_per_trajectory = 10"
    writeConfig("bad.toml", bad)
    result = invoke("run", "bad.toml")
    assert result.exit_code == 3 and re.search(r"verdict  failed\n +only 0.0% of the trajectories", result.output)
    assert (inFolder / "bad_shape.png").exists()
    again = invoke("resume", "bad")
    assert again.exit_code == 3 and "is complete, at step 60 and its verdict is failed" in again.output
    assert invoke("resume", "bad", "--accept-anything").exit_code == 1  # as of any run that is complete
    assert invoke("resume", "bad", "--steps", 20).exit_code == 3
    assert invoke("resume", "bad", "--steps", 20, "--accept-anything").exit_code == 0
    quiet = invoke("run", "bad.toml", "--overwrite", "--quiet")
    assert quiet.exit_code == 3 and "the verdict is failed" in quiet.output
    accepted = invoke("run", "bad.toml", "--overwrite", "--accept-anything")
    assert accepted.exit_code == 0 and "verdict  failed" in accepted.output
    writeConfig("short.toml", "steps = 10", 2)
    short = invoke("run", "short.toml")
    assert short.exit_code == 0 and "verdict  doubtful" in short.output and "10 of 10" in short.output
    assert re.search(r"sample: step 10 of 10, .*, doubtful\n", short.output)
    assert invoke("run", "nothing.toml").exit_code == 1 and invoke("run", "--nothing").exit_code == 2


def testTheReportShowsIt(inFolder):
    writeConfig("bad.toml", "steps = 60\nstep_size = 0.02\nsteps_per_trajectory = 10")
    invoke("run", "bad.toml")
    assert invoke("report", "bad").exit_code == 0
    page = (inFolder / "bad_report.html").read_text(encoding="utf-8")
    assert '<div id="verdict" class="verdict failed"><h2>Verdict: failed</h2><ul><li>only 0.0% of the' in page
    assert "trajectories diverged" in page
    (inFolder / "bad.checkpoint").unlink()  # then table and mesh tell
    assert 'class="verdict failed"' in writeReport("bad", "b.html").read_text(encoding="utf-8")
    mh.run(configure("good"))
    page = writeReport("good", verdict=verdictOf("good.checkpoint")).read_text(encoding="utf-8")
    assert '<div id="verdict" class="verdict good"><h2>Verdict: good</h2><ul></ul>' in page


def summary(folder):
    with open(folder / "summary.csv", newline="") as file:
        return list(csv.DictReader(file))


@pytest.fixture
def scheduler():
    with LocalCluster(
        n_workers=1, threads_per_worker=2, dashboard_address="127.0.0.1:0", silence_logs="CRITICAL"
    ) as cluster:
        yield cluster.scheduler_address


def testASweepTellsOfTooFewVerticesBefore(tmp_path, scheduler):
    """Once, and which points: in a line for each number of vertices, however many points there are."""
    grid = tmp_path / "grid.toml"
    grid.write_text(
        "[base]\nsampling = {steps = 1, steps_per_trajectory = 1, seed = 1, approach = 'none'}\nplatform.threads = 1\n"
        "output.mesh_trajectory = false\n[grid]\nmesh.icosphere = [1, 2, 3]\n"
        "membrane.reduced_volume = {start = 0.5, stop = 0.95, step = 0.05}\n"
    )
    points = readGrid(grid)
    assert len(points) == 30
    notes = coarsePoints(points)
    starts = [note[: note.index(":")] for note in notes]
    assert starts == [
        "42 vertices are too few for reduced volumes of 0.8 to 0.95",
        "42 vertices are too few for reduced volumes of 0.65 to 0.75",
        "42 vertices are too few for reduced volumes of 0.5 to 0.6",
        "162 vertices are too few for reduced volumes of 0.65 to 0.75",
        "162 vertices are too few for reduced volumes of 0.5 to 0.6",
    ]
    assert notes[-1].endswith("362 or more do not (point icosphere=2,reduced_volume=0.5,seed=1 and 2 more)")
    grid.write_text(grid.read_text().replace("[1, 2, 3]", "[1]").replace("start = 0.5", "start = 0.9"))
    result = invoke("sweep", grid, "--output", tmp_path / "a", "--scheduler", scheduler)
    assert result.output.startswith("note: 42 vertices are too few for reduced volumes of 0.9 to 0.95: such a mesh")
    assert result.output.count("vertices are too few") == 1 and "(every point)" in result.output
    again = invoke("sweep", grid, "--output", tmp_path / "a", "--scheduler", scheduler)
    assert "vertices are too few" not in again.output  # nothing was left to do
    assert sweeps.sweep(grid, tmp_path / "a", scheduler).notes[0].endswith("(every point)")


def testSweepOfAFailedPoint(tmp_path, scheduler):
    """It counts as failed, with its results; only --retry failed begins it anew, with what the grid says now."""
    grid, folder = tmp_path / "grid.toml", tmp_path / "results"
    text = (
        "[base]\nmesh.icosphere = 2\nsampling = {steps = 200, steps_per_trajectory = 20, seed = 1}\n"
        "output = {observables_interval = 5, mesh_trajectory = false}\n[grid]\nsampling.step_size = [8e-4, 0.02]\n"
    )
    grid.write_text(text)

    def sweep(*options):
        return invoke("sweep", grid, "--output", folder, "--scheduler", scheduler, *options)

    result = sweep()
    assert result.exit_code == 3 and "2 points: 1 done, 1 failed" in result.output
    good, bad = summary(folder)
    assert (good["status"], good["verdict"], good["reason"]) == ("done", "good", "")
    assert (bad["status"], bad["verdict"]) == ("failed", "failed") and "trajectories were accepted" in bad["reason"]
    assert float(bad["acceptance"]) == 0 and bad["steps"] == "200"
    tables = {row["folder"]: (folder / row["folder"] / "run.csv").read_bytes() for row in (good, bad)}
    assert sweep("--accept-anything").exit_code == 0 and summary(folder) == [good, bad]
    assert sweep("--retry", "done").exit_code == 2
    grid.write_text(text.replace("steps = 200", "steps = 210"))
    assert "was begun with other settings" in sweep().output and summary(folder) == [good, bad]
    result = sweep("--retry", "failed")
    assert result.exit_code == 3 and summary(folder)[0] == good and summary(folder)[1]["steps"] == "210"
    assert (folder / good["folder"] / "run.csv").read_bytes() == tables[good["folder"]]
    seed = seedOf(folder / bad["folder"])
    assert sweeps.sweep(grid, folder, scheduler, retry="failed").points[1].verdict == "failed"
    assert seedOf(folder / bad["folder"]) != seed
    with pytest.raises(ValueError, match="retry is 'done'; it must be 'failed'"):
        sweeps.sweep(grid, folder, scheduler, retry="done")


def seedOf(folder):
    return re.search(r"seed = (\d+)", (folder / "point.toml").read_text())[1]
