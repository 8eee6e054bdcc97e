#include "openmmhelfrich/EdgeFlipIntegrator.h"
#include "openmmhelfrich/internal/Interruption.h"
#include "openmmhelfrich/internal/MonteCarloUtilities.h"
#include <algorithm>
#include <cmath>
#include <sstream>

using namespace HelfrichPlugin;
using namespace OpenMM;
using namespace std;

/**
 * How often the vertices get a new order.  After so many sweeps vertices have moved by a few neighbors, and the order
 * costs less than one of them.
 */
static const int SWEEPS_PER_ORDER = 1000;

EdgeFlipIntegrator::EdgeFlipIntegrator(double temperature, double fraction)
        : MonteCarloIntegrator("EdgeFlipIntegrator", temperature, true) {
    setFraction(fraction);
}

void EdgeFlipIntegrator::setFraction(double fraction) {
    requirePositive("EdgeFlipIntegrator: the fraction", fraction, true);
    this->fraction = fraction;
}

void EdgeFlipIntegrator::initialize(ContextImpl& contextRef) {
    hasHiddenMembranes = findHiddenMembrane(contextRef.getSystem()) != NULL;
    if (!hasHiddenMembranes && findMembranes(contextRef).empty())
        throw OpenMMException("EdgeFlipIntegrator: the System has no HelfrichForce whose edges could flip");
    MonteCarloIntegrator::initialize(contextRef);
    if (&contextRef.getIntegrator() == this)
        requireLiveMembranes();
}

void EdgeFlipIntegrator::requireLiveMembranes() const {
    if (fraction > 0 && hasHiddenMembranes)
        throw OpenMMException("EdgeFlipIntegrator: the HelfrichForce '" +
                              findHiddenMembrane(context->getSystem())->getName() +
                              "' is inside another Force of the System, where it would keep the triangles that it "
                              "began with; add it to the System itself, or let no edges flip: set the flip fraction or "
                              "the flip probability to 0");
}

vector<string> EdgeFlipIntegrator::getKernelNames() {
    return {SweepEdgeFlipsKernel::Name()};
}

long long EdgeFlipIntegrator::getNumAttempts(const HelfrichMesh& mesh) const {
    double numAttempts = fraction * mesh.getNumEdges();
    requireAtMost("EdgeFlipIntegrator: the number of attempts in a sweep", numAttempts,
                  SweepEdgeFlipsKernel::MAX_ATTEMPTS);
    return max(llround(numAttempts), numAttempts > 0 ? 1LL : 0LL);
}

void EdgeFlipIntegrator::makeMove() {
    requireLiveMembranes();
    bool isLong = false;
    for (auto membrane : getMembranes())
        isLong |= SweepEdgeFlipsKernel::isLong(getNumAttempts(membrane->getMesh()), membrane->getMesh());
    EdgeFlipStatistics statistics = (isLong ? sweepOrRestore() : sweep());
    numAttempted += statistics.attempted;
    numAccepted += statistics.accepted;
    numForbidden += statistics.forbidden;
    numSweeps++;
    if (numSweeps % SWEEPS_PER_ORDER == 0)
        for (auto membrane : getMembranes())
            membrane->getMesh().renewOrder();
}

EdgeFlipStatistics EdgeFlipIntegrator::sweep() {
    EdgeFlipStatistics total;
    for (int n = 0; n < (int) getMembranes().size(); n++) {
        HelfrichForceImpl& membrane = *getMembranes()[n];
        if (!isIntegrated(membrane))
            continue;
        EdgeFlipStatistics statistics =
                membrane.flipEdges(*context, getThermalEnergy(), getNumAttempts(membrane.getMesh()),
                                   getRandom(RandomStream::EdgeFlips + n), numSweeps);
        total.attempted += statistics.attempted;
        total.accepted += statistics.accepted;
        total.forbidden += statistics.forbidden;
    }
    return total;
}

EdgeFlipStatistics EdgeFlipIntegrator::sweepOrRestore() {
    stringstream before;
    for (auto membrane : getMembranes())
        membrane->createCheckpoint(before);
    try {
        return sweep();
    }
    catch (const StepInterrupted&) {
        for (auto membrane : getMembranes())
            membrane->loadCheckpoint(*context, before);
        throw;
    }
}

double EdgeFlipIntegrator::getFlipRate() const {
    long long numEdges = 0;
    for (auto membrane : getMembranes())
        numEdges += membrane->getMesh().getNumEdges();
    return numEdges == 0 || numSweeps == 0 ? 0 : numAccepted / ((double) numEdges * numSweeps);
}
