#include "openmmhelfrich/EdgeFlipIntegrator.h"
#include "openmmhelfrich/HelfrichSerialization.h"
#include "openmmhelfrich/internal/MonteCarloUtilities.h"
#include "openmm/internal/OSRngSeed.h"
#include "openmm/serialization/SerializationNode.h"
#include <cmath>

using namespace HelfrichPlugin;
using namespace OpenMM;
using namespace std;

/**
 * How often the vertices get a new order.  After so many sweeps vertices have moved by a few neighbors, and the order
 * costs less than one of them.
 */
static const int SWEEPS_PER_ORDER = 1000;

EdgeFlipIntegrator::EdgeFlipIntegrator(double temperature, double fraction) {
    setTemperature(temperature);
    setFraction(fraction);
    setStepSize(0);
    setConstraintTolerance(1e-5);
}

void EdgeFlipIntegrator::setTemperature(double temperature) {
    requirePositive("EdgeFlipIntegrator: the temperature in K", temperature, true);
    this->temperature = temperature;
}

void EdgeFlipIntegrator::setFraction(double fraction) {
    requirePositive("EdgeFlipIntegrator: the fraction", fraction, true);
    this->fraction = fraction;
}

void EdgeFlipIntegrator::setRandomNumberSeed(int seed) {
    randomNumberSeed = seed;
    if (context != NULL)
        activeSeed = (seed == 0 ? osrngseed() : seed);
}

void EdgeFlipIntegrator::initialize(ContextImpl& contextRef) {
    if (owner != NULL && &contextRef.getOwner() != owner)
        throw OpenMMException("This Integrator is already bound to a context");
    context = &contextRef;
    owner = &contextRef.getOwner();
    activeSeed = (randomNumberSeed == 0 ? osrngseed() : randomNumberSeed);
    numSweeps = numAttempted = numAccepted = numForbidden = 0;
    membranes.clear();
    for (ForceImpl* impl : context->getForceImpls())
        if (HelfrichForceImpl* membrane = dynamic_cast<HelfrichForceImpl*>(impl))
            membranes.push_back(membrane);
    if (membranes.empty())
        throw OpenMMException("EdgeFlipIntegrator: the System has no HelfrichForce whose edges could flip");
}

void EdgeFlipIntegrator::cleanup() {
    membranes.clear();
}

vector<string> EdgeFlipIntegrator::getKernelNames() {
    return {SweepEdgeFlipsKernel::Name()};
}

void EdgeFlipIntegrator::step(int steps) {
    if (context == NULL)
        throw OpenMMException("This Integrator is not bound to a context!");
    for (int i = 0; i < steps; i++) {
        for (int n = 0; n < (int) membranes.size(); n++) {
            HelfrichForceImpl& membrane = *membranes[n];
            if ((getIntegrationForceGroups() & (1 << membrane.getOwner().getForceGroup())) == 0)
                continue;
            long long numAttempts = llround(fraction * membrane.getMesh().getNumEdges());
            EdgeFlipStatistics statistics =
                    membrane.flipEdges(*context, BOLTZMANN * temperature, numAttempts,
                                       Philox(activeSeed, RandomStream::EdgeFlips + n), numSweeps);
            numAttempted += statistics.attempted;
            numAccepted += statistics.accepted;
            numForbidden += statistics.forbidden;
        }
        numSweeps++;
        if (numSweeps % SWEEPS_PER_ORDER == 0)
            for (auto membrane : membranes)
                membrane->getMesh().renewOrder();
        context->setStepCount(context->getStepCount() + 1);
    }
}

double EdgeFlipIntegrator::getFlipRate() const {
    long long numEdges = 0;
    for (auto membrane : membranes)
        numEdges += membrane->getMesh().getNumEdges();
    return numEdges == 0 || numSweeps == 0 ? 0 : numAccepted / ((double) numEdges * numSweeps);
}

double EdgeFlipIntegrator::computeKineticEnergy() {
    return HelfrichPlugin::computeKineticEnergy(*context);
}

bool EdgeFlipIntegrator::kineticEnergyRequiresForce() const {
    return false;
}

void EdgeFlipIntegrator::createCheckpoint(ostream& stream) const {
    writeBinary(stream, activeSeed);
    writeBinary(stream, numSweeps);
    writeBinary(stream, numAttempted);
    writeBinary(stream, numAccepted);
    writeBinary(stream, numForbidden);
    writeBinary(stream, (long long) membranes.size());
    for (auto membrane : membranes) {
        auto triangles = membrane->getMesh().getTriangles();
        writeBinary(stream, (long long) triangles.size());
        stream.write((const char*) triangles.data(), sizeof(triangles[0]) * triangles.size());
        const vector<int>& order = membrane->getMesh().getOrder();
        stream.write((const char*) order.data(), sizeof(int) * order.size());
    }
}

void EdgeFlipIntegrator::loadCheckpoint(istream& stream) {
    long long numMembranes, numTriangles;
    readBinary(stream, activeSeed);
    readBinary(stream, numSweeps);
    readBinary(stream, numAttempted);
    readBinary(stream, numAccepted);
    readBinary(stream, numForbidden);
    readBinary(stream, numMembranes);
    if (numMembranes != (long long) membranes.size())
        throw OpenMMException(
                "EdgeFlipIntegrator: the checkpoint is of a System with another number of HelfrichForces");
    for (auto membrane : membranes) {
        readBinary(stream, numTriangles);
        if (numTriangles != membrane->getMesh().getNumTriangles())
            throw OpenMMException("EdgeFlipIntegrator: the checkpoint is of a membrane with " +
                                  to_string(numTriangles) + " triangles, and " + membrane->getOwner().getName() +
                                  " has " + to_string(membrane->getMesh().getNumTriangles()));
        vector<array<int, 3>> triangles(numTriangles);
        if (!stream.read((char*) triangles.data(), sizeof(triangles[0]) * numTriangles))
            throw OpenMMException("EdgeFlipIntegrator: the checkpoint ends too early");
        vector<int> order(membrane->getMesh().getNumVertices());
        if (!stream.read((char*) order.data(), sizeof(int) * order.size()))
            throw OpenMMException("EdgeFlipIntegrator: the checkpoint ends too early");
        membrane->restore(*context, triangles, order);
    }
}

void EdgeFlipIntegrator::serializeParameters(SerializationNode& node) const {
    node.setIntProperty("version", 1);
    node.setIntProperty("activeSeed", (int) activeSeed);
    node.setLongProperty("numSweeps", numSweeps);
    node.setLongProperty("numAttempted", numAttempted);
    node.setLongProperty("numAccepted", numAccepted);
    node.setLongProperty("numForbidden", numForbidden);
    for (auto membrane : membranes) {
        SerializationNode& child = node.createChildNode("Triangles");
        storeTriangles(membrane->getMesh().getTriangles(), child);
        storeIntegers(membrane->getMesh().getOrder(), "vertices", child.createChildNode("Order"));
    }
}

void EdgeFlipIntegrator::deserializeParameters(const SerializationNode& node) {
    requireVersion(node, 1, "EdgeFlipIntegrator");
    const vector<SerializationNode>& children = node.getChildren();
    if (children.size() != membranes.size())
        throw OpenMMException("EdgeFlipIntegrator: the State is of a System with " + to_string(children.size()) +
                              " HelfrichForces, and this one has " + to_string(membranes.size()));
    for (size_t i = 0; i < membranes.size(); i++)
        membranes[i]->restore(*context, loadTriangles(children[i]),
                              loadIntegers("vertices", children[i].getChildNode("Order")));
    activeSeed = (unsigned int) node.getIntProperty("activeSeed");
    numSweeps = node.getLongProperty("numSweeps");
    numAttempted = node.getLongProperty("numAttempted");
    numAccepted = node.getLongProperty("numAccepted");
    numForbidden = node.getLongProperty("numForbidden");
}
