#ifndef OPENMM_EDGEFLIPSWEEP_H_
#define OPENMM_EDGEFLIPSWEEP_H_

#include "HelfrichMesh.h"
#include "HelfrichParameters.h"
#include "HelfrichStencils.h"
#include "Philox.h"
#include "openmm/Vec3.h"
#include <functional>
#include <vector>

namespace HelfrichPlugin {

/**
 * The outcome of attempted edge flips.
 */
struct EdgeFlipStatistics {
    long long attempted = 0, accepted = 0, forbidden = 0;
};

/**
 * Sequential Metropolis sweeps of edge flips over a membrane whose vertices do not move.  The change of energy of a flip comes from the two triangles of the edge, the
 * four around them, and the totals of the surface.
 */
class OPENMM_EXPORT_HELFRICH EdgeFlipSweep {
public:
    /**
     * This is called after each accepted flip with the change of energy by which it was accepted.
     */
    typedef std::function<void(double)> Observer;
    explicit EdgeFlipSweep(HelfrichMesh& mesh) : mesh(mesh) {
    }
    /**
     * Get the areas, volume and curvatures of the membrane.  They must be those of the positions when a sweep starts, and a sweep keeps them up to date.
     */
    HelfrichGeometry& getGeometry() {
        return geometry;
    }
    /**
     * Make one sweep.
     *
     * @param positions    the position of each particle
     * @param parameters   the moduli and targets
     * @param kT           the temperature, measured in kJ/mol
     * @param numAttempts  the number of flips to attempt
     * @param random       the source of random numbers
     * @param sweep        the number of the sweep, which with that of the attempt is the counter of the random numbers
     * @param observer     called after each accepted flip, unless empty
     */
    EdgeFlipStatistics execute(const std::vector<OpenMM::Vec3>& positions, const HelfrichParameters& parameters, double kT, long long numAttempts,
                               const Philox& random, long long sweep, const Observer& observer=Observer());
private:
    typedef Vector3<double> Vector;
    /**
     * The random numbers of an attempt: the halfedge whose edge to flip, and the number to compare with the probability.
     */
    struct Draw {
        int halfedge;
        double uniform;
    };
    /**
     * What a flip changes that replaces the edge i-j of the triangles (i, j, k) and (j, i, l) by k-l.  The vertices i, j, k, l have the numbers 0 to 3.
     */
    struct Flip {
        int halfedge, vertex[4];
        double vertexArea[4], vertexCurvature[4];
        HelfrichTotals totals;
        double localEnergy;         // without the terms that depend on totals
    };
    /**
     * The vectors from i that a flip's geometry needs, and the normals, twice the triangles' areas long, of (i, j, k), (j, i, l) before and of (l, j, k),
     * (k, i, l) after it.
     */
    struct Patch {
        Vector corner[4];
        Vector normal[4];
    };
    void findVertices(int h, Flip& flip) const;
    void evaluate(Flip& flip) const;
    void evaluateAreas(const Patch& patch, Flip& flip) const;
    void evaluateCurvatures(const Patch& patch, Flip& flip) const;
    double bendingChange(const Flip& flip) const;
    double penaltyChange(const Flip& flip) const;
    double tetherChange(const Patch& patch) const;
    double repulsionChange(const Flip& flip) const;
    double repulsionOfPairsSeparated(int h) const;
    double repulsionOfPairsJoined(int vertex, int outgoing) const;
    bool isExcludedWithout(int vertex, int other, int removedNeighbor) const;
    double pairEnergy(int vertex1, int vertex2) const;
    void accept(const Flip& flip);
    Vector position(int vertex) const {
        const OpenMM::Vec3& x = positions[mesh.getParticles()[vertex]];
        return {x[0], x[1], x[2]};
    }
    void prefetch(const Draw* draws, int numDraws) const;
    HelfrichMesh& mesh;
    HelfrichParameters p;
    HelfrichGeometry geometry;
    const OpenMM::Vec3* positions;
};

} // namespace HelfrichPlugin

#endif /*OPENMM_EDGEFLIPSWEEP_H_*/
