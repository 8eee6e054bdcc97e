"""The stages of a run: what each does in one Monte Carlo step, as a function of how many it has made, and what it must remember.

All conditions of a step (temperature, targets, length of the trajectory) follow from its number alone.  What a stage remembers beside its number is
what was found at its start and the state of the step size's adapter: a few numbers, which a checkpoint holds.
"""

import numpy as np

from ..sampling.adaptation import AmplitudeAdapter, AmplitudeTracker, StepSizeAdapter, StepSizeTracker, stepAndAdapt
from ..sampling.continuation import ContinuationPath, absoluteTargets, currentTargets, setTargets
from ..sampling.minimization import minimize, minimizeFluid
from ..sampling.reporters import thermalEnergy
from ..sampling.schedules import ExponentialSchedule, TableSchedule, createSchedule

_TARGET_NAMES = {
    "target_area": "area",
    "target_volume": "volume",
    "reduced_volume": "reducedVolume",
    "target_area_difference": "areaDifference",
}


def createStage(settings, config, simulation, force):
    """Return the stage that one of a Config's stages describes, at its beginning."""
    return {"minimize": _Minimize, "sample": _Sample, "anneal": _Anneal, "continue": _Continue}[settings.kind](
        settings, config, simulation, force
    )


class Stage:
    """A part of a run.

    Attributes
    ----------
    title : str
        what it is called
    steps, position : int
        the number of steps or iterations, at most, and how many have been made
    unit : str
        what these are called
    isWhole : bool
        whether it is done in a single advance(), so that it can go on from its beginning only
    listen : callable
        called within a long advance(), with no arguments; if it returns True the stage stops there
    """

    unit, isWhole = "step", False

    def __init__(self, settings, config, simulation, force):
        self.title, self.steps, self.position, self.listen = settings.title, settings.totalSteps, 0, lambda: False
        self._settings, self._config, self._simulation, self._force = settings, config, simulation, force
        self._startTargets = currentTargets(simulation.context, force)
        self._startCounters = self._counters()
        self._adapter, self._waveAdapter = self._createAdapter(), self._createWaveAdapter()

    @property
    def isDone(self):
        return self.position >= self.steps

    def window(self):
        """Return the number of the window of a path that the present step belongs to, and whether that is equilibrated: not part of a burn-in."""
        return 0, not self._isAdapting(self.position)

    def acceptance(self):
        """Return the fractions of trajectories and of flips accepted since the stage began."""
        counts = np.subtract(self._counters(), self._startCounters)
        return counts[1] / max(counts[0], 1), counts[3] / max(counts[2], 1)

    def getState(self):
        """Return what the stage remembers, fit for JSON."""
        return {
            "position": self.position,
            "startTargets": self._startTargets,
            "startCounters": self._startCounters,
            "adapter": self._adapter and self._adapter.getState(),
            "waveAdapter": self._waveAdapter and self._waveAdapter.getState(),
        }

    def setState(self, state):
        """Go on from a state that getState() returned."""
        self.position, self._startTargets, self._startCounters = (
            state["position"],
            state["startTargets"],
            state["startCounters"],
        )
        self._adapter, self._waveAdapter = self._createAdapter(), self._createWaveAdapter()
        if self._adapter:
            self._adapter.setState(state["adapter"])
        if self._waveAdapter:
            self._waveAdapter.setState(state["waveAdapter"])

    def notes(self):
        """Return what is worth telling at the end of the stage."""
        trajectories, *_, diverged = np.subtract(self._counters(), self._startCounters)
        if diverged <= 0.01 * trajectories:  # they were rejected, as they should be
            return []
        return [
            f"{self.title}: {diverged} of {trajectories} trajectories diverged and were rejected; a smaller step_size avoids this"
        ]

    def _counters(self):
        integrator = self._simulation.integrator
        flips = integrator.getFlipIntegrator()
        return [
            integrator.getNumTrajectories(),
            integrator.getNumAcceptedTrajectories(),
            flips.getNumAttempted(),
            flips.getNumAccepted(),
            integrator.getNumDivergedTrajectories(),
        ]

    def _endTargets(self):
        given = {_TARGET_NAMES[name]: getattr(self._settings, name) for name in self._settings.targetNames()}
        return absoluteTargets(given, self._startTargets) if given else {}

    def _createAdapter(self):
        return None

    def _createWaveAdapter(self):
        return None

    @property
    def _adapters(self):
        return [adapter for adapter in (self._adapter, self._waveAdapter) if adapter is not None]

    def _isAdapting(self, n):
        return len(self._adapters) > 0


class _Minimize(Stage):
    """A minimum of the energy.  It is found as a whole: a run that is stopped meanwhile begins it anew, from the checkpoint at its beginning."""

    unit, isWhole = "iteration", True

    def __init__(self, *arguments):
        super().__init__(*arguments)
        self.steps, self._result, self._energy = self._settings.max_iterations, None, 0.0

    @property
    def isDone(self):
        return self._result is not None

    def advance(self):
        """Minimise, and count this as a step."""
        simulation, settings = self._simulation, self._settings
        setTargets(simulation.context, self._force, self._endTargets())
        tolerance = settings.tolerance and settings.tolerance * thermalEnergy(self._config.sampling.temperature)
        isStopped = False

        def progress(iterations, energy):
            nonlocal isStopped
            self.position, self._energy = iterations, energy
            isStopped = self.listen()
            return isStopped

        search = minimizeFluid if settings.fluid else minimize
        result = search(simulation, self._force, tolerance, settings.max_iterations, progress)
        if not isStopped:
            simulation.context.setStepCount(simulation.currentStep + 1)
            self._result = [
                f"{self.title}: {result.reason}, after {result.iterations} iterations{f' and {result.flips} flips' if settings.fluid else ''}",
                *(f"{self.title}: {warning}" for warning in result.warnings),
            ]

    def status(self, energy):
        """Return the energy of the present iteration, in a few words."""
        return f"energy {self._energy / thermalEnergy(self._config.sampling.temperature):.6g} kT"

    def getState(self):
        return {**super().getState(), "result": self._result}

    def setState(self, state):
        super().setState(state)
        self._result = state["result"]

    def notes(self):
        return self._result


class _MonteCarlo(Stage):
    """A number of Monte Carlo steps, whose conditions are functions of the step."""

    WAVE_ADAPTER = AmplitudeTracker

    def advance(self):
        """Make a Monte Carlo step."""
        n, simulation = self.position, self._simulation
        simulation.integrator.setTemperature(self._temperature(n))
        setTargets(simulation.context, self._force, self._targets(n))
        if self._isAdapting(n):
            stepAndAdapt(simulation, self._adapter, self._waveAdapter)
        else:
            simulation.step(1)
        self.position += 1
        self._stepped()

    def status(self, energy):
        """Return an energy, in kT, and the rates of acceptance of the stage, in a few words."""
        trajectories, flips = self.acceptance()
        return f"energy {energy():.0f} kT, accepted {trajectories:.0%}, flips {flips:.0%}"

    def _createWaveAdapter(self):
        sampling = self._config.sampling
        if sampling.shear_wave_probability == 0 or sampling.shear_wave_amplitude != "auto":
            return None
        return self.WAVE_ADAPTER(self._simulation.integrator.getShearWaveIntegrator().getAmplitude())

    def _temperature(self, n):
        return self._settings.temperature or self._config.sampling.temperature

    def _targets(self, n):
        return self._endTargets() if n == 0 else {}

    def _stepped(self):
        pass


class _Sample(_MonteCarlo):
    """Constant conditions; an automatic step size or amplitude adapts in the burn-in."""

    WAVE_ADAPTER = AmplitudeAdapter

    def _createAdapter(self):
        sampling, integrator = self._config.sampling, self._simulation.integrator
        stepSize = self._settings.step_size or sampling.step_size
        if stepSize != "auto":
            integrator.setStepSize(stepSize)
            return None
        return StepSizeAdapter(integrator.getStepSize(), sampling.target_acceptance)

    def _isAdapting(self, n):
        return not all(adapter.isFrozen for adapter in self._adapters)

    def _stepped(self):
        isBurnedIn = self.position >= burnIn(self._config.sampling, self.steps) and all(
            adapter.isReady for adapter in self._adapters
        )
        if self._isAdapting(self.position) and isBurnedIn:
            if self._adapter:
                self._simulation.integrator.setStepSize(self._adapter.freeze())
            if self._waveAdapter:
                self._simulation.integrator.getIntegrator(2).setAmplitude(self._waveAdapter.freeze())
            self._startCounters = self._counters()  # the acceptance is that of the step size that was chosen

    def notes(self):
        notes = []
        for adapter in self._adapters:
            value = f"{adapter.stepSize:.4g} {self._config.mesh.length_unit if adapter is self._waveAdapter else 'ps'}"
            notes.append(
                f"{self.title}: {adapter.QUANTITY} {value}, chosen for an acceptance of {adapter.acceptance:.0%}"
                if adapter.isFrozen
                else f"{self.title}: the burn-in has not ended, or was too short, and no {adapter.QUANTITY} has been chosen; it is {value}"
            )
        return [*notes, *super().notes()]


class _Anneal(_MonteCarlo):
    """A temperature that follows a schedule; the step size keeps the acceptance."""

    def __init__(self, *arguments):
        super().__init__(*arguments)
        self._schedule = createSchedule(self._createSchedule())

    def _createSchedule(self):
        settings, temperature = self._settings, self._config.sampling.temperature
        if settings.table is not None:
            return TableSchedule(*zip(*settings.table))
        start, first = settings.start_temperature or temperature, settings.cooling_start
        if settings.rate is not None:
            return ExponentialSchedule(start, settings.rate, settings.end_temperature, first)
        return ExponentialSchedule.over(settings.steps - first, start, settings.end_temperature, first)

    def _temperature(self, n):
        return self._schedule(n)

    def _createAdapter(self):
        return StepSizeTracker(self._simulation.integrator.getStepSize(), self._config.sampling.target_acceptance)

    def window(self):
        return 0, True


class _Continue(_MonteCarlo):
    """Targets that move window by window; an automatic step size follows while each window equilibrates."""

    def __init__(self, *arguments):
        super().__init__(*arguments)
        self._path = self._createPath()

    @property
    def lambdas(self):
        return self._path.lambdas

    def setState(self, state):
        super().setState(state)
        self._path = self._createPath()

    def _createPath(self):
        s = self._settings
        path = {_TARGET_NAMES[name].replace("reducedVolume", "volume"): values for name, values in s.path.items()}
        return ContinuationPath(self._startTargets, self._endTargets(), s.windows, s.there_and_back, path)

    def _place(self, n):
        return divmod(n, self._settings.equilibration + self._settings.steps)

    def _targets(self, n):
        window, step = self._place(n)
        return self._path.targets(window) if step == 0 else {}

    def _createAdapter(self):
        sampling, integrator = self._config.sampling, self._simulation.integrator
        if sampling.step_size != "auto":
            integrator.setStepSize(sampling.step_size)
            return None
        return StepSizeTracker(integrator.getStepSize(), sampling.target_acceptance)

    def _isAdapting(self, n):
        return super()._isAdapting(n) and self._place(n)[1] < self._settings.equilibration

    def window(self):
        window, step = self._place(min(self.position, self.steps - 1))
        return window, step >= self._settings.equilibration


def burnIn(sampling, steps):
    """Return the number of steps of a stage during which an automatic step size adapts."""
    return sampling.burn_in or min(steps // 5, 1000)
