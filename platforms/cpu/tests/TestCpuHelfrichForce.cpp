#include "TestHelfrichForce.h"
#include "openmm/CustomExternalForce.h"
#include "openmm/cpu/CpuPlatform.h"
#include "openmm/internal/ContextImpl.h"
#include "openmmhelfrich/HamiltonianTrajectoryIntegrator.h"
#include "openmmhelfrich/internal/HelfrichForceImpl.h"
#include <cstdlib>

extern "C" void registerHelfrichCpuKernelFactories();

OpenMM::Platform& initializeTests() {
    if (!CpuPlatform::isProcessorSupported()) {
        cout << "The CPU platform does not support this processor." << endl;
        exit(0);
    }
    Platform::registerPlatform(new CpuPlatform());
    registerHelfrichCpuKernelFactories();
    Platform& platform = Platform::getPlatform("CPU");
    // More threads do not pay for meshes this small, least of all on a busy machine: those tests that are about threads
    // ask for them.
    platform.setPropertyDefaultValue(CpuPlatform::CpuThreads(), "1");
    return platform;
}

/**
 * A membrane, and parameters for it.
 */
struct Scene {
    Membrane membrane;
    vector<HelfrichParameters> all;
};

/**
 * One surface with each term alone and with all of them.
 */
Scene createScene(int subdivisions) {
    Membrane blob = createBlob(subdivisions);
    return {blob, createAllParameters(blob)};
}

/**
 * Three surfaces with targets of their own, with the terms of these alone and with all of them.
 */
Scene createSceneOfSurfaces() {
    Membrane several =
            join({createBlob(3, 0.15, 2), place(createBlob(4), Vec3(2.2, 0, 0)), place(createBlob(0), Vec3(5, 0, 0))});
    return {several,
            {withSurfaceTargets(createParameters(several, Area | Volume | AreaDifference)),
             withSurfaceTargets(createParameters(several, AllTerms, 2))}};
}

void testThreads() {
    // Any number of threads, more than there are chunks of work included, gives the same bits.

    for (const Scene& scene : {createScene(1), createScene(2), createScene(4), createSceneOfSurfaces()}) {
        const Membrane& blob = scene.membrane;
        for (auto& p : scene.all) {
            MembraneContext serial(blob, p, {{"Threads", "1"}});
            double energy = serial.getEnergy();
            vector<Vec3> forces = serial.getForces();
            for (string threads : {"2", "3", "7"}) {
                MembraneContext parallel(blob, p, {{"Threads", threads}});
                ASSERT_EQUAL(energy, parallel.getEnergy());
                ASSERT_EQUAL_CONTAINERS(forces, parallel.getForces());
            }
        }
    }
}

void testHistoryDoesNotMatter() {
    // The result depends on positions and triangles, and not on how the Context came to them: where it was when it made
    // its list of neighbors, for instance.

    Membrane blob = createBlob(3);
    TestRandom random(2);
    HelfrichParameters p = createParameters(blob, AllTerms, 1);
    MembraneContext context(blob, p);
    for (int i = 0; i < 20; i++) {
        context.getEnergy();
        for (auto& x : blob.positions)
            x += random.vector(0.005);
        context.context->setPositions(blob.positions);
        MembraneContext fresh(blob, p);
        ASSERT_EQUAL(fresh.getEnergy(), context.getEnergy());
        ASSERT_EQUAL_CONTAINERS(fresh.getForces(), context.getForces());
    }
}

/**
 * A few trajectories of a blob, accepted or not, some vertices of which are frozen; and where they end.
 */
vector<Vec3> makeTrajectories(const Membrane& blob, const HelfrichParameters& p, const string& splitting, bool isAlone,
                              const string& threads, const string& precision, vector<double>& energyChanges) {
    System system;
    for (size_t i = 0; i < blob.positions.size(); i++)
        system.addParticle(i % 10 == 0 ? 0 : 1 + 0.1 * (i % 3));
    system.addForce(createForce(blob, p));
    if (!isAlone)
        system.addForce(new CustomExternalForce("0"));
    HamiltonianTrajectoryIntegrator integrator(300, 1, 5);
    integrator.setSplitting(splitting);
    integrator.setTetherSubsteps(splitting == "bcss2" ? 3 : 1);
    integrator.setRandomNumberSeed(5);
    integrator.setForcePrecision(precision);
    Context context(system, integrator, *platform, {{"Threads", threads}});
    context.setPositions(blob.positions);
    energyChanges.clear();
    for (double stepSize : {1e-6, 1e-5, 1e-3, 100.0}) {
        integrator.setStepSize(stepSize);
        integrator.step(1);
        energyChanges.push_back(integrator.getLastEnergyChange());
    }
    State state = context.getState(State::Positions | State::Velocities);
    vector<Vec3> result = state.getPositions();
    result.insert(result.end(), state.getVelocities().begin(), state.getVelocities().end());
    return result;
}

void checkMembraneAlone(const Membrane& blob, const vector<HelfrichParameters>& all) {
    int count = 0;
    for (auto& p : all) {
        string splitting = (count++ % 3 == 0 ? "leapfrog" : count % 3 == 0 ? "bcss2" : "bcss3");
        vector<double> expectedChanges, changes;
        vector<Vec3> expected = makeTrajectories(blob, p, splitting, false, "1", "double", expectedChanges);
        for (string threads : {"1", "2"}) {
            vector<Vec3> found = makeTrajectories(blob, p, splitting, true, threads, "double", changes);
            ASSERT_EQUAL_CONTAINERS(expectedChanges, changes);
            ASSERT_EQUAL_CONTAINERS(expected, found);
        }
        vector<Vec3> mixed = makeTrajectories(blob, p, splitting, true, "1", "mixed", expectedChanges);
        for (string threads : {"2", "3", "7"}) {
            vector<Vec3> found = makeTrajectories(blob, p, splitting, true, threads, "mixed", changes);
            ASSERT_EQUAL_CONTAINERS(expectedChanges, changes);
            ASSERT_EQUAL_CONTAINERS(mixed, found);
        }
    }
}

void testMembraneAlone() {
    // A membrane that is alone in its System moves its vertices itself, and just as the integrator would.

    for (const Scene& scene : {createScene(4), createSceneOfSurfaces()})
        checkMembraneAlone(scene.membrane, scene.all);
}

/**
 * This Integrator makes leapfrog steps of a membrane alone, and keeps the energy at their end.
 */
class LeapfrogIntegrator : public Integrator {
public:
    explicit LeapfrogIntegrator(bool mixed) : mixed(mixed) {
    }
    void step(int steps) {
        energy = dynamic_cast<HelfrichForceImpl&>(*context->getForceImpls()[0])
                         .makeTrajectory(*context, Splitting::byName("leapfrog").getSequence(getStepSize(), steps),
                                         mixed);
    }
    double energy = 0;
protected:
    void initialize(ContextImpl& contextRef) {
        context = &contextRef;
        owner = &contextRef.getOwner();
    }
    vector<string> getKernelNames() {
        return {};
    }
    double computeKineticEnergy() {
        return 0;
    }
private:
    bool mixed;
};

/**
 * Positions and velocities after leapfrog steps.  Some of the vertices are frozen.
 */
struct Motion {
    Motion(const Membrane& membrane, const HelfrichParameters& p, const vector<Vec3>& velocities, double stepSize,
           int numSteps, bool mixed, const string& threads = "1") {
        LeapfrogIntegrator integrator(mixed);
        integrator.setStepSize(stepSize);
        System system;
        for (size_t i = 0; i < membrane.positions.size(); i++)
            system.addParticle(i % 10 == 0 ? 0 : 1 + 0.1 * (i % 3));
        system.addForce(createForce(membrane, p));
        Context context(system, integrator, *platform, {{"Threads", threads}});
        context.setPositions(membrane.positions);
        context.setVelocities(velocities);
        integrator.step(numSteps);
        State state = context.getState(State::Positions | State::Velocities | State::Energy | State::Forces);
        positions = state.getPositions();
        this->velocities = state.getVelocities();
        forces = state.getForces();
        energy = state.getPotentialEnergy();
        ASSERT_EQUAL(energy, integrator.energy);
    }
    vector<Vec3> positions, velocities, forces;
    double energy;
};

double getLargestDifference(const vector<Vec3>& a, const vector<Vec3>& b) {
    double largest = 0;
    for (size_t i = 0; i < a.size(); i++)
        largest = max(largest, sqrt((a[i] - b[i]).dot(a[i] - b[i])));
    return largest;
}

vector<Vec3> createVelocities(const Membrane& membrane, double speed) {
    TestRandom random(4);
    vector<Vec3> velocities;
    for (size_t i = 0; i < membrane.positions.size(); i++)
        velocities.push_back(i % 10 == 0 ? Vec3() : random.vector(speed));
    return velocities;
}

void checkMixedPrecision(const Membrane& blob, const vector<HelfrichParameters>& all) {
    vector<Vec3> start = createVelocities(blob, 1);
    for (auto& p : all) {
        const double stepSize = 1e-7;
        Motion exact(blob, p, start, stepSize, 1, false), mixed(blob, p, start, stepSize, 1, true);
        vector<Vec3> impulse, error;
        for (size_t i = 0; i < start.size(); i++) {
            impulse.push_back((exact.velocities[i] - start[i]) / stepSize);
            error.push_back((mixed.velocities[i] - exact.velocities[i]) / stepSize);
        }
        double relativeError = getNorm(error) / getNorm(impulse);
        ASSERT(relativeError < 3e-6);
        ASSERT(!p.has(Term::Bending) || relativeError > 1e-9);
        Membrane end = blob;
        end.positions = mixed.positions;
        MembraneContext fresh(end, p);
        ASSERT_EQUAL(fresh.getEnergy(), mixed.energy);
        ASSERT_EQUAL_CONTAINERS(fresh.getForces(), mixed.forces);
    }
}

void testMixedPrecision() {
    // Forces in single precision are wrong by a few units in its last place, wherever the membrane is; energies and
    // forces that are asked for are in double precision, and any number of threads gives the same bits.

    for (double shift : {0.0, 1000.0})
        for (const Scene& scene : {createScene(4), createSceneOfSurfaces()})
            checkMixedPrecision(place(scene.membrane, Vec3(shift, -shift, 0)), scene.all);
}

void testMixedPrecisionIsReversible() {
    // The errors of the forces depend on the positions alone: back from the end, the vertices meet the same, and return
    // to where they came from.

    Membrane blob = createBlob(3);
    vector<Vec3> start = createVelocities(blob, 1);
    for (auto& p : createAllParameters(blob)) {
        const double stepSize = 1e-4;
        const int numSteps = 50;
        Motion exact(blob, p, start, stepSize, numSteps, false), there(blob, p, start, stepSize, numSteps, true, "2");
        Membrane end = blob;
        end.positions = there.positions;
        vector<Vec3> reversed;
        for (auto& v : there.velocities)
            reversed.push_back(-v);
        Motion back(end, p, reversed, stepSize, numSteps, true, "3");
        for (auto& v : back.velocities)
            v = -v;
        ASSERT(getLargestDifference(blob.positions, there.positions) > 1e-3);
        ASSERT(getLargestDifference(blob.positions, back.positions) < 1e-11);
        ASSERT(getLargestDifference(start, back.velocities) < 1e-9);
        ASSERT(!p.has(Term::Bending) || getLargestDifference(exact.positions, there.positions) > 1e-11);
    }
}

void testAllInstructionSets() {
    Membrane blob = createBlob(3);
    vector<int> some = {0, 1, 100, 200, 256, 257};
    int numSupported = 0;
    for (const char* name : {"Baseline", "AVX2", "AVX512"}) {
        setenv("OPENMM_HELFRICH_SIMD", name, 1);
        try {
            MembraneContext(blob, createParameters(blob, Bending));
        }
        catch (const OpenMMException& error) {
            ASSERT(string(name) != "Baseline");
            ASSERT(string(error.what()).find("Baseline") != string::npos);
            continue;
        }
        numSupported++;
        for (auto& p : createAllParameters(blob)) {
            MembraneContext context(blob, p);
            assertEqualRelative(computeExactly(blob, p).getTotal(), context.getEnergy(), 1e-12);
            vector<Vec3> forces = context.getForces(), found;
            for (int i : some)
                found.push_back(forces[i]);
            assertEqualVectors(computeForcesExactly(blob, p, some), found, 1e-12);
        }
        testSmallAndLargeAngles();
        testChangingTriangles();
        testThreads();
        testMixedPrecision();
    }
    unsetenv("OPENMM_HELFRICH_SIMD");
    ASSERT(numSupported > 0);
}

void testUnknownInstructionSet() {
    Membrane blob = createBlob(1);
    setenv("OPENMM_HELFRICH_SIMD", "AVX3", 1);
    string message;
    try {
        MembraneContext(blob, createParameters(blob, Bending));
    }
    catch (const OpenMMException& error) {
        message = error.what();
    }
    unsetenv("OPENMM_HELFRICH_SIMD");
    ASSERT(message.find("AVX3") != string::npos && message.find("Baseline") != string::npos);
}

void testLargeSum() {
    // The energies of 65,538 vertices are added up to 1e-13.

    Membrane blob = createBlob(7, 0.05);
    HelfrichParameters p = createParameters(blob, Bending | Area | Volume | AreaDifference | Tether);
    MembraneContext context(blob, p);
    auto exact = computeExactly(blob, p);
    HelfrichGeometry geometry = context.getGeometry();
    assertEqualRelative(exact.area, geometry.area, 1e-14);
    assertEqualRelative(exact.volume, geometry.volume, 1e-14);
    assertEqualRelative(exact.curvature, geometry.integratedMeanCurvature, 1e-13);
    assertEqualRelative(exact.getTotal(), context.getEnergy(), 1e-13);
}

void runPlatformTests() {
    testThreads();
    testHistoryDoesNotMatter();
    testMembraneAlone();
    testMixedPrecisionIsReversible();
    testAllInstructionSets();
    testUnknownInstructionSet();
    testLargeSum();
}
