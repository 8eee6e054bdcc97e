#ifndef OPENMM_TRAJECTORYMOVE_H_
#define OPENMM_TRAJECTORYMOVE_H_

#include "MonteCarloMove.h"
#include "internal/windowsExportHelfrich.h"

namespace HelfrichPlugin {

class HybridMonteCarloIntegrator;

/**
 * What an Integrator has whose moves are the trajectories of Hybrid Monte Carlo: it counts them.
 */
class OPENMM_EXPORT_HELFRICH TrajectoryMove : public virtual MonteCarloMove {
public:
    /**
     * Get the number of trajectories made since the Context was created.
     */
    long long getNumTrajectories() const {
        return numTrajectories;
    }
    /**
     * Get the number of trajectories made since the Context was created, as getNumTrajectories() does.
     */
    long long getNumAttempted() const {
        return numTrajectories;
    }
    /**
     * Get the number of trajectories accepted since the Context was created.
     */
    long long getNumAccepted() const {
        return numAccepted;
    }
    /**
     * Get the number of trajectories since the Context was created that were rejected because they diverged.
     */
    long long getNumDiverged() const {
        return numDiverged;
    }
protected:
    // The Integrator has made the base before; compilers are told so.
    TrajectoryMove() : MonteCarloMove() {
    }
    // In files of version 0.1.0 the counters are the mixture's.
    friend class HybridMonteCarloIntegrator;
    long long &numTrajectories = addCounter("numTrajectories"), &numAccepted = addCounter("numAccepted"),
              &numDiverged = addCounter("numDiverged");
};

} // namespace HelfrichPlugin

#endif /*OPENMM_TRAJECTORYMOVE_H_*/
