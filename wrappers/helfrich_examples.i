// An example in the documentation of each class, as Python has them.

%pythoncode %{
for _class, _example in (
    (HelfrichForce, """
    kT = 300 * unit.kelvin * unit.MOLAR_GAS_CONSTANT_R
    mesh = mh.Mesh.icosphere(subdivisions=3)
    force = mh.HelfrichForce()
    force.setTriangles(mesh.triangles)
    force.setBendingModulus(20 * kT)
    force.setVolumeModulus(1e6 * kT)
    force.setTargetVolume(0.95 * mesh.volume)
    system = mesh.createSystem()
    system.addForce(force)
    context = mm.Context(system, mm.VerletIntegrator(0.001), mm.Platform.getPlatform("CPU"))
    context.setPositions(mesh.vertices)
    print(force.getEnergyTermsInContext(context)["bending"])  # 8 pi kappa_B, but for the mesh
    context.setParameter(force.getTargetVolumeParameter(), 0.9 * mesh.volume)
"""),
    (HybridMonteCarloIntegrator, """
    integrator = mh.HybridMonteCarloIntegrator(300 * unit.kelvin, 4e-4 * unit.picoseconds, stepsPerTrajectory=50)
    simulation = app.Simulation(mesh.topology(), system, integrator)
    simulation.context.setPositions(mesh.vertices)
    simulation.step(20)
    print(integrator.getAcceptanceRate(), integrator.getFlipAcceptanceRate())
"""),
    (HamiltonianTrajectoryIntegrator, """
    trajectories = mh.HamiltonianTrajectoryIntegrator(300 * unit.kelvin, 4e-4 * unit.picoseconds, 50)
    trajectories.setSplitting("bcss3")
    integrator = mh.HybridMonteCarloIntegrator(trajectories)
"""),
    (EdgeFlipIntegrator, """
    flips = mh.EdgeFlipIntegrator(300 * unit.kelvin, 0.1)
    context = mm.Context(system, flips, mm.Platform.getPlatform("CPU"))
    context.setPositions(mesh.vertices)
    flips.step(10)
    print(flips.getNumAccepted(), force.getTrianglesInContext(context))
"""),
    (SpeciesExchangeIntegrator, """
    force = mh.HelfrichForce()
    force.setTriangles(mesh.triangles)
    force.addSpecies(40, 0)
    force.addSpecies(20, 0)
    force.setLineTension(0, 1, 5)
    force.setVertexSpecies(np.arange(len(mesh.vertices)) % 2)
    system = mesh.createSystem()
    system.addForce(force)
    exchange = mh.SpeciesExchangeIntegrator(300 * unit.kelvin, 1.0)
    context = mm.Context(system, exchange, mm.Platform.getPlatform("CPU"))
    context.setPositions(mesh.vertices)
    exchange.step(5)
    print(exchange.getNumAccepted(), force.getVertexSpeciesInContext(context))
"""),
    (ShearWaveIntegrator, """
    waves = mh.ShearWaveIntegrator(300 * unit.kelvin, 0.03 * unit.nanometer, 1.0, 3.0)
    integrator = mh.HybridMonteCarloIntegrator(300 * unit.kelvin, 4e-4 * unit.picoseconds)
    integrator.addMove(waves, 0.2)
"""),
    (CustomTrajectoryIntegrator, """
    trajectories = mh.CustomTrajectoryIntegrator(300 * unit.kelvin, 4e-4 * unit.picoseconds, 50)
    integrator = mh.HybridMonteCarloIntegrator(trajectories, mh.EdgeFlipIntegrator(300 * unit.kelvin, 0.1), 0.5)
"""),
    (MonteCarloIntegrator, """
    flips = mh.EdgeFlipIntegrator(300 * unit.kelvin, 0.1)
    flips.setRandomNumberSeed(1)
    print(isinstance(flips, mh.MonteCarloIntegrator), flips.getTemperature())
"""),
):
    if _class.__doc__ is not None:  # python -OO has no documentation
        _class.__doc__ = inspect.cleandoc(_class.__doc__) + "\n\n::\n" + _example
%}
