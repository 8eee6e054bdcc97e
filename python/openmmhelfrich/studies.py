"""A run from a configuration to its results."""
import time

from openmm import app

from .outputs import Outputs
from .pictures import drawMesh, plotObservables
from .psf import writePSF
from .reporters import ObservablesReporter
from .simulation import createForce, createSimulation, currentMesh, loadMesh
from .summary import summarise


def run(config, progress=None):
    """Do everything that a Config asks for and return a Summary.

    Parameters
    ----------
    config : Config
        what to do; the seed and the step size that were chosen are filled in
    progress : callable, optional
        called now and then with the Simulation and a dict of its observables.  KeyboardInterrupt ends the run early, and
        its results are complete up to there

    Raises
    ------
    ValueError, OSError, openmm.OpenMMException
        if the mesh, the configuration, the platform or the place for the results will not do; no file has been touched then
    """
    mesh, outputs = loadMesh(config), Outputs.of(config)
    force = createForce(config, mesh)
    simulation = createSimulation(config, mesh, force)
    outputs.prepare(config.mesh.file, config.output.overwrite)
    writePSF(outputs.topology, simulation.topology, config.sampling.mass)
    observables = _addReporters(simulation, force, config, outputs, progress)
    observables.report(simulation, None)  # the table begins with the start
    start, interrupted = time.perf_counter(), False
    try:
        simulation.step(config.sampling.steps)
    except KeyboardInterrupt:
        interrupted = True
    seconds = time.perf_counter()-start
    observables.close()
    simulation.reporters.clear()
    summary = summarise(config, outputs, simulation, force, seconds, interrupted)
    _draw(currentMesh(simulation, force), summary)
    return summary


class _ProgressReporter:
    """Calls a function at an interval with the Simulation and its observables."""

    def __init__(self, reportInterval, observe, progress):
        self._reportInterval, self._observe, self._progress = reportInterval, observe, progress

    def describeNextReport(self, simulation):
        steps = self._reportInterval-simulation.currentStep % self._reportInterval
        return {"steps": steps, "periodic": None, "include": []}

    def report(self, simulation, state):
        self._progress(simulation, self._observe(simulation))


def _addReporters(simulation, force, config, outputs, progress):
    steps, output = config.sampling.steps, config.output
    observables = ObservablesReporter(outputs.table, min(output.observables_interval, steps), force,
                                      config.sampling.temperature, config.mesh.length_unit)
    simulation.reporters.append(app.DCDReporter(str(outputs.trajectory), min(output.trajectory_interval, steps)))
    simulation.reporters.append(observables)
    if progress is not None:
        simulation.reporters.append(_ProgressReporter(max(1, steps//200), observables.observe, progress))
    return observables


def _draw(mesh, summary):
    lengthUnit, outputs = summary.config.mesh.length_unit, summary.outputs
    mesh.write(outputs.mesh)
    plotObservables(summary.table, outputs.plot, lengthUnit)
    drawMesh(mesh, outputs.picture, lengthUnit)
