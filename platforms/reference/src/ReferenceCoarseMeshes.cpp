#include "ReferenceCoarseMeshes.h"
#include <cmath>
#include <map>

using namespace HelfrichPlugin;
using namespace OpenMM;
using namespace std;

static const int NONE = -1;

ReferenceCoarseMeshes::ReferenceCoarseMeshes(const HelfrichMesh& mesh, const vector<double>& masses)
        : mesh(mesh), masses(masses) {
    int numMoving = 0;
    for (int particle : mesh.getParticles()) {
        mass += masses[particle];
        numMoving += (masses[particle] != 0);
    }
    if (numMoving > 0)
        mass /= numMoving;
}

void ReferenceCoarseMeshes::update() {
    if (revision == mesh.getRevision())
        return;
    revision = mesh.getRevision();
    levels.clear();
    for (Graph graph = getFinestGraph(); mass > 0;) {
        graph = coarsen(graph);
        if (graph.vertices.empty())
            break;
    }
}

ReferenceCoarseMeshes::Graph ReferenceCoarseMeshes::getFinestGraph() const {
    Graph graph;
    for (int v = 0; v < mesh.getNumVertices(); v++) {
        graph.vertices.push_back(v);
        graph.neighbors.emplace_back();
        for (int neighbor : mesh.neighbors(v))
            graph.neighbors[v].insert(neighbor);
    }
    return graph;
}

vector<char> ReferenceCoarseMeshes::findLargeSurfaces(const Graph& graph) const {
    vector<int> sizes(mesh.getNumSurfaces(), 0);
    for (int vertex : graph.vertices)
        sizes[mesh.getSurface(vertex)]++;
    vector<char> isLarge;
    for (int size : sizes)
        isLarge.push_back(CoarseVelocities::isCoarsened(levels.size(), size));
    return isLarge;
}

ReferenceCoarseMeshes::Graph ReferenceCoarseMeshes::coarsen(const Graph& graph) {
    // Vertices stay in the order of their numbers on every level.

    int size = graph.vertices.size();
    vector<char> isLarge = findLargeSurfaces(graph);
    Graph coarser;
    Level level;
    vector<int> joined(size, NONE), chosen(size, NONE);
    for (int i = 0; i < size; i++) {
        if (joined[i] != NONE || !isLarge[mesh.getSurface(graph.vertices[i])])
            continue;
        joined[i] = chosen[i] = coarser.vertices.size();
        for (int neighbor : graph.neighbors[i])
            if (joined[neighbor] == NONE)
                joined[neighbor] = joined[i];
        coarser.vertices.push_back(graph.vertices[i]);
        level.particles.push_back(mesh.getParticles()[graph.vertices[i]]);
    }
    coarser.neighbors.resize(coarser.vertices.size());
    for (int i = 0; i < size; i++)
        for (int neighbor : graph.neighbors[i])
            if (joined[i] != joined[neighbor])
                coarser.neighbors[joined[i]].insert(joined[neighbor]);
    for (int i = 0; i < size; i++) {
        map<int, int> numWays;
        int total = 0;
        auto moveOn = [&](int middle, int end) {
            if (chosen[end] != NONE) {
                numWays[chosen[end]]++;
                total++;
            }
        };
        auto moveFrom = [&](int middle) {
            moveOn(middle, middle);
            for (int end : graph.neighbors[middle])
                moveOn(middle, end);
        };
        moveFrom(i);
        for (int middle : graph.neighbors[i])
            moveFrom(middle);
        level.rows.emplace_back();
        bool isFixed = (levels.empty() && masses[mesh.getParticles()[i]] == 0);
        if (!isFixed)
            for (auto& ways : numWays)
                level.rows.back().push_back({ways.first, double(float(ways.second * (1.0 / total)))});
    }
    if (!coarser.vertices.empty())
        levels.push_back(level);
    return coarser;
}

vector<const vector<int>*> ReferenceCoarseMeshes::getParticles() const {
    vector<const vector<int>*> particles;
    for (auto& level : levels)
        particles.push_back(&level.particles);
    return particles;
}

void ReferenceCoarseMeshes::kick(const vector<Vec3>& forces, double time, double weight,
                                 CoarseVelocities& velocities) const {
    vector<Vec3> finer;
    for (int particle : mesh.getParticles())
        finer.push_back(forces[particle]);
    for (size_t l = 0; l < levels.size(); l++) {
        vector<Vec3> coarser(levels[l].particles.size());
        for (size_t i = 0; i < finer.size(); i++)
            for (auto& entry : levels[l].rows[i])
                coarser[entry.first] += finer[i] * entry.second;
        double scale = sqrt(pow(weight, l + 1)) * time / mass;
        for (size_t j = 0; j < coarser.size(); j++)
            velocities.getLevels()[l].velocities[j] += coarser[j] * scale;
        finer = coarser;
    }
}

vector<Vec3> ReferenceCoarseMeshes::getMotion(double weight, CoarseVelocities& velocities) const {
    vector<Vec3> coarser;
    for (int l = levels.size() - 1; l >= -1; l--) {
        size_t size = (l < 0 ? mesh.getNumVertices() : levels[l].particles.size());
        vector<Vec3> finer(size);
        for (size_t i = 0; i < size; i++) {
            if (l >= 0)
                finer[i] = velocities.getLevels()[l].velocities[i] * sqrt(pow(weight, l + 1));
            if (!coarser.empty())
                for (auto& entry : levels[l + 1].rows[i])
                    finer[i] += coarser[entry.first] * entry.second;
        }
        coarser = finer;
    }
    return coarser;
}
