#ifndef OPENMM_HELFRICH_TRAJECTORYSTART_H_
#define OPENMM_HELFRICH_TRAJECTORYSTART_H_

#include "MonteCarloUtilities.h"
#include "Philox.h"
#include "openmm/Vec3.h"
#include <cmath>
#include <vector>

namespace HelfrichPlugin {

/**
 * The positions and velocities at the start of a trajectory, to which it returns when it is rejected.
 */
class TrajectoryStart {
public:
    /**
     * Draw the velocity of a particle.
     *
     * @param velocity     the velocity that it has
     * @param deviation    the standard deviation of each component, sqrt(kT/m)
     * @param refreshment  the factor of the velocity drawn; that which it has gets the factor sqrt(1-refreshment^2)
     * @param random       the source of random numbers
     * @param trajectory   the number of the trajectory
     * @param particle     the index of the particle
     */
    static OpenMM::Vec3 drawVelocity(const OpenMM::Vec3& velocity, double deviation, double refreshment,
                                     const Philox& random, long long trajectory, int particle) {
        return velocity * std::sqrt(1 - refreshment * refreshment) +
               drawNormals(random, trajectory, particle) * (refreshment * deviation);
    }
    void keep(const std::vector<OpenMM::Vec3>& positions, const std::vector<OpenMM::Vec3>& velocities) {
        this->positions = positions;
        this->velocities = velocities;
    }
    /**
     * Get the positions as they were kept, and the velocities reversed.
     */
    void restore(std::vector<OpenMM::Vec3>& positions, std::vector<OpenMM::Vec3>& velocities) const {
        positions = this->positions;
        for (size_t i = 0; i < velocities.size(); i++)
            velocities[i] = -this->velocities[i];
    }
private:
    std::vector<OpenMM::Vec3> positions, velocities;
};

} // namespace HelfrichPlugin

#endif /*OPENMM_HELFRICH_TRAJECTORYSTART_H_*/
