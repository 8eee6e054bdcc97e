#ifndef OPENMM_HAMILTONIANTRAJECTORYINTEGRATOR_H_
#define OPENMM_HAMILTONIANTRAJECTORYINTEGRATOR_H_

#include "MonteCarloIntegrator.h"
#include "TrajectoryMove.h"
#include "internal/windowsExportHelfrich.h"
#include "openmm/Kernel.h"
#include <string>
#include <vector>

namespace HelfrichPlugin {

struct CoarseVelocity;
struct KickAndDrift;
class KickAndDriftSequence;

/**
 * This Integrator samples the positions of the particles at constant temperature by Hybrid Monte Carlo (Duane et al.,
 * Phys. Lett. B 195, 216, 1987).  One step is one trajectory: draw velocities from the Maxwell-Boltzmann distribution,
 * or a part of them, make steps of leapfrog or another splitting, and accept the end point with probability min(1,
 * exp(-dH/kT)); otherwise go back to the start.  A trajectory on which an energy or a position stops being finite is
 * rejected.
 *
 * Particles of mass 0 do not move.  Constraints and virtual sites are not supported.
 */
class OPENMM_EXPORT_HELFRICH HamiltonianTrajectoryIntegrator : public MonteCarloIntegrator, public TrajectoryMove {
public:
    /**
     * Create a HamiltonianTrajectoryIntegrator.
     *
     * @param temperature         the temperature, in Kelvin
     * @param stepSize            the size of a step, in ps
     * @param stepsPerTrajectory  the number of steps in a trajectory
     */
    HamiltonianTrajectoryIntegrator(double temperature, double stepSize, int stepsPerTrajectory = 100);
    /**
     * Set the size of a step, in ps.
     */
    void setStepSize(double size);
    /**
     * Get the number of steps in a trajectory.
     */
    int getStepsPerTrajectory() const {
        return stepsPerTrajectory;
    }
    /**
     * Set the number of steps in a trajectory: the number of times that it computes the forces.
     */
    void setStepsPerTrajectory(int steps);
    /**
     * Get the precision in which trajectories compute forces.  See setForcePrecision() for details.
     */
    const std::string& getForcePrecision() const {
        return forcePrecision;
    }
    /**
     * Set the precision in which trajectories compute forces: "double" (the default) or "mixed".  With "mixed", areas,
     * angles and forces of single vertices may be computed in single precision, which is faster; positions, velocities,
     * sums over vertices and the energies at both ends stay in double precision.
     *
     * This does not change what is sampled.  The forces remain a function of the positions alone, so that trajectories
     * remain reversible and preserve volume in phase space, and the test that accepts them uses exact energies: errors
     * of the forces cost acceptance only, and they are far below those of a leapfrog step.
     *
     * On the CPU platform it has an effect where a HelfrichForce is the only Force of the System and its surface has
     * all particles.  Elsewhere forces are computed as with "double".
     */
    void setForcePrecision(const std::string& precision);
    /**
     * Get the largest fraction by which the number of steps in a trajectory varies at random.
     */
    double getTrajectoryJitter() const {
        return trajectoryJitter;
    }
    /**
     * Set the largest fraction by which the number of steps in a trajectory varies at random, from 0 (the default) to
     * less than 1.  The numbers are uniformly distributed between (1-jitter) and (1+jitter) times
     * getStepsPerTrajectory(), and depend on nothing but the seed and the number of the trajectory.
     */
    void setTrajectoryJitter(double jitter);
    /**
     * Get the name of the splitting that trajectories follow.
     */
    const std::string& getSplitting() const {
        return splitting;
    }
    /**
     * Set the splitting that trajectories follow.  All are reversible, preserve volume and have an error of second
     * order in the step size; more stages have smaller errors for the same cost.  So that trajectories of the same
     * settings have the same length and cost, one step of several stages takes the place of as many steps of leapfrog:
     * it computes forces that many times and is that many step sizes long, and trajectories are rounded up to whole
     * ones.
     *
     * @param splitting  "leapfrog" (the default), "bcss2" or "bcss3": the two- and three-stage splittings of Blanes,
     * Casas and Sanz-Serna, SIAM J. Sci. Comput. 36, A1556 (2014)
     */
    void setSplitting(const std::string& splitting);
    /**
     * Get how often the tether acts for each time that everything else does.
     */
    int getTetherSubsteps() const {
        return tetherSubsteps;
    }
    /**
     * Set how often the tether of the membranes acts for each time that everything else does: 1 by default.  A tether
     * is cheap to compute, and stiffer than the rest: with several substeps (r-RESPA; Tuckerman, Berne and Martyna, J.
     * Chem. Phys. 97, 1990, 1992) the step size, that of all other forces, can be longer.  Trajectories remain
     * reversible and preserve volume.
     */
    void setTetherSubsteps(int substeps);
    /**
     * Get how much of the velocities a trajectory draws anew.  See setMomentumRefreshment() for details.
     */
    double getMomentumRefreshment() const {
        return momentumRefreshment;
    }
    /**
     * Set how much of the velocities a trajectory draws anew, from more than 0 to 1 (the default).  With less than 1, a
     * trajectory begins with the velocities
     *
     * v' = sqrt(1-refreshment^2) v + refreshment u
     *
     * of those v with which the one before ended, and u from the Maxwell-Boltzmann distribution, and after a rejection
     * velocities are reversed (Horowitz, Phys. Lett. B 268, 247, 1991).  So a motion goes on from one trajectory to the
     * next, as long as none is rejected: this takes a step size at which nine in ten are accepted.  What is sampled
     * does not change.  The first trajectory of a Context draws all velocities.
     */
    void setMomentumRefreshment(double refreshment);
    /**
     * Get the weight of momenta on coarser meshes.  See setMultilevelWeight() for details.
     */
    double getMultilevelWeight() const {
        return multilevelWeight;
    }
    /**
     * Set the weight of momenta on coarser meshes: 0 (the default) for none, or a positive number, 2 to begin with.
     * With them long waves of a membrane move nearly as fast as short ones: the number of steps for an independent
     * shape is a fraction of that without.  It grows with the number of vertices, since a mesh is elastic until flips
     * have changed it.
     *
     * The coarser meshes are made of the live connectivity, each of a quarter of the vertices of the next finer one,
     * and made anew when it has changed.  Their vertices have momenta of their own.  A vertex of a membrane moves by
     * its own velocity and by a mean of those of nearby vertices of the coarser meshes, level l of which have the
     * factor sqrt(weight^l); the forces on it act on these by the same factors.  As this linear relation is fixed
     * during a trajectory, trajectories remain reversible and preserve volume in phase space: what is sampled does not
     * change.
     *
     * With a weight of 1 the squares of velocities of a wave of wave number q grow as 1/q^2, with 4 as 1/q^4.  The
     * vertices of coarser meshes have the mean mass of the membrane's vertices that can move.  Particles that are no
     * vertices move as without.  Velocities and kinetic energy in a State are those of the particles' own momenta.
     */
    void setMultilevelWeight(double weight);
    /**
     * Multiply the velocities of vertices of coarser meshes in the Context by a factor.  What gives a Context another
     * temperature, as replica exchange does, and multiplies the velocities of its particles by sqrt(T'/T), does so with
     * these: momenta that are kept are else those of the temperature before.
     */
    void scaleCoarseVelocities(double factor);
    /**
     * Get the number of steps of the last trajectory, or 0 before the first.
     */
    int getLastNumSteps() const {
        return lastNumSteps;
    }
    /**
     * Get the change dH of the total energy along the last trajectory, accepted or not, in kJ/mol.  It is infinite if
     * the trajectory diverged.
     */
    double getLastEnergyChange() const {
        return lastEnergyChange;
    }
protected:
    void makeMove();
    void initialize(OpenMM::ContextImpl& context);
    void cleanup();
    std::vector<std::string> getKernelNames();
    double computeKineticEnergy();
    void createCheckpoint(std::ostream& stream) const;
    void loadCheckpoint(std::istream& stream);
    void serializeParameters(OpenMM::SerializationNode& node) const;
    void deserializeParameters(const OpenMM::SerializationNode& node);
private:
    HelfrichForceImpl* findSoleMembrane() const;
    bool movesByItself() const;
    int drawNumSteps() const;
    /**
     * Move to the end of a trajectory.
     *
     * @return the energy there; infinity if the trajectory diverged
     */
    double moveToEnd(int numSteps);
    double computeEnd(int numSteps);
    void moveStepByStep(const KickAndDriftSequence& sequence);
    void computeForces(const KickAndDrift& kick);
    void setKick(const KickAndDrift* kick);
    void findCoarseMeshes();
    void setCoarseVelocities(const std::vector<std::vector<CoarseVelocity>>& velocities);
    int stepsPerTrajectory;
    std::string forcePrecision = "double";
    double trajectoryJitter = 0;
    std::string splitting = "leapfrog";
    int tetherSubsteps = 1;
    double momentumRefreshment = 1;
    double multilevelWeight = 0;
    double lastEnergyChange = 0;
    int lastNumSteps = 0;
    HelfrichForceImpl* soleMembrane = NULL;
    OpenMM::Kernel kernel;
};

} // namespace HelfrichPlugin

#endif /*OPENMM_HAMILTONIANTRAJECTORYINTEGRATOR_H_*/
