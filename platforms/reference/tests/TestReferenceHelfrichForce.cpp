#include "ReferenceHelfrichEnergy.h"
#include "TestHelfrichForce.h"
#include <limits>

extern "C" void registerHelfrichReferenceKernelFactories();

OpenMM::Platform& initializeTests() {
    registerHelfrichReferenceKernelFactories();
    return Platform::getPlatform("Reference");
}

void testRoundedOnce() {
    // Energies and forces are those of extended precision, rounded to double: other platforms' errors are measured
    // against them.

    if (sizeof(ReferenceHelfrichEnergy::Real) == sizeof(double))
        return;
    const double halfUnit = 0.5 * numeric_limits<double>::epsilon();
    Membrane blob = createBlob(2);
    vector<int> some;
    for (int i = 0; i < (int) blob.positions.size(); i += 7)
        some.push_back(i);
    for (auto& p : createAllParameters(blob)) {
        MembraneContext context(blob, p);
        HelfrichEnergyTerms terms = context.getTerms();
        auto exact = computeExactly(blob, p);
        for (int i = 0; i < NUM_TERMS; i++) {
            long double expected = exact[Term(i)];
            ASSERT(fabsl(terms[Term(i)] - expected) <= 1.01L * halfUnit * fabsl(expected));
        }
        vector<Vec3> forces = context.getForces(), someForces;
        for (int i : some)
            someForces.push_back(forces[i]);
        assertEqualVectors(computeForcesExactly(blob, p, some), someForces, 1.01 * 2 * halfUnit);
    }
}

void runPlatformTests() {
    testRoundedOnce();
}
