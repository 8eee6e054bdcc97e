#include "ReferenceEdgeFlips.h"
#include "openmmhelfrich/internal/EdgeFlipDraw.h"
#include "openmmhelfrich/internal/HelfrichStencils.h"
#include "openmmhelfrich/internal/Interruption.h"
#include <algorithm>

using namespace HelfrichPlugin;
using namespace std;
typedef ReferenceHelfrichGeometry::Real Real;

ReferenceEdgeFlips::ReferenceEdgeFlips(HelfrichMesh& mesh, const Vectors& x, const HelfrichParameters& parameters,
                                       const vector<HelfrichTotalsOf<Real>>& totals)
        : ReferenceHelfrichGeometry(mesh, x, parameters.box), flipped(mesh), p(parameters), totals(totals),
          close(x.size()) {
    if (p.has(Term::Repulsion))
        findClosePairs();
}

void ReferenceEdgeFlips::findClosePairs() {
    for (int v = 0; v < mesh.getNumVertices(); v++)
        for (int w = 0; w < mesh.getNumVertices(); w++)
            if (w != v && displacement(v, w).norm() < p.repulsionOnset)
                close[v].push_back(w);
}

EdgeFlipStatistics ReferenceEdgeFlips::sweep(double kT, long long numAttempts, const Philox& random, long long sweep) {
    EdgeFlipStatistics statistics;
    Interruption interruption(1000);
    bool isLong = SweepEdgeFlipsKernel::isLong(numAttempts, mesh);
    for (; statistics.attempted < numAttempts; statistics.attempted++) {
        if (isLong && interruption.isRequested())
            throw StepInterrupted();
        EdgeFlipDraw draw = drawEdgeFlip(random, sweep, statistics.attempted, mesh.getNumDirectedEdges());
        int h = mesh.halfedgeOf(draw.directedEdge);
        if (!mesh.canFlip(h))
            statistics.forbidden++;
        else if (attempt(h, draw.uniform, kT))
            statistics.accepted++;
    }
    if (statistics.accepted > 0)
        flipped.markChanged();
    return statistics;
}

bool ReferenceEdgeFlips::attempt(int h, double uniform, double kT) {
    const Corners corners = {mesh.origin(h), mesh.tip(h), mesh.apex(h), mesh.oppositeApex(h)};
    Real lengthBefore = length(h);
    Part before = compute(h, corners);
    flipped.flip(h);
    Part after = compute(mesh.previous(h), corners);
    int surface = mesh.getSurface(corners[0]);
    HelfrichTotalsOf<Real> totalsBefore = totals[surface], totalsAfter = totalsBefore;
    totalsAfter.area += after.totals.area - before.totals.area;
    totalsAfter.volume += after.totals.volume - before.totals.volume;
    totalsAfter.curvature += after.totals.curvature - before.totals.curvature;
    Real change = after.energy - before.energy + energyOfTotals(p, surface, totalsAfter) -
                  energyOfTotals(p, surface, totalsBefore);
    bool isAccepted = hasArea(h) && fitsBox(h, lengthBefore) && (change <= 0 || uniform < exp(-change / kT));
    if (isAccepted)
        totals[surface] = totalsAfter;
    else
        flipped.unflip(h);
    return isAccepted;
}

bool ReferenceEdgeFlips::hasArea(int h) const {
    Real least = FLAT_TRIANGLE * edge(mesh.previous(h)).squaredNorm();
    return area(h / 3) >= least && area(mesh.opposite(mesh.previous(h)) / 3) >= least;
}

bool ReferenceEdgeFlips::fitsBox(int h, Real lengthBefore) const {
    Real lengthAfter = (edge(h) + edge(mesh.next(h))).norm();
    return !box.exists() || max(lengthBefore, lengthAfter) <= box.shortest() / 2;
}

ReferenceEdgeFlips::Part ReferenceEdgeFlips::compute(int h, const Corners& corners) const {
    Part part;
    int o = mesh.opposite(h);
    for (int t : {h / 3, o / 3}) {
        part.totals.area += area(t);
        part.totals.volume += volume(t);
    }
    if (p.needsCurvature())
        for (int edge : {h, mesh.next(h), mesh.previous(h), mesh.next(o), mesh.previous(o)})
            part.totals.curvature += edgeCurvature(edge);
    if (p.has(Term::Bending))
        for (int vertex : corners)
            part.energy += bending(vertex);
    if (p.has(Term::Tether)) {
        Real slope;
        part.energy += p.moduli[Term::Tether] * tetherPotential(p, length(h), slope);
    }
    if (p.has(Term::Repulsion))
        part.energy += repulsion(corners);
    if (p.has(Term::Line))
        for (int t : {h / 3, o / 3})
            part.energy += lineEnergy(p, t);
    if (p.hasGaussianForces())
        for (int corner : {h, mesh.next(h), mesh.previous(h), o, mesh.next(o), mesh.previous(o)})
            part.energy -= material(p, mesh.origin(corner)).gaussianModulus * angle(corner);
    part.energy += p.getPairEnergy(mesh.getSpecies(mesh.origin(h)), mesh.getSpecies(mesh.tip(h)));
    return part;
}

Real ReferenceEdgeFlips::edgeCurvature(int h) const {
    return length(h) * dihedralAngle(h, normal(h / 3), normal(mesh.opposite(h) / 3)) / 2;
}

Real ReferenceEdgeFlips::bending(int vertex) const {
    Real vertexArea = 0, vertexCurvature = 0;
    for (int h : mesh.outgoingHalfedges(vertex)) {
        vertexArea += area(h / 3) / 3;
        vertexCurvature += edgeCurvature(h) / 2;
    }
    return bendingEnergy(material(p, vertex), vertexArea, vertexCurvature);
}

Real ReferenceEdgeFlips::repulsion(const Corners& corners) const {
    // Of a pair of corners, the one that comes first adds the energy.

    Real energy = 0, slope;
    for (auto v = corners.begin(); v != corners.end(); v++)
        for (int w : close[*v])
            if (find(corners.begin(), v, w) == v && !mesh.areExcluded(*v, w, p.repulsionExclusionLevel))
                energy +=
                        2 * p.moduli[Term::Repulsion] * repulsionPotential<Real>(p, displacement(*v, w).norm(), slope);
    return energy;
}
