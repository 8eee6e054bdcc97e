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
     * What a flip changes that replaces the edge i-j of the triangles (i, j, k) and (j, i, l) by k-l.  The vertices i, j, k, l have the numbers 0 to 3; rim 0 to 3
     * are the halfedges j-k, k-i, i-l, l-j around them.
     */
    struct Flip {
        int vertex[4], halfedge[2], rim[4];
        Vector normal[2];           // of the new triangles (l, j, k) and (k, i, l), twice their areas long
        double area[2];             // of the new triangles
        double edgeCurvature;       // length times dihedral angle of the new edge
        double rimCurvature[4];     // the same of the edges around it
        double vertexArea[4], vertexCurvature[4];
        HelfrichTotals totals;
        double energy;
    };
    void prepare(const std::vector<OpenMM::Vec3>& positions, const HelfrichParameters& parameters);
    void prepareTriangles();
    void prepareEdges();
    Vector normal(int a, int b, int c) const;
    double curvatureOfEdge(int h) const;
    double rimCurvature(const Flip& flip, int side) const;
    void evaluate(int h, Flip& flip) const;
    void evaluateAreas(Flip& flip) const;
    void evaluateCurvatures(Flip& flip) const;
    double bendingChange(const Flip& flip) const;
    double penaltyChange(const Flip& flip) const;
    double tetherChange(const Flip& flip) const;
    double repulsionChange(const Flip& flip) const;
    double repulsionOfPairsSeparated(int h) const;
    double repulsionOfPairsJoined(int vertex, int outgoing) const;
    bool isExcludedWithout(int vertex, int other, int removedNeighbor) const;
    double pairEnergy(int vertex1, int vertex2) const;
    void accept(const Flip& flip);
    HelfrichMesh& mesh;
    HelfrichParameters p;
    HelfrichTotals totals;
    std::vector<Vector> x;
    std::vector<double> triangleAreas, edgeCurvatures, vertexAreas, vertexCurvatures;
};

} // namespace HelfrichPlugin

#endif /*OPENMM_EDGEFLIPSWEEP_H_*/
