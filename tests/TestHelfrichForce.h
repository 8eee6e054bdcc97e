/* Tests of HelfrichForce that every platform must pass.  A source that includes this defines initializeTests(), which
 * returns the platform, and runPlatformTests(). */

#include "Assertions.h"
#include "HelfrichEquations.h"
#include "Membranes.h"
#include "openmmhelfrich/HelfrichForce.h"
#include "openmmhelfrich/internal/HelfrichMesh.h"
#include "openmm/Context.h"
#include "openmm/CustomExternalForce.h"
#include "openmm/OpenMMException.h"
#include "openmm/Platform.h"
#include "openmm/System.h"
#include "openmm/VerletIntegrator.h"
#include "openmm/internal/AssertionUtilities.h"
#include <algorithm>
#include <iostream>
#include <memory>
#include <string>

using namespace HelfrichPlugin;
using namespace OpenMM;
using namespace std;

OpenMM::Platform& initializeTests();
void runPlatformTests();

OpenMM::Platform* platform;

/**
 * A Context with one membrane, or several.
 */
class MembraneContext {
public:
    MembraneContext(const vector<Vec3>& positions, const vector<HelfrichForce*>& forces,
                    const map<string, string>& properties = {})
            : forces(forces), integrator(0.001) {
        for (size_t i = 0; i < positions.size(); i++)
            system.addParticle(1);
        for (auto force : forces)
            system.addForce(force);
        context.reset(new Context(system, integrator, *platform, properties));
        context->setPositions(positions);
    }
    MembraneContext(const Membrane& membrane, const HelfrichParameters& p, const map<string, string>& properties = {})
            : MembraneContext(membrane.positions, {createForce(membrane, p)}, properties) {
    }
    double getEnergy(int groups = -1) {
        return context->getState(State::Energy, false, groups).getPotentialEnergy();
    }
    double getEnergy(const vector<Vec3>& positions) {
        context->setPositions(positions);
        return getEnergy();
    }
    vector<Vec3> getForces(int groups = -1) {
        return context->getState(State::Forces, false, groups).getForces();
    }
    HelfrichEnergyTerms getTerms() {
        return forces[0]->getEnergyTermsInContext(*context);
    }
    HelfrichGeometry getGeometry() {
        return forces[0]->getGeometryInContext(*context);
    }
    vector<HelfrichForce*> forces;
    System system;
    VerletIntegrator integrator;
    unique_ptr<Context> context;
};

double getNorm(const vector<Vec3>& vectors) {
    double sum = 0;
    for (auto& v : vectors)
        sum += v.dot(v);
    return sqrt(sum);
}

/**
 * Assert that two vectors of many components differ by less than a fraction of their norm.
 */
void assertEqualVectors(const vector<Vec3>& expected, const vector<Vec3>& found, double tolerance) {
    ASSERT_EQUAL(expected.size(), found.size());
    vector<Vec3> difference;
    for (size_t i = 0; i < expected.size(); i++)
        difference.push_back(found[i] - expected[i]);
    ASSERT(getNorm(expected) > 0);
    ASSERT_EQUAL_TOL(0, getNorm(difference) / getNorm(expected), tolerance);
}

void assertEqualRelative(double expected, double found, double tolerance) {
    ASSERT(expected != 0);
    ASSERT_EQUAL_TOL(1, found / expected, tolerance);
}

/**
 * Each term alone, repulsion at every exclusion level, and all terms together, of one material and of several.
 * All of them have forces.
 */
vector<HelfrichParameters> createAllParameters(const Membrane& membrane) {
    vector<HelfrichParameters> all;
    for (int i = 0; i < NUM_TERMS; i++)
        if (Term(i) != Term::Repulsion && Term(i) != Term::Pair)
            all.push_back(createParameters(membrane, Term(i)));
    for (TermMask terms : {Repulsion, AllTerms, EveryTerm})
        for (int level = 0; level < 3; level++)
            all.push_back(createParameters(membrane, terms, level));
    for (TermMask terms : {Bending, AllTerms})
        all.push_back(withSpontaneousCurvature(createParameters(membrane, terms)));
    for (TermMask terms : {Bending, Bending | Line, Bending | Gaussian, Gaussian | Line, Line | Tether})
        all.push_back(createParameters(membrane, EveryTerm).only(terms));
    return all;
}

void testEnergyAgainstEquations() {
    Membrane blob = createBlob(2);
    for (auto& p : createAllParameters(blob)) {
        MembraneContext context(blob, p);
        HelfrichEnergyTerms terms = context.getTerms();
        auto exact = computeExactly(blob, p);
        assertEqualRelative(exact.getTotal(), context.getEnergy(), 1e-12);
        for (int i = 0; i < NUM_TERMS; i++)
            ASSERT_EQUAL_TOL((double) exact[Term(i)], terms[Term(i)], 1e-12);
    }
}

void testEveryTermIsAtWork() {
    // The other tests mean nothing for a term that is zero, or whose pairs are the same at two exclusion levels.

    Membrane blob = createBlob(2);
    vector<double> repulsion;
    for (int level = 0; level < 3; level++) {
        auto exact = computeExactly(blob, createParameters(blob, EveryTerm, level));
        for (int i = 0; i < NUM_TERMS; i++)
            ASSERT(fabsl(exact[Term(i)]) > 10);
        repulsion.push_back(exact[Term::Repulsion]);
    }
    ASSERT(repulsion[0] > 1.1 * repulsion[1]);
    ASSERT(repulsion[1] > 1.1 * repulsion[2]);
}

void testGeometryAgainstEquations() {
    Membrane blob = createBlob(2);
    MembraneContext context(blob, createParameters(blob, Bending));
    HelfrichGeometry geometry = context.getGeometry();
    auto exact = computeExactly(blob, createParameters(blob, Bending));
    assertEqualRelative(exact.area, geometry.area, 1e-13);
    assertEqualRelative(exact.volume, geometry.volume, 1e-13);
    assertEqualRelative(exact.curvature, geometry.integratedMeanCurvature, 1e-13);
    assertEqualRelative(2 * 0.1 * exact.curvature, geometry.areaDifference, 1e-13);
    ASSERT_EQUAL(blob.positions.size(), geometry.vertexAreas.size());
    ASSERT_EQUAL(blob.positions.size(), geometry.vertexMeanCurvatures.size());
    for (size_t i = 0; i < blob.positions.size(); i++) {
        assertEqualRelative(exact.vertexAreas[i], geometry.vertexAreas[i], 1e-13);
        ASSERT_EQUAL_TOL((double) exact.vertexCurvatures[i], geometry.vertexMeanCurvatures[i], 1e-13);
    }
}

void testForcesAgainstEquations() {
    Membrane blob = createBlob(2);
    vector<int> vertices;
    for (int i = 0; i < (int) blob.positions.size(); i++)
        vertices.push_back(i);
    for (auto& p : createAllParameters(blob)) {
        MembraneContext context(blob, p);
        assertEqualVectors(computeForcesExactly(blob, p, vertices), context.getForces(), 1e-12);
    }
}

/**
 * The derivative of the energy along a direction, by central differences of fourth order.
 */
double differentiate(MembraneContext& context, const vector<Vec3>& positions, const vector<Vec3>& direction,
                     double step) {
    auto energyAt = [&](double distance) {
        vector<Vec3> moved = positions;
        for (size_t i = 0; i < moved.size(); i++)
            moved[i] += direction[i] * distance;
        return context.getEnergy(moved);
    };
    return (8 * (energyAt(step) - energyAt(-step)) - (energyAt(2 * step) - energyAt(-2 * step))) / (12 * step);
}

void testForcesAgainstCentralDifferences() {
    Membrane blob = createBlob(2);
    int n = blob.positions.size();
    TestRandom random(5);
    for (auto& p : createAllParameters(blob)) {
        MembraneContext context(blob, p);
        vector<Vec3> forces = context.getForces();
        double scale = 0;
        for (auto& force : forces)
            scale = max(scale, sqrt(force.dot(force)));
        for (int trial = 0; trial < 30; trial++) {
            vector<Vec3> direction(n);
            direction[random.index(n)][trial % 3] = 1;
            if (trial % 10 == 0)
                for (auto& d : direction)
                    d = random.vector(1);
            double expected = 0;
            for (int i = 0; i < n; i++)
                expected -= forces[i].dot(direction[i]);
            ASSERT_EQUAL_TOL(0,
                             (differentiate(context, blob.positions, direction, 2e-5) - expected) /
                                     max(scale, fabs(expected)),
                             1e-6);
        }
    }
}

/**
 * A flat closed surface: two pyramids of the same irregular base, whose edges to the tip have dihedral angles of about
 * the slope of the faces.  In this orientation double precision holds positions, normals and sines to the full relative
 * accuracy.
 */
Membrane createPillow(double slope) {
    Membrane pillow;
    const double angles[] = {0, 0.9, 2.1, 3, 4.4, 5.3}, radii[] = {1, 1.1, 0.9, 1.2, 1, 0.95};
    for (int i = 0; i < 6; i++)
        pillow.positions.push_back(Vec3(radii[i] * cos(angles[i]), radii[i] * sin(angles[i]), 0));
    pillow.positions.push_back(Vec3(0.0625, 0.03125, slope));
    pillow.positions.push_back(Vec3(0.0625, 0.03125, -1.25 * slope));
    for (int i = 0; i < 6; i++) {
        pillow.triangles.push_back({i, (i + 1) % 6, 6});
        pillow.triangles.push_back({(i + 1) % 6, i, 7});
    }
    return pillow;
}

void testSmallAndLargeAngles() {
    // Angles from about 1e-8 at the tips to that much less than pi at the rim, with no loss of relative accuracy in any
    // vertex's curvature and force.

    for (double slope : {1e-8, 1e-4, 0.5e-4, 1.0, 100.0}) {
        Membrane pillow = createPillow(slope);
        HelfrichParameters p = createParameters(pillow, Bending | AreaDifference);
        MembraneContext context(pillow, p);
        auto exact = computeExactly(pillow, p);
        HelfrichGeometry geometry = context.getGeometry();
        ASSERT(slope > 0.01 || exact.vertexCurvatures[6] < 4 * slope);
        vector<Vec3> forces = context.getForces(), expected = computeForcesExactly(pillow, p, {0, 1, 2, 3, 4, 5, 6, 7});
        for (int i = 0; i < 8; i++) {
            assertEqualRelative(exact.vertexCurvatures[i], geometry.vertexMeanCurvatures[i], 1e-12);
            assertEqualVectors({expected[i]}, {forces[i]}, 1e-12);
        }
    }
}

/**
 * The sum of the positions times the gradient of the energy: the derivative of the energy by the logarithm of the size.
 */
double getVirial(const vector<Vec3>& positions, const vector<Vec3>& forces) {
    double virial = 0;
    for (size_t i = 0; i < positions.size(); i++)
        virial -= positions[i].dot(forces[i]);
    return virial;
}

void testScaling() {
    // With a target far above the value, the slope of a penalty is -2 modulus/target to first order; here it is used
    // exactly.

    Membrane blob = createBlob(3);
    MembraneContext bending(blob, createParameters(blob, Bending));
    vector<Vec3> forces = bending.getForces();
    ASSERT_EQUAL_TOL(0, getVirial(blob.positions, forces) / (getNorm(forces) * getNorm(blob.positions)), 1e-13);
    auto getDegree = [&](TermMask term, double total, double target, double modulus) {
        MembraneContext context(blob, createParameters(blob, term));
        double slope = 2 * modulus * (total / target - 1) / target;
        return getVirial(blob.positions, context.getForces()) / (slope * total);
    };
    HelfrichGeometry geometry = bending.getGeometry();
    HelfrichParameters p = createParameters(blob, AllTerms);
    ASSERT_EQUAL_TOL(2, getDegree(Area, geometry.area, p.targetArea, p.moduli[Term::Area]), 1e-11);
    ASSERT_EQUAL_TOL(3, getDegree(Volume, geometry.volume, p.targetVolume, p.moduli[Term::Volume]), 1e-11);
    ASSERT_EQUAL_TOL(
            1,
            getDegree(AreaDifference, geometry.areaDifference, p.targetAreaDifference, p.moduli[Term::AreaDifference]),
            1e-11);
    MembraneContext tension(blob, createParameters(blob, Tension));
    assertEqualRelative(2 * p.moduli[Term::Tension] * geometry.area, getVirial(blob.positions, tension.getForces()),
                        1e-11);
    MembraneContext pressure(blob, createParameters(blob, Pressure));
    assertEqualRelative(-3 * p.moduli[Term::Pressure] * geometry.volume,
                        getVirial(blob.positions, pressure.getForces()), 1e-11);
}

void testNoNetForceOrTorque() {
    Membrane blob = createBlob(2);
    for (auto& p : createAllParameters(blob)) {
        vector<Vec3> forces = MembraneContext(blob, p).getForces();
        Vec3 force, torque;
        for (size_t i = 0; i < forces.size(); i++) {
            force += forces[i];
            torque += blob.positions[i].cross(forces[i]);
        }
        ASSERT_EQUAL_VEC(Vec3(0, 0, 0), force / getNorm(forces), 1e-13);
        ASSERT_EQUAL_VEC(Vec3(0, 0, 0), torque / getNorm(forces), 1e-13);
    }
}

void testTermsAddUp() {
    Membrane blob = createBlob(2);
    double sum = 0;
    vector<Vec3> forces(blob.positions.size());
    for (int term = 0; term < NUM_TERMS; term++) {
        MembraneContext context(blob, createParameters(blob, EveryTerm).only(Term(term)));
        sum += context.getEnergy();
        ASSERT_EQUAL(context.getEnergy(), context.getTerms().getTotal());
        vector<Vec3> part = context.getForces();
        for (size_t i = 0; i < forces.size(); i++)
            forces[i] += part[i];
    }
    MembraneContext all(blob, createParameters(blob, EveryTerm));
    assertEqualRelative(sum, all.getEnergy(), 1e-12);
    assertEqualVectors(forces, all.getForces(), 1e-12);
    ASSERT_EQUAL(all.getEnergy(), all.getTerms().getTotal());
    MembraneContext none(blob, createParameters(blob, TermMask()));
    ASSERT_EQUAL(0.0, none.getEnergy());
    ASSERT_EQUAL(0.0, getNorm(none.getForces()));
}

Vec3 rotate(const Vec3& x) {
    // By 36.87 degrees about x, then 67.38 degrees about z: 3-4-5 and 5-12-13.

    Vec3 y(x[0], 0.8 * x[1] - 0.6 * x[2], 0.6 * x[1] + 0.8 * x[2]);
    return Vec3((5 * y[0] - 12 * y[1]) / 13, (12 * y[0] + 5 * y[1]) / 13, y[2]);
}

void testInvariance() {
    Membrane blob = createBlob(2);
    HelfrichParameters p = createParameters(blob, EveryTerm, 2);
    MembraneContext context(blob, p);
    double energy = context.getEnergy();
    vector<Vec3> forces = context.getForces(), rotatedForces, rotated = blob.positions, shifted = blob.positions;
    for (size_t i = 0; i < forces.size(); i++) {
        rotatedForces.push_back(rotate(forces[i]));
        rotated[i] = rotate(rotated[i]);
        shifted[i] += Vec3(30, -50, 70);
    }
    assertEqualRelative(energy, context.getEnergy(rotated), 1e-11);
    assertEqualVectors(rotatedForces, context.getForces(), 1e-11);
    assertEqualRelative(energy, context.getEnergy(shifted), 1e-9);
    assertEqualVectors(forces, context.getForces(), 1e-9);
    vector<int> newIndex;
    Membrane renumbered = renumber(blob, newIndex, 3);
    MembraneContext other(renumbered, p);
    assertEqualRelative(energy, other.getEnergy(), 1e-12);
    vector<Vec3> otherForces = other.getForces(), inOldOrder;
    for (int i : newIndex)
        inOldOrder.push_back(otherForces[i]);
    assertEqualVectors(forces, inOldOrder, 1e-11);
}

void testPotentialsHaveNoUnit() {
    // In another unit of length, which is that of tether, repulsion and bounds too, these have the same energy, though
    // the two branches of a tether go as opposite powers of the length.

    Membrane blob = createBlob(2);
    HelfrichParameters p = createParameters(blob, Tether | Repulsion);
    MembraneContext context(blob, p);
    for (double factor : {1e-6, 0.25, 700.0, 1e6}) {
        Membrane scaled = blob;
        for (auto& x : scaled.positions)
            x *= factor;
        HelfrichParameters q = p;
        for (double* length :
             {&q.tetherMinLength, &q.tetherMaxLength, &q.tetherLengthScale, &q.repulsionOnset, &q.repulsionLengthScale})
            *length *= factor;
        MembraneContext other(scaled, q);
        assertEqualRelative(context.getEnergy(), other.getEnergy(), 1e-12);
        vector<Vec3> forces = other.getForces();
        for (auto& force : forces)
            force *= factor;
        assertEqualVectors(context.getForces(), forces, 1e-11);
        q.tetherLengthScale = p.tetherLengthScale;
        MembraneContext anotherTether(scaled, q);
        ASSERT(fabs(anotherTether.getEnergy() / context.getEnergy() - 1) > 0.5);
    }
}

void testSphere() {
    // A sphere's curvature energy is 8 pi kappa whatever its size, and its curvature 4 pi R.  The values are of the
    // surface, to which the mesh converges.

    double previous = 1;
    for (int subdivisions : {3, 4, 5}) {
        Membrane sphere = createSphere(subdivisions);
        for (auto& x : sphere.positions)
            x *= 50;
        MembraneContext context(sphere, createParameters(sphere, Bending));
        double error = fabs(context.getEnergy() / (8 * M_PI * 20) - 1);
        ASSERT(error < 0.4 * previous);
        previous = error;
        ASSERT_EQUAL_TOL(4 * M_PI * 50, context.getGeometry().integratedMeanCurvature, 0.01);
    }
    ASSERT_EQUAL_TOL(0, previous, 0.003);
}

void testTwoMembranesAndOtherParticles() {
    // Two membranes whose particles alternate, with particles of neither between them, and another force on all.

    Membrane first = createBlob(1, 0.15, 1), second = createBlob(1, 0.15, 2);
    int n = first.positions.size();
    vector<Vec3> positions(3 * n + 1);
    Membrane a = first, b = second;
    for (int i = 0; i < n; i++) {
        positions[3 * i + 1] = first.positions[i];
        positions[3 * (n - 1 - i) + 2] = second.positions[i];
    }
    for (int t = 0; t < (int) a.triangles.size(); t++)
        for (int c = 0; c < 3; c++) {
            a.triangles[t][c] = 3 * first.triangles[t][c] + 1;
            b.triangles[t][c] = 3 * (n - 1 - second.triangles[t][c]) + 2;
        }
    HelfrichParameters p = createParameters(first, EveryTerm, 1), q = createParameters(second, EveryTerm, 2);
    q.targetVolume *= 1.5;
    a.species = second.species = getSpecies(first);
    b.species.assign(second.species.rbegin(), second.species.rend());
    HelfrichForce *forceA = createForce(a, p), *forceB = createForce(b, q);
    forceB->setName("Other");
    forceB->setForceGroup(3);
    MembraneContext both(positions, {forceA, forceB});
    CustomExternalForce* external = new CustomExternalForce("x+2*y");
    for (int i = 0; i < (int) positions.size(); i++)
        external->addParticle(i);
    external->setForceGroup(5);
    both.system.addForce(external);
    both.context->reinitialize(true);

    MembraneContext onlyFirst(first, p), onlySecond(second, q);
    assertEqualRelative(onlyFirst.getEnergy(), both.getEnergy(1 << 0), 1e-12);
    assertEqualRelative(onlySecond.getEnergy(), both.getEnergy(1 << 3), 1e-12);
    assertEqualRelative(both.getEnergy(1 << 0) + both.getEnergy(1 << 3) + both.getEnergy(1 << 5), both.getEnergy(),
                        1e-12);
    vector<Vec3> forcesA = onlyFirst.getForces(), forcesB = onlySecond.getForces(), expected(positions.size());
    for (int i = 0; i < n; i++) {
        expected[3 * i + 1] = forcesA[i];
        expected[3 * (n - 1 - i) + 2] = forcesB[i];
    }
    assertEqualVectors(expected, both.getForces(1 << 0 | 1 << 3), 1e-11);
    for (auto& force : expected)
        force += Vec3(-1, -2, 0);
    assertEqualVectors(expected, both.getForces(), 1e-11);
    HelfrichGeometry geometry = forceB->getGeometryInContext(*both.context), alone = onlySecond.getGeometry();
    ASSERT_EQUAL(n, (int) geometry.vertexAreas.size());
    for (int i = 0; i < n; i++)
        assertEqualRelative(alone.vertexAreas[i], geometry.vertexAreas[n - 1 - i], 1e-12);
}

void testSeveralSurfacesAgainstEquations() {
    // Nested and side by side, with targets of their own and with common ones.

    Membrane several = createSeveralSurfaces();
    vector<int> some;
    for (int i = 0; i < (int) several.positions.size(); i += 9)
        some.push_back(i);
    vector<HelfrichParameters> all = createAllParameters(several);
    for (auto& p : createAllParameters(several))
        all.push_back(withSurfaceTargets(p));
    for (auto& p : all) {
        MembraneContext context(several, p);
        auto exact = computeExactly(several, p);
        HelfrichEnergyTerms terms = context.getTerms();
        for (int i = 0; i < NUM_TERMS; i++)
            ASSERT_EQUAL_TOL((double) exact[Term(i)], terms[Term(i)], 1e-12);
        assertEqualRelative(exact.getTotal(), context.getEnergy(), 1e-12);
        vector<Vec3> forces = context.getForces(), found;
        for (int i : some)
            found.push_back(forces[i]);
        assertEqualVectors(computeForcesExactly(several, p, some), found, 1e-11);
    }
    HelfrichParameters p = createParameters(several, EveryTerm);
    MembraneContext context(several, p);
    HelfrichGeometry geometry = context.getGeometry();
    auto exact = computeExactly(several, p);
    ASSERT_EQUAL(3, (int) geometry.surfaces.size());
    for (int k = 0; k < 3; k++) {
        assertEqualRelative(exact.surfaces[k].area, geometry.surfaces[k].area, 1e-13);
        assertEqualRelative(exact.surfaces[k].volume, geometry.surfaces[k].volume, 1e-13);
        assertEqualRelative(exact.surfaces[k].curvature, geometry.surfaces[k].integratedMeanCurvature, 1e-13);
        assertEqualRelative(2 * p.leafletSeparation * exact.surfaces[k].curvature, geometry.surfaces[k].areaDifference,
                            1e-13);
    }
    assertEqualRelative(exact.volume, geometry.volume, 1e-13);
}

void testEachSurfaceByItself() {
    // Without repulsion, however far apart they are, surfaces in one force have the energies and forces that each has
    // in a force of its own.

    for (double distance : {4.0, 4e4}) {
        vector<Membrane> alone = {createBlob(1, 0.15, 1), createBlob(2, 0.15, 2), createBlob(0, 0.15, 3)};
        for (int k = 0; k < 3; k++)
            alone[k] = place(alone[k], Vec3(distance * k, 0, 0));
        Membrane several = join(alone);
        HelfrichParameters p = createParameters(alone[1], ~Repulsion);
        MembraneContext together(several, withSurfaceTargets(p));
        double energy = 0;
        vector<Vec3> forces;
        for (int k = 0; k < 3; k++) {
            HelfrichParameters own = p;
            own.targetArea = withSurfaceTargets(p).getTarget(Term::Area, k);
            own.targetVolume = withSurfaceTargets(p).getTarget(Term::Volume, k);
            own.targetAreaDifference = withSurfaceTargets(p).getTarget(Term::AreaDifference, k);
            MembraneContext context(alone[k], own);
            HelfrichGeometry geometry = context.getGeometry();
            HelfrichSurfaceGeometry surface = together.getGeometry().surfaces[k];
            assertEqualRelative(geometry.area, surface.area, 1e-13);
            assertEqualRelative(geometry.volume, surface.volume, 1e-12);
            assertEqualRelative(geometry.areaDifference, surface.areaDifference, 1e-13);
            energy += context.getEnergy();
            for (auto& force : context.getForces())
                forces.push_back(force);
        }
        assertEqualRelative(energy, together.getEnergy(), 1e-12);
        assertEqualVectors(forces, together.getForces(), 1e-12);
    }
}

void testTargetsOfSurfaces() {
    // Each is a parameter of the Context with a name of its own, and setting that of all takes the others back.

    Membrane several = createSeveralSurfaces();
    HelfrichParameters p = withSurfaceTargets(createParameters(several, AllTerms)), changed = p;
    changed.surfaceTargets[{Term::Volume, 2}] = 0.7;
    changed.targetVolume = 1.3;
    MembraneContext context(several, p), other(several, changed);
    HelfrichForce& force = *context.forces[0];
    ASSERT_EQUAL("HelfrichForceTargetVolume", force.getTargetVolumeParameter());
    ASSERT_EQUAL("HelfrichForceTargetVolume", force.getTargetVolumeParameter(1));
    ASSERT_EQUAL("HelfrichForceTargetVolume2", force.getTargetVolumeParameter(2));
    ASSERT_EQUAL("HelfrichForceTargetArea1", force.getTargetAreaParameter(1));
    ASSERT_EQUAL("HelfrichForceTargetAreaDifference2", force.getTargetAreaDifferenceParameter(2));
    ASSERT_EQUAL(0.45, context.context->getParameter("HelfrichForceTargetVolume2"));
    ASSERT_EQUAL(0.45, force.getTargetVolume(2));
    ASSERT_EQUAL(force.getTargetVolume(), force.getTargetVolume(1));
    double before = context.getEnergy();
    ASSERT(fabs(other.getEnergy() - before) > 1);
    context.context->setParameter("HelfrichForceTargetVolume2", 0.7);
    context.context->setParameter("HelfrichForceTargetVolume", 1.3);
    ASSERT_EQUAL(other.getEnergy(), context.getEnergy());

    // Later changes of the targets in the Force are not those of the Context.

    force.setTargetVolume(3.9);
    force.setTargetArea(2, 0);
    ASSERT_EQUAL(3.9, force.getTargetVolume(2));
    ASSERT_EQUAL("HelfrichForceTargetVolume", force.getTargetVolumeParameter(2));
    force.updateParametersInContext(*context.context);
    ASSERT_EQUAL(other.getEnergy(), context.getEnergy());
    ASSERT_EQUAL(5.0, force.getTargetArea(1));
}

void testInvalidSurfaces() {
    Membrane several = createSeveralSurfaces();
    HelfrichParameters p = createParameters(several, AllTerms), q = p;
    q.surfaceTargets[{Term::Area, 3}] = 1;
    assertThrows([&] { MembraneContext(several, q); }, {"surface 3", "form 3 surfaces"});
    MembraneContext context(several, withSurfaceTargets(p));
    context.context->setParameter("HelfrichForceTargetVolume2", 0);
    assertThrows([&] { context.getEnergy(); }, {"volume term is on", "HelfrichForceTargetVolume2 is 0"});
    HelfrichForce force;
    assertThrows([&] { force.setTargetVolume(1, -2); }, {"setTargetVolume", "-2"});
    assertThrows([&] { force.getTargetAreaParameter(-3); }, {"getTargetAreaParameter", "-3"});
    ASSERT_EQUAL(3, context.forces[0]->getNumSurfacesInContext(*context.context));

    // Where every surface has a target of its own, nobody needs a common one.

    HelfrichParameters noCommon = createParameters(several, Volume);
    noCommon.targetVolume = 0;
    assertThrows([&] { MembraneContext(several, noCommon); }, {"HelfrichForceTargetVolume is 0"});
    for (int k = 0; k < 3; k++)
        noCommon.surfaceTargets[{Term::Volume, k}] = 0.5 + k;
    ASSERT(MembraneContext(several, noCommon).getEnergy() > 0);

    // Each surface must be outside in, and a particle a vertex of one force only.

    int surface = HelfrichMesh(several.triangles, several.positions.size()).getSurface(several.triangles[5][0]);
    for (auto& t : several.triangles)
        if (HelfrichMesh(createSeveralSurfaces().triangles, several.positions.size()).getSurface(t[0]) == surface)
            swap(t[0], t[1]);
    MembraneContext inverted(several, createParameters(several, Volume));
    assertThrows([&] { inverted.getEnergy(); }, {"surface " + to_string(surface) + " encloses", "inside out"});
    Membrane blob = createBlob(1);
    HelfrichForce *first = createForce(blob, createParameters(blob, Bending)),
                  *second = createForce(blob, createParameters(blob, Area));
    second->setName("Other");
    assertThrows([&] { MembraneContext(blob.positions, {first, second}); },
                 {"particle", "two HelfrichForces", "'HelfrichForce'", "'Other'"});
}

void testTargetsAreContextParameters() {
    Membrane blob = createBlob(2);
    HelfrichParameters p = createParameters(blob, AllTerms), changed = p;
    changed.targetArea = 6;
    changed.targetVolume = 1.1;
    changed.targetAreaDifference = -3;
    MembraneContext context(blob, p), other(blob, changed);
    ASSERT(fabs(context.getEnergy() - other.getEnergy()) > 1);
    const HelfrichForce& force = *context.forces[0];
    ASSERT_EQUAL(p.targetVolume, context.context->getParameter("HelfrichForceTargetVolume"));
    context.context->setParameter(force.getTargetAreaParameter(), 6);
    context.context->setParameter(force.getTargetVolumeParameter(), 1.1);
    context.context->setParameter(force.getTargetAreaDifferenceParameter(), -3);
    ASSERT_EQUAL(other.getEnergy(), context.getEnergy());
    assertEqualVectors(other.getForces(), context.getForces(), 0);
}

void testModuliThatAreContextParameters() {
    // They turn a term on and off: what a Context of the same Force had from the beginning, it has to the last bit.

    Membrane blob = createBlob(2);
    for (Term term : {Term::Tension, Term::Pressure})
        for (TermMask others : {TermMask(), Tether, ~TermMask(term)})
            for (double value : {0.0, 4.0, -2.5}) {
                HelfrichParameters p = createParameters(blob, others), changed = p;
                changed.moduli[term] = value;
                MembraneContext context(blob, p), other(blob, changed);
                const HelfrichForce& force = *context.forces[0];
                string name = (term == Term::Tension ? force.getTensionParameter() : force.getPressureParameter());
                ASSERT_EQUAL(string("HelfrichForce") + (term == Term::Tension ? "Tension" : "Pressure"), name);
                context.getForces();
                for (double before : {-7.0, 0.0, value})
                    context.context->setParameter(name, before);
                ASSERT_EQUAL(other.getEnergy(), context.getEnergy());
                ASSERT_EQUAL(value == 0, context.getTerms()[term] == 0);
                vector<Vec3> expected = other.getForces(), found = context.getForces();
                for (size_t i = 0; i < found.size(); i++)
                    ASSERT_EQUAL_VEC(expected[i], found[i], 0);
            }
}

void testUpdateParameters() {
    Membrane blob = createBlob(2);
    HelfrichParameters p = createParameters(blob, AllTerms, 1);
    MembraneContext context(blob, p);
    HelfrichForce& force = *context.forces[0];
    double before = context.getEnergy();
    p.moduli[Term::Bending] = 0;
    p.moduli[Term::Area] = 11;
    p.leafletSeparation = 0.13;
    p.tetherExponent = 2;
    p.tetherMinLength *= 0.9;
    p.tetherLengthScale *= 1.7;
    p.repulsionOnset *= 1.2;
    p.repulsionLengthScale *= 0.8;
    p.repulsionExclusionLevel = 2;
    force.setBendingModulus(p.moduli[Term::Bending]);
    force.setAreaModulus(p.moduli[Term::Area]);
    force.setLeafletSeparation(p.leafletSeparation);
    force.setTether(p.moduli[Term::Tether], p.tetherMinLength, p.tetherMaxLength, p.tetherExponent);
    force.setTetherLengthScale(p.tetherLengthScale);
    force.setRepulsion(p.moduli[Term::Repulsion], p.repulsionOnset, p.repulsionExponent, p.repulsionExclusionLevel);
    force.setRepulsionLengthScale(p.repulsionLengthScale);
    ASSERT_EQUAL(before, context.getEnergy());
    force.updateParametersInContext(*context.context);
    MembraneContext fresh(blob, p);
    ASSERT_EQUAL(fresh.getEnergy(), context.getEnergy());
    assertEqualVectors(fresh.getForces(), context.getForces(), 1e-13);
}

void testChangingTriangles() {
    // Many flips at once, by hand, and back: the forces follow, exclusions of the repulsion included.

    Membrane blob = createBlob(2), flipped = blob;
    HelfrichMesh mesh(blob.triangles, blob.positions.size());
    TestRandom random(8);
    for (int i = 0; i < 200; i++) {
        int h = random.index(mesh.getNumHalfedges());
        if (mesh.canFlip(h))
            mesh.flip(h);
    }
    flipped.triangles = mesh.getTriangles();
    for (int level = 0; level < 3; level++) {
        HelfrichParameters p = createParameters(blob, EveryTerm, level);
        MembraneContext context(blob, p), fresh(flipped, p);
        double before = context.getEnergy();
        context.forces[0]->setTrianglesInContext(*context.context, flipped.triangles);
        vector<array<int, 3>> live;
        context.forces[0]->getTrianglesInContext(*context.context, live);
        ASSERT_EQUAL_CONTAINERS(flipped.triangles, live);
        assertEqualRelative(fresh.getEnergy(), context.getEnergy(), 1e-12);
        assertEqualVectors(fresh.getForces(), context.getForces(), 1e-11);
        context.forces[0]->setTrianglesInContext(*context.context, blob.triangles);
        ASSERT_EQUAL(before, context.getEnergy());
    }
}

void checkRepulsion(MembraneContext& context, const Membrane& membrane, const HelfrichParameters& p) {
    auto exact = computeExactly(membrane, p);
    assertEqualRelative(exact[Term::Repulsion], context.getEnergy(membrane.positions), 1e-9);
    vector<int> some;
    for (int i = 0; i < (int) membrane.positions.size(); i += 5)
        some.push_back(i);
    vector<Vec3> expected = computeForcesExactly(membrane, p, some), forces = context.getForces(), found;
    for (int i : some)
        found.push_back(forces[i]);
    assertEqualVectors(expected, found, 1e-8);
}

void testRepulsionOfApproachingFaces() {
    // A sphere that is slowly pressed flat and lets go again.  A platform's list of neighbors, made when the faces were
    // far apart, must not miss them when they come close.

    Membrane blob = createBlob(2);
    HelfrichParameters p = createParameters(blob, Repulsion, 2);
    MembraneContext context(blob, p);
    for (double step : {0.002, 0.02, 0.06}) {
        double thickness = 3;
        for (bool isClosing : {true, false})
            while (isClosing ? thickness > 0.9 : thickness < 3) {
                thickness += isClosing ? -step : step;
                Membrane pressed = blob;
                for (auto& x : pressed.positions)
                    x[2] *= thickness;
                context.context->setPositions(pressed.positions);
                double exact = computeExactly(pressed, p)[Term::Repulsion];
                ASSERT_EQUAL_TOL(exact, context.getEnergy(pressed.positions), 1e-9);
            }
    }
}

void testRepulsionOfMovingVertices() {
    // Vertices that creep, jump and fly away, each for some time.

    TestRandom random(4);
    for (double amplitude : {0.02, 0.1, 0.3}) {
        Membrane blob = createBlob(2);
        HelfrichParameters p = createParameters(blob, Repulsion, 1);
        MembraneContext context(blob, p);
        for (int step = 0; step < 12; step++) {
            checkRepulsion(context, blob, p);
            for (auto& x : blob.positions)
                x += random.vector(amplitude * p.repulsionOnset);
        }
        blob.positions[7] += Vec3(1e3, 0, 0);
        checkRepulsion(context, blob, p);
        for (auto& x : blob.positions)
            x += Vec3(1e4, -1e5, 0);
        checkRepulsion(context, blob, p);
    }
}

void testPositionsThatAreNotFinite() {
    Membrane blob = createBlob(2);
    MembraneContext context(blob, createParameters(blob, AllTerms));
    double energy = context.getEnergy();
    for (double bad : {NAN, INFINITY}) {
        vector<Vec3> positions = blob.positions;
        positions[7][1] = bad;
        try {
            context.getEnergy(positions);
        }
        catch (const OpenMMException& error) {
            // OpenMM's CPU platform looks at the coordinates before we do.
            string message = error.what();
            ASSERT(message.find("particle 7") != string::npos || message.find("coordinate is NaN") != string::npos);
            ASSERT_EQUAL(energy, context.getEnergy(blob.positions));
            continue;
        }
        throwException(__FILE__, __LINE__, "positions that are not finite were accepted");
    }
}

#include "HelfrichExtremes.h"
#include "HelfrichSpeciesTests.h"

int main() {
    try {
        platform = &initializeTests();
        testExtremes();
        testEnergyAgainstEquations();
        testEveryTermIsAtWork();
        testGeometryAgainstEquations();
        testForcesAgainstEquations();
        testForcesAgainstCentralDifferences();
        testSmallAndLargeAngles();
        testScaling();
        testNoNetForceOrTorque();
        testTermsAddUp();
        testInvariance();
        testPotentialsHaveNoUnit();
        testSphere();
        testTwoMembranesAndOtherParticles();
        testSeveralSurfacesAgainstEquations();
        testEachSurfaceByItself();
        testTargetsOfSurfaces();
        testInvalidSurfaces();
        testTargetsAreContextParameters();
        testModuliThatAreContextParameters();
        testUpdateParameters();
        testChangingTriangles();
        testRepulsionOfApproachingFaces();
        testRepulsionOfMovingVertices();
        testPositionsThatAreNotFinite();
        testSpecies();
        runPlatformTests();
    }
    catch (const exception& e) {
        cout << "exception: " << e.what() << endl;
        return 1;
    }
    cout << "Done" << endl;
    return 0;
}
