#ifndef OPENMM_HELFRICH_COARSEVELOCITIES_H_
#define OPENMM_HELFRICH_COARSEVELOCITIES_H_

#include "MonteCarloUtilities.h"
#include "Philox.h"
#include "openmm/Vec3.h"
#include "openmmhelfrich/HelfrichKernels.h"
#include <algorithm>
#include <cmath>
#include <memory>
#include <unordered_map>
#include <vector>

namespace HelfrichPlugin {

/**
 * The velocities of the vertices of one membrane's coarser meshes, all of which have the same mass.
 *
 * They are independent of the positions and of the connectivity, and each has the Maxwell-Boltzmann distribution.  So
 * when other coarser meshes take the place of those that there were, a vertex that is new has a velocity that is drawn
 * anew, and one that was there on the same level goes on with its own.
 */
class CoarseVelocities {
public:
    /**
     * The vertices of a level: the particle that each stands for, and its velocity.
     */
    struct Level {
        std::vector<int> particles;
        std::vector<OpenMM::Vec3> velocities;
    };
    /**
     * Get whether a mesh has a coarser one, by its level, 0 for the membrane itself, and its surface's number of
     * vertices.  A mesh of a dozen vertices can do little but swell and shrink, against which the penalties of area and
     * volume are stiffest: it would make steps shorter.
     */
    static bool isCoarsened(int level, int numVertices) {
        return numVertices > (level == 0 ? 4 : 48);
    }
    /**
     * Keep what there is before a trajectory, and draw the velocities with which it begins.
     *
     * @param particles    the particles of each level of the present meshes, the finest first
     * @param deviation    the standard deviation of each component, sqrt(kT/m)
     * @param refreshment  the factor of the velocities drawn; those that there are get the factor sqrt(1-refreshment^2)
     * @param random       the source of random numbers
     * @param trajectory   the number of the trajectory
     */
    void begin(const std::vector<const std::vector<int>*>& particles, double deviation, double refreshment,
               const Philox& random, long long trajectory) {
        before.swap(levels);
        levels.resize(particles.size());
        for (size_t i = 0; i < levels.size(); i++) {
            levels[i].particles = *particles[i];
            levels[i].velocities.resize(particles[i]->size());
            draw(i, deviation, refreshment, random, trajectory);
        }
        start = levels;
    }
    /**
     * Go back to the velocities that begin() drew, and reverse them.
     */
    void reject() {
        levels = start;
        for (Level& level : levels)
            for (OpenMM::Vec3& velocity : level.velocities)
                velocity = velocity * -1;
    }
    /**
     * Go back to the velocities that begin() found.
     */
    void restore() {
        levels = before;
    }
    /**
     * Get the sum of the squares of all velocities.
     */
    double getSquare() const {
        double sum = 0;
        for (const Level& level : levels) {
            double sumOfLevel = 0;
            for (const OpenMM::Vec3& velocity : level.velocities)
                sumOfLevel += velocity.dot(velocity);
            sum += sumOfLevel;
        }
        return sum;
    }
    std::vector<Level>& getLevels() {
        return levels;
    }
    /**
     * Add the velocities to a list.
     */
    void store(std::vector<CoarseVelocity>& list) const {
        for (size_t i = 0; i < levels.size(); i++)
            for (size_t j = 0; j < levels[i].particles.size(); j++)
                list.push_back({int(i + 1), levels[i].particles[j], levels[i].velocities[j]});
    }
    /**
     * Take a velocity from a list, in the order of store().
     */
    void load(const CoarseVelocity& item) {
        if (levels.size() < size_t(item.level))
            levels.resize(item.level);
        levels[item.level - 1].particles.push_back(item.particle);
        levels[item.level - 1].velocities.push_back(item.velocity);
    }
private:
    void draw(size_t i, double deviation, double refreshment, const Philox& random, long long trajectory) {
        // The numbers that drawNormals() has for particles are those of level 0.

        std::unordered_map<int, OpenMM::Vec3> kept;
        if (refreshment < 1 && i < before.size())
            for (size_t j = 0; j < before[i].particles.size(); j++)
                kept[before[i].particles[j]] = before[i].velocities[j];
        double remainder = std::sqrt(1 - refreshment * refreshment);
        for (size_t j = 0; j < levels[i].particles.size(); j++) {
            int particle = levels[i].particles[j];
            OpenMM::Vec3 drawn =
                    drawNormals(random, trajectory, uint64_t(i + 1) << 32 | uint64_t(particle)) * deviation;
            auto found = kept.find(particle);
            levels[i].velocities[j] = (found == kept.end() ? drawn : found->second * remainder + drawn * refreshment);
        }
    }
    std::vector<Level> levels, before, start;
};

/**
 * The coarser meshes of all membranes of a Context, and the velocities of their vertices: what the kernels of all
 * platforms do alike.
 *
 * Meshes is a platform's class of one membrane's coarser meshes.  It is created from a connectivity and the masses of
 * all particles; update() makes the meshes of the present connectivity, getParticles() returns the particles of each
 * level, getMass() the mass of their vertices.
 */
template <class Meshes>
class CoarseMotion {
public:
    /**
     * See IntegrateHamiltonianTrajectoryKernel::setMultilevelWeight().
     */
    void setWeight(double newWeight, const std::vector<const HelfrichMesh*>& newMembranes,
                   const std::vector<double>& masses) {
        weight = newWeight;
        if (weight > 0 && membranes == newMembranes)
            return;
        meshes.clear();
        membranes.clear();
        if (weight > 0)
            membranes = newMembranes;
        for (const HelfrichMesh* membrane : membranes)
            meshes.emplace_back(new Meshes(*membrane, masses));
        velocities.resize(meshes.size());
    }
    double getWeight() const {
        return weight;
    }
    /**
     * Get the number of membranes that have coarser meshes.
     */
    int size() const {
        return meshes.size();
    }
    Meshes& getMeshes(int membrane) {
        return *meshes[membrane];
    }
    CoarseVelocities& getVelocities(int membrane) {
        return velocities[membrane];
    }
    /**
     * Follow the present connectivity and begin a trajectory.  See CoarseVelocities::begin().
     */
    void begin(double kT, double refreshment, const Philox& random, long long trajectory) {
        for (int i = 0; i < size(); i++) {
            meshes[i]->update();
            velocities[i].begin(meshes[i]->getParticles(), std::sqrt(kT / meshes[i]->getMass()), refreshment, random,
                                trajectory);
        }
    }
    void reject() {
        for (CoarseVelocities& ofMembrane : velocities)
            ofMembrane.reject();
    }
    void restore() {
        for (CoarseVelocities& ofMembrane : velocities)
            ofMembrane.restore();
    }
    double getKineticEnergy() const {
        double energy = 0;
        for (int i = 0; i < size(); i++)
            energy += 0.5 * meshes[i]->getMass() * velocities[i].getSquare();
        return energy;
    }
    /**
     * See IntegrateHamiltonianTrajectoryKernel::getCoarseVelocities().
     */
    std::vector<std::vector<CoarseVelocity>> store() const {
        std::vector<std::vector<CoarseVelocity>> list(velocities.size());
        for (size_t i = 0; i < velocities.size(); i++)
            velocities[i].store(list[i]);
        return list;
    }
    /**
     * See IntegrateHamiltonianTrajectoryKernel::setCoarseVelocities().
     */
    void load(const std::vector<std::vector<CoarseVelocity>>& list) {
        velocities.assign(list.size(), CoarseVelocities());
        for (size_t i = 0; i < list.size(); i++)
            for (const CoarseVelocity& item : list[i])
                velocities[i].load(item);
        velocities.resize(std::max(list.size(), meshes.size()));
    }
private:
    double weight = 0;
    std::vector<const HelfrichMesh*> membranes;
    std::vector<std::unique_ptr<Meshes>> meshes;
    std::vector<CoarseVelocities> velocities;
};

} // namespace HelfrichPlugin

#endif /*OPENMM_HELFRICH_COARSEVELOCITIES_H_*/
