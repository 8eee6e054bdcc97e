#ifndef OPENMM_MONTECARLOMOVE_H_
#define OPENMM_MONTECARLOMOVE_H_

#include "internal/windowsExportHelfrich.h"
#include "openmm/Integrator.h"
#include "openmm/serialization/SerializationNode.h"
#include <deque>
#include <istream>
#include <ostream>
#include <string>
#include <utility>

namespace HelfrichPlugin {

class Philox;

/**
 * What an Integrator has whose steps are Monte Carlo moves, which leave the Boltzmann distribution at a temperature as
 * it is: MonteCarloIntegrator and the classes derived from it, and those that OpenMM's own Integrators are the base of.
 */
class OPENMM_EXPORT_HELFRICH MonteCarloMove {
public:
    MonteCarloMove() = default;
    MonteCarloMove(const MonteCarloMove&) = delete;
    virtual ~MonteCarloMove() {
    }
    /**
     * Get the temperature, in Kelvin.
     */
    virtual double getTemperature() const = 0;
    /**
     * Set the temperature, in Kelvin.
     */
    virtual void setTemperature(double temperature) = 0;
    /**
     * Get the random number seed.
     */
    virtual int getRandomNumberSeed() const = 0;
    /**
     * Set the random number seed.  If it is 0 (the default), a unique one is chosen when a Context is created.
     */
    virtual void setRandomNumberSeed(int seed) = 0;
    /**
     * Get the number of moves attempted since the Context was created.
     */
    virtual long long getNumAttempted() const = 0;
    /**
     * Get the number of moves accepted since the Context was created.
     */
    virtual long long getNumAccepted() const = 0;
    /**
     * Get the fraction of attempted moves that were accepted, or 0 if there was none.
     */
    double getAcceptanceRate() const {
        return getNumAttempted() == 0 ? 0 : getNumAccepted() / (double) getNumAttempted();
    }
protected:
    /**
     * Begin what a move writes to a checkpoint with the name of its class.
     */
    static void writeName(std::ostream& stream, const std::string& name);
    /**
     * Read what writeName() wrote.  An exception is thrown if it is the name of another class.
     *
     * @return false, with the stream as it was, if there is no name: the checkpoint is older than names are
     */
    static bool readName(std::istream& stream, const std::string& name);
    /**
     * Throw an exception if a checkpoint without names goes on after what the only Integrator of a Context has read, so
     * that another class wrote it.
     */
    static void requireEnd(std::istream& stream, const OpenMM::Integrator& integrator, OpenMM::ContextImpl& context,
                           const std::string& name);
    /**
     * Throw an exception if an Integrator is bound to no Context.
     */
    static void requireContext(const OpenMM::ContextImpl* context);
    /**
     * Declare something that this move counts.
     *
     * @param name  its name in States; in checkpoints, counters are in the order of declaration
     * @return the number, which lasts as long as this object
     */
    long long& addCounter(const std::string& name);
    /**
     * Set all counters to 0.
     */
    void resetCounters();
    void writeCounters(std::ostream& stream) const;
    void readCounters(std::istream& stream);
    void storeCounters(OpenMM::SerializationNode& node) const;
    void loadCounters(const OpenMM::SerializationNode& node);
private:
    std::deque<std::pair<std::string, long long>> counters;
};

/**
 * What an Integrator has whose random numbers come from a counter-based generator: a seed.  With the counters it is the
 * whole state of the generator.
 */
class OPENMM_EXPORT_HELFRICH SeededMove : public virtual MonteCarloMove {
public:
    /**
     * Get the random number seed.  See setRandomNumberSeed() for details.
     */
    int getRandomNumberSeed() const {
        return randomNumberSeed;
    }
    /**
     * Set the random number seed.  Two simulations with the same seed draw the same random numbers, whatever the
     * platform and the number of threads.  If the seed is 0 (the default), a unique one is chosen when a Context is
     * created.
     */
    void setRandomNumberSeed(int seed);
protected:
    /**
     * Bind an Integrator to a Context, with the seed and all counters as they are at first.
     *
     * @param newContext  the Context
     * @param context     that of the Integrator, which is to be the new one
     * @param owner       its owner
     */
    void bind(OpenMM::ContextImpl& newContext, OpenMM::ContextImpl*& context, OpenMM::Context*& owner);
    /**
     * Get one of the streams of random numbers of the seed.  See RandomStream for those that there are.
     */
    Philox getRandom(unsigned int stream) const;
    void writeSeedAndCounters(std::ostream& stream) const;
    void readSeedAndCounters(std::istream& stream);
    void storeSeedAndCounters(OpenMM::SerializationNode& node) const;
    void loadSeedAndCounters(const OpenMM::SerializationNode& node);
private:
    int randomNumberSeed = 0;
    unsigned int activeSeed = 0;
};

} // namespace HelfrichPlugin

#endif /*OPENMM_MONTECARLOMOVE_H_*/
