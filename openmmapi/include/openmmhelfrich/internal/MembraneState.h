#ifndef OPENMM_HELFRICH_MEMBRANESTATE_H_
#define OPENMM_HELFRICH_MEMBRANESTATE_H_

#include "openmm/Integrator.h"
#include "openmm/serialization/SerializationNode.h"
#include <istream>
#include <ostream>
#include <vector>

namespace HelfrichPlugin {

class HelfrichForceImpl;

/**
 * The live state of a Context's membranes, as it is saved in checkpoints and in States.
 *
 * In OpenMM only Integrators can save something of their own.  So each Monte Carlo move offers to save the membranes,
 * whether it changes them or not, and one of them does: the first of the Context, which is a mixture of moves rather
 * than a move in it.
 */
class MembraneState {
public:
    /**
     * @param integrator  the Integrator that saves or loads something
     * @param context     its Context
     */
    MembraneState(const OpenMM::Integrator& integrator, OpenMM::ContextImpl& context);
    /**
     * Write the membranes to a checkpoint, or that they are in another place of it.
     */
    void createCheckpoint(std::ostream& stream) const;
    /**
     * Read what createCheckpoint() wrote.
     *
     * @return false, with the stream as it was, if there is something else: the checkpoint is of version 0.1.0
     */
    bool loadCheckpoint(std::istream& stream);
    /**
     * Read the membranes from a checkpoint of version 0.1.0, in which they are a part of what each EdgeFlipIntegrator
     * wrote.
     */
    void loadFirstCheckpoint(std::istream& stream);
    /**
     * Write the membranes to a child of a node, unless they are in another place of the State.
     */
    void serialize(OpenMM::SerializationNode& node) const;
    /**
     * Read what serialize() wrote.
     */
    void deserialize(const OpenMM::SerializationNode& node);
    /**
     * Read the membranes from a State of version 0.1.0, in which they are the children of an EdgeFlipIntegrator's node.
     */
    void deserializeFirst(const OpenMM::SerializationNode& node);
private:
    void readMembranes(std::istream& stream, size_t numMembranes);
    void readMembranes(const OpenMM::SerializationNode& parent);
    OpenMM::ContextImpl& context;
    std::vector<HelfrichForceImpl*> membranes;
    bool isHere, wasHere;
};

} // namespace HelfrichPlugin

#endif /*OPENMM_HELFRICH_MEMBRANESTATE_H_*/
