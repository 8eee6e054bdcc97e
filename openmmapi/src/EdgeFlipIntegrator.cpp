#include "openmmhelfrich/EdgeFlipIntegrator.h"
#include "openmmhelfrich/internal/HelfrichForceImpl.h"
#include "openmm/OpenMMException.h"
#include "openmm/System.h"
#include "openmm/internal/ContextImpl.h"
#include "openmm/internal/OSRngSeed.h"
#include "openmm/serialization/SerializationNode.h"
#include <cmath>
#include <sstream>

using namespace HelfrichPlugin;
using namespace OpenMM;
using namespace std;

static const double BOLTZMANN = 8.31446261815324e-3;

EdgeFlipIntegrator::EdgeFlipIntegrator(double temperature, double fraction) {
    setTemperature(temperature);
    setFraction(fraction);
    setStepSize(0);
}

void EdgeFlipIntegrator::setTemperature(double temperature) {
    if (!(temperature >= 0 && isfinite(temperature)))
        throw OpenMMException("EdgeFlipIntegrator: the temperature is "+to_string(temperature)+" K; it must be finite and not negative");
    this->temperature = temperature;
}

void EdgeFlipIntegrator::setFraction(double fraction) {
    if (!(fraction >= 0 && isfinite(fraction)))
        throw OpenMMException("EdgeFlipIntegrator: the fraction is "+to_string(fraction)+"; it must be finite and not negative");
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
    return {};
}

void EdgeFlipIntegrator::step(int steps) {
    if (context == NULL)
        throw OpenMMException("This Integrator is not bound to a context!");
    for (int i = 0; i < steps; i++) {
        for (int n = 0; n < (int) membranes.size(); n++) {
            HelfrichForceImpl& membrane = *membranes[n];
            if ((getIntegrationForceGroups()&(1<<membrane.getOwner().getForceGroup())) == 0)
                continue;
            long long numAttempts = llround(fraction*membrane.getMesh().getNumEdges());
            EdgeFlipStatistics statistics = membrane.flipEdges(*context, BOLTZMANN*temperature, numAttempts, Philox(activeSeed, RandomStream::EdgeFlips+n), numSweeps);
            numAttempted += statistics.attempted;
            numAccepted += statistics.accepted;
            numForbidden += statistics.forbidden;
        }
        numSweeps++;
        context->setStepCount(context->getStepCount()+1);
    }
}

double EdgeFlipIntegrator::computeKineticEnergy() {
    const System& system = context->getSystem();
    vector<Vec3> velocities;
    context->getVelocities(velocities);
    double energy = 0;
    for (int i = 0; i < system.getNumParticles(); i++)
        energy += 0.5*system.getParticleMass(i)*velocities[i].dot(velocities[i]);
    return energy;
}

bool EdgeFlipIntegrator::kineticEnergyRequiresForce() const {
    return false;
}

template <class T>
static void write(ostream& stream, const T& value) {
    stream.write((const char*) &value, sizeof(T));
}

template <class T>
static T read(istream& stream) {
    T value;
    if (!stream.read((char*) &value, sizeof(T)))
        throw OpenMMException("EdgeFlipIntegrator: the checkpoint ends too early");
    return value;
}

void EdgeFlipIntegrator::createCheckpoint(ostream& stream) const {
    write(stream, activeSeed);
    write(stream, numSweeps);
    write(stream, numAttempted);
    write(stream, numAccepted);
    write(stream, numForbidden);
    write(stream, (long long) membranes.size());
    for (auto membrane : membranes) {
        auto triangles = membrane->getMesh().getTriangles();
        write(stream, (long long) triangles.size());
        stream.write((const char*) triangles.data(), sizeof(triangles[0])*triangles.size());
    }
}

void EdgeFlipIntegrator::loadCheckpoint(istream& stream) {
    activeSeed = read<unsigned int>(stream);
    numSweeps = read<long long>(stream);
    numAttempted = read<long long>(stream);
    numAccepted = read<long long>(stream);
    numForbidden = read<long long>(stream);
    if (read<long long>(stream) != (long long) membranes.size())
        throw OpenMMException("EdgeFlipIntegrator: the checkpoint is of a System with another number of HelfrichForces");
    for (auto membrane : membranes) {
        long long numTriangles = read<long long>(stream);
        if (numTriangles != membrane->getMesh().getNumTriangles())
            throw OpenMMException("EdgeFlipIntegrator: the checkpoint is of a membrane with "+to_string(numTriangles)+" triangles, and "+
                                  membrane->getOwner().getName()+" has "+to_string(membrane->getMesh().getNumTriangles()));
        vector<array<int, 3> > triangles(numTriangles);
        if (!stream.read((char*) triangles.data(), sizeof(triangles[0])*numTriangles))
            throw OpenMMException("EdgeFlipIntegrator: the checkpoint ends too early");
        membrane->setTriangles(*context, triangles);
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
        stringstream indices;
        for (auto& t : membrane->getMesh().getTriangles())
            indices << t[0] << ' ' << t[1] << ' ' << t[2] << ' ';
        node.createChildNode("Triangles").setStringProperty("particles", indices.str());
    }
}

static vector<array<int, 3> > parseTriangles(const string& text) {
    vector<array<int, 3> > triangles;
    stringstream stream(text);
    array<int, 3> t;
    while (stream >> t[0] >> t[1] >> t[2])
        triangles.push_back(t);
    if (!stream.eof())
        throw OpenMMException("EdgeFlipIntegrator: the triangles of the State are damaged after number "+to_string(triangles.size()));
    return triangles;
}

void EdgeFlipIntegrator::deserializeParameters(const SerializationNode& node) {
    if (node.getIntProperty("version") != 1)
        throw OpenMMException("EdgeFlipIntegrator: unsupported version "+to_string(node.getIntProperty("version"))+" of the State's integrator parameters");
    const vector<SerializationNode>& children = node.getChildren();
    if (children.size() != membranes.size())
        throw OpenMMException("EdgeFlipIntegrator: the State is of a System with "+to_string(children.size())+" HelfrichForces, and this one has "+
                              to_string(membranes.size()));
    for (size_t i = 0; i < membranes.size(); i++)
        membranes[i]->setTriangles(*context, parseTriangles(children[i].getStringProperty("particles")));
    activeSeed = (unsigned int) node.getIntProperty("activeSeed");
    numSweeps = node.getLongProperty("numSweeps");
    numAttempted = node.getLongProperty("numAttempted");
    numAccepted = node.getLongProperty("numAccepted");
    numForbidden = node.getLongProperty("numForbidden");
}
