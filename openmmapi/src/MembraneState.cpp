#include "openmmhelfrich/internal/MembraneState.h"
#include "openmmhelfrich/EdgeFlipIntegrator.h"
#include "openmmhelfrich/internal/MonteCarloUtilities.h"
#include "openmm/CompoundIntegrator.h"

using namespace HelfrichPlugin;
using namespace OpenMM;
using namespace std;

/**
 * What membranes begin with in a checkpoint.  No counter or number of membranes of version 0.1.0 reads like it.
 */
static const char MAGIC_BYTES[] = "HlfMembr";

/**
 * Find the Integrator that saves the membranes, among one and those that it is made of.
 */
static const Integrator* findSaver(const Integrator& integrator) {
    if (dynamic_cast<const MonteCarloMove*>(&integrator) != NULL)
        return &integrator;
    const Integrator* saver = NULL;
    if (auto compound = dynamic_cast<const CompoundIntegrator*>(&integrator))
        for (int i = 0; i < compound->getNumIntegrators() && saver == NULL; i++)
            saver = findSaver(compound->getIntegrator(i));
    return saver;
}

MembraneState::MembraneState(const Integrator& integrator, ContextImpl& context)
        : context(context), membranes(findMembranes(context)),
          isHere(findSaver(context.getIntegrator()) == &integrator),
          wasHere(dynamic_cast<const EdgeFlipIntegrator*>(&integrator) != NULL) {
}

void MembraneState::createCheckpoint(ostream& stream) const {
    writeMagic(stream, MAGIC_BYTES);
    writeBinary(stream, (long long) (isHere ? membranes.size() : 0));
    if (isHere)
        for (auto membrane : membranes)
            membrane->createCheckpoint(stream);
}

bool MembraneState::loadCheckpoint(istream& stream) {
    if (!readMagic(stream, MAGIC_BYTES))
        return false;
    readMembranes(stream, isHere ? membranes.size() : 0);
    return true;
}

void MembraneState::loadFirstCheckpoint(istream& stream) {
    if (wasHere)
        readMembranes(stream, membranes.size());
}

void MembraneState::readMembranes(istream& stream, size_t numMembranes) {
    long long found;
    readBinary(stream, found);
    if (found != (long long) numMembranes)
        throw OpenMMException("loadCheckpoint: the checkpoint is of a System with another number of HelfrichForces, or "
                              "of other Integrators");
    for (size_t i = 0; i < numMembranes; i++)
        membranes[i]->loadCheckpoint(context, stream);
}

void MembraneState::serialize(SerializationNode& node) const {
    if (!isHere)
        return;
    SerializationNode& parent = node.createChildNode("Membranes");
    for (auto membrane : membranes)
        membrane->serializeState(parent.createChildNode("Triangles"));
}

void MembraneState::deserialize(const SerializationNode& node) {
    if (isHere)
        readMembranes(node.getChildNode("Membranes"));
}

void MembraneState::deserializeFirst(const SerializationNode& node) {
    if (wasHere)
        readMembranes(node);
}

void MembraneState::readMembranes(const SerializationNode& parent) {
    const vector<SerializationNode>& nodes = parent.getChildren();
    if (nodes.size() != membranes.size())
        throw OpenMMException("HelfrichForce: the State is of a System with " + to_string(nodes.size()) +
                              " HelfrichForces, and this one has " + to_string(membranes.size()));
    for (size_t i = 0; i < membranes.size(); i++)
        membranes[i]->deserializeState(context, nodes[i]);
}
