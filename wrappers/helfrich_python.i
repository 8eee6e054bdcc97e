// What the classes have in Python only.

%pythonbegin %{
import copy
import dataclasses
import difflib
import inspect

from .installation import PLATFORMS, InstallationError, explained, explainLoading, libraryFiles

with explained():
    import numpy
    import openmm
    from openmm import unit
%}

%pythoncode %{
@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class HelfrichSurfaceGeometry:
    """The geometry of a connected surface.

    Attributes
    ----------
    area : Quantity
        area A, in nm^2
    volume : Quantity
        enclosed volume V, in nm^3, positive when the triangles are counter-clockwise seen from outside
    areaDifference : Quantity
        area difference between the leaflets, 2hM, in nm^2
    integratedMeanCurvature : Quantity
        integrated mean curvature M, in nm: 4 pi R on a sphere
    """
    area: unit.Quantity
    volume: unit.Quantity
    areaDifference: unit.Quantity
    integratedMeanCurvature: unit.Quantity

    def __repr__(self):
        return f"<{type(self).__name__}: {self._describe()}>"

    def _describe(self):
        names = {'area': 2, 'volume': 3, 'areaDifference': 2, 'integratedMeanCurvature': 1}
        return ', '.join(f"{name} {_text(getattr(self, name), unit.nanometer**power)}" for name, power in names.items())


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class HelfrichGeometry(HelfrichSurfaceGeometry):
    """The geometry of a membrane.

    The numbers are the sums over its connected surfaces.  The arrays have one element a vertex, in ascending order of
    the particles' indices.

    Attributes
    ----------
    area, volume, areaDifference, integratedMeanCurvature : Quantity
        see :class:`HelfrichSurfaceGeometry`
    vertexAreas : Quantity
        array of the vertices' areas, a third of that of their triangles, in nm^2; they add up to the total area
    vertexMeanCurvatures : Quantity
        array of the vertices' integrated mean curvatures, in nm; they add up to the integrated mean curvature
    surfaces : tuple of HelfrichSurfaceGeometry
        each connected surface, in the order of their first triangles
    """
    vertexAreas: unit.Quantity
    vertexMeanCurvatures: unit.Quantity
    surfaces: tuple

    def _describe(self):
        return f"{super()._describe()}, {len(self.vertexAreas)} vertices, surfaces: {len(self.surfaces)}"

    @classmethod
    def _fromNumbers(cls, *numbers):
        def withUnits(values):
            return map(unit.Quantity, values, (unit.nanometer**power for power in (2, 3, 2, 1, 2, 1)))

        *sums, surfaces = numbers
        return cls(*withUnits(sums), tuple(HelfrichSurfaceGeometry(*withUnits(surface)) for surface in surfaces))


# The units of arguments, by their names.  What is not here has no dimension.
_UNITS = {
    "modulus": unit.kilojoule_per_mole,
    "area": unit.nanometer**2,
    "volume": unit.nanometer**3,
    "areaDifference": unit.nanometer**2,
    "separation": unit.nanometer,
    "length": unit.nanometer,
    "minLength": unit.nanometer,
    "maxLength": unit.nanometer,
    "onset": unit.nanometer,
    "tension": unit.kilojoule_per_mole / unit.nanometer**2,
    "pressure": unit.kilojoule_per_mole / unit.nanometer**3,
    "bendingModulus": unit.kilojoule_per_mole,
    "spontaneousCurvature": unit.nanometer**-1,
    "gaussianModulus": unit.kilojoule_per_mole,
    "lineTension": unit.kilojoule_per_mole / unit.nanometer,
    "energy": unit.kilojoule_per_mole,
    "chemicalPotential": unit.kilojoule_per_mole,
    "temperature": unit.kelvin,
    "stepSize": unit.picosecond,
    "size": unit.picosecond,
    "amplitude": unit.nanometer,
    "minWaveNumber": unit.nanometer**-1,
    "maxWaveNumber": unit.nanometer**-1,
}
_DIMENSIONS = {
    unit.kilojoule_per_mole: "an energy, in kJ/mol",
    unit.nanometer: "a length, in nm",
    unit.nanometer**2: "an area, in nm^2",
    unit.nanometer**3: "a volume, in nm^3",
    unit.nanometer**-1: "an inverse length, in 1/nm",
    unit.kilojoule_per_mole / unit.nanometer: "an energy per length, in kJ/mol/nm",
    unit.kilojoule_per_mole / unit.nanometer**2: "an energy per area, in kJ/mol/nm^2",
    unit.kilojoule_per_mole / unit.nanometer**3: "an energy per volume, in kJ/mol/nm^3",
    unit.kelvin: "a temperature, in K",
    unit.picosecond: "a time, in ps",
}


def _toNumber(caller, argument, value):
    """Get an argument as a number in its unit."""
    wanted = _UNITS.get(argument, unit.dimensionless)
    isQuantity = unit.is_quantity(value)
    if not isQuantity or value.unit.is_compatible(wanted):
        number = value.value_in_unit(wanted) if isQuantity else value
        if hasattr(number, '__float__') and numpy.ndim(number) == 0:
            return float(number)
    error, shown = (ValueError, value) if isQuantity else (TypeError, repr(value))
    what = f", or a Quantity of {_DIMENSIONS[wanted]}" if argument in _UNITS else " without a unit"
    raise error(f"{caller}: {argument} is {shown}; it must be a number{what}")


def _bind(function, args, kwargs):
    """Call a function with the arguments of HybridMonteCarloIntegrator(), of which a TypeError names those that are not
    the function's.
    """
    known = {name.lower(): name for name in inspect.signature(function).parameters}
    for name in kwargs:
        if name not in known.values():
            match = difflib.get_close_matches(name.replace('_', '').lower(), known, n=1)
            hint = f"did you mean '{known[match[0]]}'?" if match else f"it has {', '.join(known.values())}"
            raise TypeError(f"HybridMonteCarloIntegrator: there is no argument '{name}'; {hint}")
    try:
        return function(*args, **kwargs)
    except TypeError as error:
        raise TypeError(str(error).replace(function.__name__, 'HybridMonteCarloIntegrator')) from None


def _cast(cls, object):
    if isinstance(object, cls):
        return object
    result = cls._downcast(object)
    if result is None:
        raise TypeError(f"{cls.__name__}.cast: the object, a {type(object).__name__}, is not a {cls.__name__}")
    result.thisown = object.thisown
    object.thisown = False
    return result


def _duplicate(cls, original):
    duplicate = cls.cast(openmm.XmlSerializer.clone(original))
    duplicate.__class__ = original.__class__
    duplicate.__dict__.update(copy.deepcopy({key: value for key, value in original.__dict__.items() if key != 'this'}))
    return duplicate


def _text(value, standard):
    """Return a number or a Quantity in a few digits, with its unit."""
    number = value.value_in_unit(standard) if unit.is_quantity(value) else value
    return f"{number:.5g} {standard.get_symbol().replace('**', '^')}"


def _describeHelfrichForce(force):
    energy, length = unit.kilojoule_per_mole, unit.nanometer
    moduli = {
        'bending': (force.getBendingModulus(), energy),
        'area': (force.getAreaModulus(), energy),
        'volume': (force.getVolumeModulus(), energy),
        'area difference': (force.getAreaDifferenceModulus(), energy),
        'tether': (force.getTether()[0], energy),
        'repulsion': (force.getRepulsion()[0], energy),
        'tension': (force.getTension(), energy/length**2),
        'pressure': (force.getPressure(), energy/length**3),
        'spontaneous curvature': (force.getSpontaneousCurvature(), length**-1),
        'Gaussian': (force.getGaussianModulus(), energy),
    }
    terms = [
        f"{name} {_text(modulus, standard)}" for name, (modulus, standard) in moduli.items() if modulus._value != 0
    ]
    species = [f"{force.getNumSpecies()} species"] if force.getNumSpecies() > 0 else []
    return ', '.join([f"{force.getNumTriangles()} triangles", *species, *terms])


def _describeTrajectories(integrator):
    step = _text(integrator.getStepSize(), unit.picosecond)
    return f"trajectories of {integrator.getStepsPerTrajectory()} steps of {step}"


def _describeFlips(integrator):
    return f"sweeps of flips over {integrator.getFraction():.3g} of the edges"


def _describeWaves(integrator):
    return f"{integrator.getMovesPerStep()} shear waves of {_text(integrator.getAmplitude(), unit.nanometer)}"


def _describeExchanges(integrator):
    kind = {'neighbors': 'exchanges of neighbors', 'anywhere': 'exchanges anywhere', 'mutation': 'mutations'}
    return f"sweeps of {kind[integrator.getProposal()]} over {integrator.getFraction():.3g} of the edges"


def _describeMixture(integrator):
    def describe(index):
        move = integrator.getMove(index)
        kind = type(move).__name__
        text = _DESCRIPTIONS[kind](move) if kind in _DESCRIPTIONS else kind
        return f"{100*integrator.getMoveProbability(index):.3g}% {text}"

    return ', '.join(map(describe, range(integrator.getNumMoves())))


_DESCRIPTIONS = {
    'HelfrichForce': _describeHelfrichForce,
    'CustomTrajectoryIntegrator': _describeTrajectories,
    'EdgeFlipIntegrator': _describeFlips,
    'HamiltonianTrajectoryIntegrator': _describeTrajectories,
    'HybridMonteCarloIntegrator': _describeMixture,
    'ShearWaveIntegrator': _describeWaves,
    'SpeciesExchangeIntegrator': _describeExchanges,
}


def _represent(object, name):
    """Return what an object of a class is, in a line."""
    head = f" {object.getName()!r}" if name == 'HelfrichForce' else _describeTemperature(object)
    return f"<{type(object).__name__}{head}: {_DESCRIPTIONS[name](object)}>"


def _describeTemperature(integrator):
    try:
        return f" at {_text(integrator.getTemperature(), unit.kelvin)}"
    except openmm.OpenMMException:  # a mixture none of whose moves has one
        return ''


def _trajectoryArguments(temperature, stepSize, stepsPerTrajectory=100, flipFraction=0.3, flipProbability=0.5,
                         engine='native'):
    return temperature, stepSize, stepsPerTrajectory, flipFraction, flipProbability, engine


def _requireOwned(integrator):
    if not getattr(integrator, 'thisown', True):
        raise ValueError(f"HybridMonteCarloIntegrator: the {type(integrator).__name__} belongs to another integrator "
                         "already")


def _integratorArguments(trajectory, flips=None, flipProbability=0.5):
    _requireOwned(trajectory)
    _requireOwned(flips)
    if trajectory is flips:
        raise ValueError(f"HybridMonteCarloIntegrator: the {type(flips).__name__} belongs to another integrator "
                         "already: it is given twice")
    return trajectory, flips, flipProbability


_MOVES = []


def _loadPlugins():
    """Load the kernels that OpenMM did not load when it was imported: where OPENMM_PLUGIN_DIR names another folder,
    where OpenMM is installed in another one, or where something is wrong, which is then said.
    """
    platforms = map(openmm.Platform.getPlatform, range(openmm.Platform.getNumPlatforms()))
    lacking = [p.getName() for p in platforms if not p.supportsKernels(['CalcHelfrichForce'])]
    for platform, file in zip(PLATFORMS, libraryFiles()[1:]):
        try:
            if platform in lacking:
                openmm.Platform.loadPluginLibrary(file)
        except openmm.OpenMMException as error:
            raise InstallationError(explainLoading(str(error))) from None

_loadPlugins()
%}

// What ends a long step early.
%{
#include "openmmhelfrich/internal/Interruption.h"

static PyObject* stepListener = NULL;

/**
 * Let handlers of signals run, which wait while C++ does, and then the listener.
 *
 * @return whether one of them raised an exception
 */
static bool isInterrupted() {
    PyGILState_STATE state = PyGILState_Ensure();
    bool result = (PyErr_CheckSignals() != 0);
    if (!result && stepListener != NULL) {
        PyObject* answer = PyObject_CallNoArgs(stepListener);
        result = (answer == NULL);
        Py_XDECREF(answer);
    }
    PyGILState_Release(state);
    return result;
}
%}

%init %{
HelfrichPlugin::Interruption::setQuestion(isInterrupted);
%}

%inline %{
static void _setStepListener(PyObject* listener) {
    Py_INCREF(listener);
    Py_XDECREF(stepListener);
    stepListener = listener;
}
%}

// Plugin classes come back from OpenMM as their base class: cast() gives the object its own.
%define HELFRICH_CLASS(Class, Base)
%extend HelfrichPlugin::Class {
    static HelfrichPlugin::Class* _downcast(OpenMM::Base* object) {
        return dynamic_cast<HelfrichPlugin::Class*>(object);
    }
%pythoncode {
    @staticmethod
    def cast(object):
        """Get the Class that an openmm.Base is.

        Methods of OpenMM itself, such as System.getForce() and XmlSerializer.deserialize(), return objects of this
        class as an openmm.Base.  If the argument owns the underlying object, the result takes over its ownership.

        Parameters
        ----------
        object : openmm.Base
            the object to cast

        Returns
        -------
        Class
            the same object; a TypeError is raised if it is of another class
        """
        return _cast(Class, object)

    @staticmethod
    def isinstance(object):
        """Get whether an object is a Class, whatever the type that Python gives it, so that cast() can be used.

        Parameters
        ----------
        object : object
            the object to test
        """
        return isinstance(object, openmm.Base) and Class._downcast(object) is not None

    def __setstate__(self, xml):
        self.this = Class.cast(openmm.XmlSerializer.deserialize(xml)).this

    def __copy__(self):
        return _duplicate(Class, self)

    def __repr__(self):
        return _represent(self, "Class")
}
}
%enddef
HELFRICH_CLASS(HelfrichForce, Force)

// Moves, for HybridMonteCarloIntegrator.getMove() to find the class of one.
%define HELFRICH_MOVE(Class)
HELFRICH_CLASS(Class, Integrator)
%pythoncode {
_MOVES.append("Class")
}
%enddef
HELFRICH_MOVE(CustomTrajectoryIntegrator)
HELFRICH_MOVE(EdgeFlipIntegrator)
HELFRICH_MOVE(HamiltonianTrajectoryIntegrator)
HELFRICH_MOVE(HybridMonteCarloIntegrator)
HELFRICH_MOVE(ShearWaveIntegrator)
HELFRICH_MOVE(SpeciesExchangeIntegrator)

%feature("shadow") HelfrichPlugin::HybridMonteCarloIntegrator::HybridMonteCarloIntegrator %{
    def __init__(self, *args, **kwargs):
        """__init__(self, temperature, stepSize, stepsPerTrajectory=100, flipFraction=0.3, flipProbability=0.5, \
        engine='native')
        __init__(self, trajectory, flips=None, flipProbability=0.5)

        Create a HybridMonteCarloIntegrator, either with Hybrid Monte Carlo trajectories or with those of another
        integrator.

        Parameters
        ----------
        temperature : float or Quantity
            the temperature of trajectories and flips, in Kelvin
        stepSize : float or Quantity
            the size of a leapfrog step, in ps
        stepsPerTrajectory : int
            the number of leapfrog steps in a trajectory
        flipFraction : float
            the number of attempts in a sweep, as a fraction of the number of edges
        flipProbability : float
            the probability that a step is a sweep of flips and not a trajectory
        engine : str
            'native' for a HamiltonianTrajectoryIntegrator, 'custom' for a CustomTrajectoryIntegrator
        trajectory : openmm.Integrator
            the integrator that makes the trajectories; this object takes over its ownership
        flips : EdgeFlipIntegrator, optional
            the integrator that flips edges; this object takes over its ownership
        """
        ownsIntegrators = ('trajectory' in kwargs or any(isinstance(arg, openmm.Integrator) for arg in args))
        function = _integratorArguments if ownsIntegrators else _trajectoryArguments
        arguments = _bind(function, args, kwargs)
        _helfrich.HybridMonteCarloIntegrator_swiginit(self, _helfrich.new_HybridMonteCarloIntegrator(*arguments))
        if ownsIntegrators:
            for integrator in filter(None, arguments[:2]):
                integrator.thisown = False
%}
