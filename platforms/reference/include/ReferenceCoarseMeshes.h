#ifndef OPENMM_REFERENCECOARSEMESHES_H_
#define OPENMM_REFERENCECOARSEMESHES_H_

#include "openmmhelfrich/internal/CoarseVelocities.h"
#include "openmmhelfrich/internal/HelfrichMesh.h"
#include <set>
#include <vector>

namespace HelfrichPlugin {

/**
 * The coarser meshes of one membrane, whose vertices have velocities that move those of the membrane.
 *
 * The vertices of the first coarser mesh are a greatest set of vertices of the membrane no two of which are bonded,
 * taken greedily in the order of their numbers.  Every other vertex joins its bonded neighbor with the lowest number
 * among these, and two vertices of the coarser mesh are bonded where something that joined the one is bonded to
 * something that joined the other.  The next coarser mesh is made of this one in the same way, as long as
 * CoarseVelocities::isCoarsened() has it.
 *
 * A vertex moves by a mean of the velocities of the coarser mesh.  The weight of each is the number of ways to get
 * there in two moves, each along an edge or none.
 *
 * The meshes follow from the membrane's connectivity and its vertices' numbers alone.
 */
class ReferenceCoarseMeshes {
public:
    /**
     * @param mesh    the connectivity of the membrane
     * @param masses  the mass of each particle, 0 for those that do not move
     */
    ReferenceCoarseMeshes(const HelfrichMesh& mesh, const std::vector<double>& masses);
    /**
     * Make the meshes anew if the connectivity has changed.
     */
    void update();
    /**
     * Get the particles for which the vertices of each level stand.
     */
    std::vector<const std::vector<int>*> getParticles() const;
    /**
     * Change the velocities of all levels by the forces on the particles.
     *
     * @param forces  the force on each particle
     * @param time    the time for which the forces act
     * @param weight  the weight of a level, as a multiple of that of the next finer one
     * @param[in,out] velocities  the velocities
     */
    void kick(const std::vector<OpenMM::Vec3>& forces, double time, double weight, CoarseVelocities& velocities) const;
    /**
     * Get the velocity that the coarser meshes give each vertex.
     */
    std::vector<OpenMM::Vec3> getMotion(double weight, CoarseVelocities& velocities) const;
    const HelfrichMesh& getMembrane() const {
        return mesh;
    }
    /**
     * Get the mass of each vertex of a coarser mesh: the mean of the vertices that move.
     */
    double getMass() const {
        return mass;
    }
private:
    /**
     * A mesh: for each vertex the one of the membrane that it stands for, and its bonded neighbors.
     */
    struct Graph {
        std::vector<int> vertices;
        std::vector<std::set<int>> neighbors;
    };
    /**
     * How a coarser mesh moves the next finer one: for each vertex of this those that move it, and their weights.
     */
    struct Level {
        std::vector<int> particles;
        std::vector<std::vector<std::pair<int, double>>> rows;
    };
    Graph getFinestGraph() const;
    std::vector<char> findLargeSurfaces(const Graph& graph) const;
    Graph coarsen(const Graph& graph);
    const HelfrichMesh& mesh;
    const std::vector<double>& masses;
    double mass = 0;
    long long revision = -1;
    std::vector<Level> levels;
};

} // namespace HelfrichPlugin

#endif /*OPENMM_REFERENCECOARSEMESHES_H_*/
