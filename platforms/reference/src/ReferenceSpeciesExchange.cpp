#include "ReferenceSpeciesExchange.h"
#include "openmmhelfrich/internal/Interruption.h"

using namespace HelfrichPlugin;
using namespace std;
typedef ReferenceHelfrichGeometry::Real Real;

ReferenceSpeciesExchange::ReferenceSpeciesExchange(HelfrichMesh& mesh, const Vectors& x,
                                                   const HelfrichParameters& parameters,
                                                   const SpeciesProposal& proposal)
        : ReferenceHelfrichGeometry(mesh, x, parameters.box), changing(mesh), p(parameters), proposal(proposal),
          areas(mesh.getNumVertices(), 0), curvatures(mesh.getNumVertices(), 0),
          defects(mesh.getNumVertices(), 2 * acos(Real(-1))) {
    for (int h = 0; h < mesh.getNumHalfedges(); h++) {
        int v = mesh.origin(h);
        areas[v] += area(h / 3) / 3;
        curvatures[v] += length(h) * dihedralAngle(h, normal(h / 3), normal(mesh.opposite(h) / 3)) / 4;
        defects[v] -= angle(h);
    }
}

SpeciesExchangeStatistics ReferenceSpeciesExchange::sweep(double kT, long long numAttempts, const Philox& random,
                                                          long long sweep) {
    SpeciesExchangeStatistics statistics;
    Interruption interruption(1000);
    for (; statistics.attempted < numAttempts; statistics.attempted++) {
        if (interruption.isRequested())
            throw StepInterrupted();
        SpeciesDraw draw = proposal.draw(random, sweep, statistics.attempted, mesh);
        if (isAlike(draw))
            statistics.alike++;
        else if (attempt(draw, kT))
            statistics.accepted++;
    }
    if (statistics.accepted > 0)
        changing.markSpeciesChanged();
    return statistics;
}

bool ReferenceSpeciesExchange::isAlike(const SpeciesDraw& draw) const {
    bool isMutation = (proposal.kind == SpeciesProposal::Mutation);
    return mesh.getSpecies(draw.first) == (isMutation ? draw.second : mesh.getSpecies(draw.second));
}

bool ReferenceSpeciesExchange::attempt(const SpeciesDraw& draw, double kT) {
    set<int> changed = {draw.first};
    if (proposal.kind != SpeciesProposal::Mutation)
        changed.insert(draw.second);
    int species = mesh.getSpecies(draw.first);
    Real before = compute(changed);
    change(draw);
    Real energy = compute(changed) - before;
    bool isAccepted = (energy <= 0 || draw.uniform < exp(-energy / kT));
    if (!isAccepted)
        change(proposal.kind == SpeciesProposal::Mutation ? SpeciesDraw{draw.first, species} : draw);
    return isAccepted;
}

void ReferenceSpeciesExchange::change(const SpeciesDraw& draw) {
    if (proposal.kind == SpeciesProposal::Mutation)
        changing.changeSpecies(draw.first, draw.second);
    else
        changing.exchangeSpecies(draw.first, draw.second);
}

Real ReferenceSpeciesExchange::compute(const set<int>& changed) const {
    Real energy = 0;
    set<int> edges, triangles;
    for (int vertex : changed) {
        energy += computeMaterial(vertex) - proposal.chemicalPotentials[mesh.getSpecies(vertex)];
        for (int h : mesh.outgoingHalfedges(vertex)) {
            edges.insert(min(h, mesh.opposite(h)));
            triangles.insert(h / 3);
        }
    }
    for (int h : edges)
        energy += p.getPairEnergy(mesh.getSpecies(mesh.origin(h)), mesh.getSpecies(mesh.tip(h)));
    if (p.has(Term::Line))
        for (int t : triangles)
            energy += lineEnergy(p, t);
    return energy;
}

Real ReferenceSpeciesExchange::computeMaterial(int vertex) const {
    HelfrichSpecies ofVertex = material(p, vertex);
    Real energy = bendingEnergy(ofVertex, areas[vertex], curvatures[vertex]);
    if (p.hasGaussianForces())
        energy += ofVertex.gaussianModulus * defects[vertex];
    return energy;
}
