#ifndef OPENMM_HELFRICH_TRAJECTORYSTART_H_
#define OPENMM_HELFRICH_TRAJECTORYSTART_H_

#include "MonteCarloUtilities.h"
#include "Philox.h"
#include "openmm/Vec3.h"
#include <cmath>
#include <vector>

namespace HelfrichPlugin {

/**
 * The positions and velocities before a trajectory, and the draw of those with which it begins.  As random numbers can
 * be drawn again, one copy of the velocities is enough to go back to either.
 */
class TrajectoryStart {
public:
    /**
     * Keep what there is before a trajectory.
     *
     * @param positions    the positions
     * @param velocities   the velocities before the draw
     * @param refreshment  the factor of the velocities drawn; those that there are get the factor sqrt(1-refreshment^2)
     * @param random       the source of random numbers
     * @param trajectory   the number of the trajectory
     */
    void keep(const std::vector<OpenMM::Vec3>& positions, const std::vector<OpenMM::Vec3>& velocities,
              double refreshment, const Philox& random, long long trajectory) {
        this->positions = positions;
        this->velocities = velocities;
        this->refreshment = refreshment;
        this->random = random;
        this->trajectory = trajectory;
    }
    /**
     * Draw the velocity with which a particle begins the trajectory.
     *
     * @param particle   the index of the particle
     * @param deviation  the standard deviation of each component, sqrt(kT/m)
     */
    OpenMM::Vec3 drawVelocity(int particle, double deviation) const {
        return velocities[particle] * std::sqrt(1 - refreshment * refreshment) +
               drawNormals(random, trajectory, particle) * (refreshment * deviation);
    }
    const std::vector<OpenMM::Vec3>& getPositions() const {
        return positions;
    }
    const std::vector<OpenMM::Vec3>& getVelocities() const {
        return velocities;
    }
private:
    std::vector<OpenMM::Vec3> positions, velocities;
    double refreshment = 1;
    Philox random = Philox(0, 0);
    long long trajectory = 0;
};

} // namespace HelfrichPlugin

#endif /*OPENMM_HELFRICH_TRAJECTORYSTART_H_*/
