// What a HybridMonteCarloIntegrator has in Python only: the methods of its moves, under their own names or, where one
// integrator made all moves, under others.

%pythoncode %{
# Settings of a HamiltonianTrajectoryIntegrator, and the one value that other integrators in its place have.
_TRAJECTORY_SETTINGS = {
    'StepsPerTrajectory': ('the number of steps per trajectory', 1),
    'ForcePrecision': ('the precision of forces', 'double'),
    'TrajectoryJitter': ('the jitter of trajectories', 0.0),
    'Splitting': ('the splitting', 'leapfrog'),
    'TetherSubsteps': ('the number of substeps of the tether', 1),
    'MomentumRefreshment': ('the refreshment of momenta', 1.0),
    'MultilevelWeight': ('the multilevel weight', 0.0),
}


class _Mixture:
    """The part of HybridMonteCarloIntegrator that asks its moves: a method that it lacks is that of the first move that
    has it.
    """

    def __getattr__(self, name):
        move = None if name.startswith('_') or name == 'this' else self._findMove(name)
        if move is None:
            raise AttributeError(f"'{type(self).__name__}' object has no attribute '{name}'")
        return getattr(move, name)

    def __dir__(self):
        ofMoves = (name for move in self._moves() for name in dir(move) if not name.startswith('_'))
        return sorted({*super().__dir__(), *ofMoves})

    def _moves(self):
        return [self.getMove(index) for index in range(self.getNumMoves())]

    def _findMove(self, name):
        return next((move for move in self._moves() if hasattr(move, name)), None)

    def _findShearWaves(self):
        return next((index for index, move in enumerate(self._moves()) if isinstance(move, ShearWaveIntegrator)), None)

    def getFlipFraction(self):
        """Get the number of attempts in a sweep, as a fraction of the number of edges."""
        return self.getFlipIntegrator().getFraction()

    def setFlipFraction(self, fraction):
        """Set the number of attempts in a sweep, as a fraction of the number of edges."""
        self.getFlipIntegrator().setFraction(fraction)

    def getNumTrajectories(self):
        """Get the number of trajectories made since the Context was created."""
        return self.getNumAttempted()

    def getNumAcceptedTrajectories(self):
        """Get the number of trajectories accepted since the Context was created."""
        return self.getNumAccepted()

    def getNumDivergedTrajectories(self):
        """Get the number of trajectories since the Context was created that diverged, and were rejected."""
        trajectory = self.getMove(0)
        return trajectory.getNumDiverged() if hasattr(trajectory, 'getNumDiverged') else 0

    def addShearWaves(self, shearWaves, probability):
        """Add an integrator that makes shear waves.  There is none at first, and there can be one.

        Parameters
        ----------
        shearWaves : ShearWaveIntegrator
            the integrator; this object takes over its ownership
        probability : float
            the probability that a step is one of shear waves; with that of a sweep of flips it must not add up to more
            than 1
        """
        if not isinstance(shearWaves, ShearWaveIntegrator):
            raise TypeError(f"HybridMonteCarloIntegrator.addShearWaves: the object, a {type(shearWaves).__name__}, "
                            "is not a ShearWaveIntegrator")
        if self._findShearWaves() is not None:
            raise openmm.OpenMMException("HybridMonteCarloIntegrator: it has a ShearWaveIntegrator already")
        _requireShearWaveProbability(probability)
        self.addMove(shearWaves, probability)

    def getShearWaveIntegrator(self):
        """Get the integrator that makes shear waves."""
        index = self._findShearWaves()
        if index is None:
            raise openmm.OpenMMException("HybridMonteCarloIntegrator: it has no ShearWaveIntegrator; "
                                         "call addShearWaves()")
        return self.getMove(index)

    def getShearWaveProbability(self):
        """Get the probability that a step is one of shear waves: 0 if there is no integrator for them."""
        index = self._findShearWaves()
        return 0.0 if index is None else self.getMoveProbability(index)

    def setShearWaveProbability(self, probability):
        """Set the probability that a step is one of shear waves.  With that of a sweep of flips it must not add up to
        more than 1.
        """
        _requireShearWaveProbability(probability)
        index = self._findShearWaves()
        if index is not None:
            self.setMoveProbability(index, probability)
        elif probability > 0:
            self.getShearWaveIntegrator()

    def getShearWaveAcceptanceRate(self):
        """Get the fraction of shear waves that were accepted, or 0 if there was none."""
        return 0.0 if self._findShearWaves() is None else self.getShearWaveIntegrator().getAcceptanceRate()


def _requireShearWaveProbability(probability):
    if not 0 <= probability <= 1:
        raise openmm.OpenMMException(f"HybridMonteCarloIntegrator: the probability of shear waves is {probability}; "
                                     "it must be between 0 and 1")


def _addTrajectorySetting(name, item, default):
    getter, setter = 'get' + name, 'set' + name

    def get(self):
        move = self._findMove(getter)
        return default if move is None else getattr(move, getter)()

    def set(self, value):
        move = self._findMove(setter)
        if move is not None:
            getattr(move, setter)(value)
        elif value != default:
            raise openmm.OpenMMException(f"HybridMonteCarloIntegrator: {item} is {value!r}; "
                                         f"integrator 0 is not one for which it can be other than {default!r}: "
                                         "it must be a HamiltonianTrajectoryIntegrator")

    for method, function, verb in ((getter, get, 'Get'), (setter, set, 'Set')):
        function.__name__, function.__qualname__ = method, f'HybridMonteCarloIntegrator.{method}'
        function.__doc__ = f"{verb} {item}: see HamiltonianTrajectoryIntegrator.{method}()."
        setattr(_Mixture, method, function)


for _name, _itemAndDefault in _TRAJECTORY_SETTINGS.items():
    _addTrajectorySetting(_name, *_itemAndDefault)
%}

%feature("python:abc", "_Mixture") HelfrichPlugin::HybridMonteCarloIntegrator;

%ignore HelfrichPlugin::HybridMonteCarloIntegrator::getMove;
%extend HelfrichPlugin::HybridMonteCarloIntegrator {
%pythoncode %{
    def getIntegrator(self, index):
        """Get one of the integrators, an object of its own class.

        Parameters
        ----------
        index : int
            0 for the one that makes the trajectories
        """
        integrator = super().getIntegrator(index)
        kind = next((globals()[name] for name in _MOVES if globals()[name].isinstance(integrator)), None)
        return integrator if kind is None else kind.cast(integrator)

    def getMove(self, index):
        """Get one of the moves, an integrator.

        Parameters
        ----------
        index : int
            0 for the one that makes the trajectories
        """
        return self.getIntegrator(index)
%}
}

// The Integrator that is passed belongs to the other one from then on.
%pythonprepend HelfrichPlugin::HybridMonteCarloIntegrator::addMove %{
        _requireOwned(move)
%}
%pythonappend HelfrichPlugin::HybridMonteCarloIntegrator::addMove %{
        move.thisown = False
%}
