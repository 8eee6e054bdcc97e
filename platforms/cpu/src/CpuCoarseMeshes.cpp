#include "CpuCoarseMeshes.h"
#include "CpuThreads.h"
#include <algorithm>
#include <cmath>

using namespace HelfrichPlugin;
using namespace OpenMM;
using namespace std;

static const int NONE = -1;

/**
 * The number of vertices that makes it worth to wake another thread, and that a thread takes at a time.
 */
static const int VERTICES_PER_THREAD = 2000, VERTICES_PER_PART = 256;

CpuCoarseMeshes::CpuCoarseMeshes(const HelfrichMesh& mesh, const vector<double>& masses)
        : mesh(mesh), loops(getForProcessor<CpuCoarseLoops>()) {
    int numMoving = 0;
    for (int particle : mesh.getParticles()) {
        mass += masses[particle];
        isFixed.push_back(masses[particle] == 0);
        numMoving += !isFixed.back();
    }
    if (numMoving > 0)
        mass /= numMoving;
}

void CpuCoarseMeshes::update() {
    if (revision == mesh.getRevision())
        return;
    revision = mesh.getRevision();
    havePlaces = false;
    numLevels = 0;
    if (mass == 0)
        return;
    makeFinestGraph();
    while (true) {
        if (levels.size() == size_t(numLevels))
            levels.emplace_back();
        Level& level = levels[numLevels];
        chooseVertices(finer, level, coarser);
        if (level.size() == 0)
            break;
        findChosenNeighbors(finer);
        fillRows(finer, level);
        connect(finer, coarser);
        if (numLevels == 0)
            orderedRows.swap(level.prolongation.rows);
        else
            transpose(level, NULL);
        level.vectors.resize(4 * level.size());
        numLevels++;
        swap(finer, coarser);
    }
}

void CpuCoarseMeshes::makeFinestGraph() {
    // Neighbors are in the order of halfedges, which are read as they are in memory.

    const vector<int>& order = mesh.getOrder();
    int size = order.size();
    ranks.resize(size);
    for (int i = 0; i < size; i++)
        ranks[order[i]] = i;
    finer.vertices = order;
    finer.sequence = ranks;
    finer.starts.resize(size + 1);
    finer.starts[0] = 0;
    for (int i = 0; i < size; i++)
        finer.starts[i + 1] = finer.starts[i] + mesh.valence(order[i]);
    finer.neighbors.resize(mesh.getNumHalfedges());
    found = finer.starts;
    for (int h = 0; h < mesh.getNumHalfedges(); h += 3) {
        int corners[3];
        for (int i = 0; i < 3; i++)
            corners[i] = ranks[mesh.origin(h + i)];
        for (int i = 0; i < 3; i++)
            finer.neighbors[found[corners[i]]++] = corners[i == 2 ? 0 : i + 1];
    }
}

void CpuCoarseMeshes::findLargeSurfaces(const Graph& graph) {
    isLarge.assign(mesh.getNumSurfaces(), CoarseVelocities::isCoarsened(numLevels, graph.size()));
    if (mesh.getNumSurfaces() == 1)
        return;
    vector<int> sizes(mesh.getNumSurfaces(), 0);
    for (int vertex : graph.vertices)
        sizes[mesh.getSurface(vertex)]++;
    for (size_t i = 0; i < sizes.size(); i++)
        isLarge[i] = CoarseVelocities::isCoarsened(numLevels, sizes[i]);
}

void CpuCoarseMeshes::chooseVertices(const Graph& graph, Level& level, Graph& coarser) {
    findLargeSurfaces(graph);
    joined.assign(graph.size(), NONE);
    numbers.resize(graph.size());
    coarser.sequence.clear();
    for (int i : graph.sequence) {
        if (joined[i] != NONE || !isLarge[mesh.getSurface(graph.vertices[i])])
            continue;
        joined[i] = i;
        coarser.sequence.push_back(i);
        for (int j = graph.starts[i]; j < graph.starts[i + 1]; j++) {
            int& other = joined[graph.neighbors[j]];
            other = (other == NONE ? i : other);
        }
    }
    coarser.vertices.clear();
    level.particles.clear();
    for (int i = 0; i < graph.size(); i++) {
        numbers[i] = NONE;
        if (joined[i] == i) {
            numbers[i] = coarser.size();
            coarser.vertices.push_back(graph.vertices[i]);
            level.particles.push_back(mesh.getParticles()[graph.vertices[i]]);
        }
    }
    for (int& i : coarser.sequence)
        i = numbers[i];
}

void CpuCoarseMeshes::findChosenNeighbors(const Graph& graph) {
    chosenStarts.resize(graph.size() + 1);
    chosen.resize(graph.neighbors.size() + graph.size());
    int end = 0;
    for (int i = 0; i < graph.size(); i++) {
        chosenStarts[i] = end;
        auto add = [&](int vertex) {
            chosen[end] = numbers[vertex];
            end += (numbers[vertex] != NONE);
        };
        add(i);
        for (int j = graph.starts[i]; j < graph.starts[i + 1]; j++)
            add(graph.neighbors[j]);
    }
    chosenStarts[graph.size()] = end;
}

void CpuCoarseMeshes::fillRows(const Graph& graph, Level& level) {
    Matrix& matrix = level.prolongation;
    matrix.rows.resize(graph.size());
    found.resize(level.size() + 1);
    counts.assign(level.size(), 0);
    size_t end = 0;
    for (int i = 0; i < graph.size(); i++) {
        int numFound = 0, total = 0;
        auto add = [&](int middle) {
            for (int j = chosenStarts[middle]; j < chosenStarts[middle + 1]; j++) {
                found[numFound] = chosen[j];
                numFound += (counts[chosen[j]]++ == 0);
            }
            total += chosenStarts[middle + 1] - chosenStarts[middle];
        };
        if (numLevels > 0 || !isFixed[graph.vertices[i]]) {
            add(i);
            for (int j = graph.starts[i]; j < graph.starts[i + 1]; j++)
                add(graph.neighbors[j]);
        }
        matrix.rows[i] = {int(end), numFound};
        if (matrix.entries.size() < end + numFound)
            matrix.entries.resize(2 * end + numFound + graph.size());
        double inverse = 1.0 / max(total, 1);
        for (int j = 0; j < numFound; j++) {
            matrix.entries[end++] = {4 * found[j], float(counts[found[j]] * inverse)};
            counts[found[j]] = 0;
        }
    }
    matrix.entries.resize(end);
}

void CpuCoarseMeshes::connect(const Graph& graph, Graph& coarser) {
    // Who joined a chosen vertex is among its neighbors.

    coarser.starts.assign(1, 0);
    coarser.neighbors.clear();
    counts.assign(coarser.size(), NONE);
    for (int i = 0; i < graph.size(); i++) {
        if (numbers[i] == NONE)
            continue;
        auto addNeighbors = [&](int member) {
            for (int j = graph.starts[member]; j < graph.starts[member + 1]; j++) {
                int other = numbers[joined[graph.neighbors[j]]];
                if (other != numbers[i] && counts[other] != i) {
                    counts[other] = i;
                    coarser.neighbors.push_back(other);
                }
            }
        };
        addNeighbors(i);
        for (int j = graph.starts[i]; j < graph.starts[i + 1]; j++)
            if (joined[graph.neighbors[j]] == i)
                addNeighbors(graph.neighbors[j]);
        coarser.starts.push_back(coarser.neighbors.size());
    }
}

void CpuCoarseMeshes::transpose(Level& level, const int* places) {
    // The entries of a row are in the order of the vertices of the finer mesh, wherever these are.

    const Matrix& matrix = level.prolongation;
    const vector<CpuSparseRow>& rows = (places == NULL ? matrix.rows : orderedRows);
    vector<CpuSparseRow>& transposed = level.restriction.rows;
    transposed.assign(level.size(), {0, 0});
    for (const CpuSparseEntry& entry : matrix.entries)
        transposed[entry.offset / 4].size++;
    int start = 0;
    for (CpuSparseRow& row : transposed) {
        row.start = start;
        start += row.size;
        row.size = 0;
    }
    level.restriction.entries.resize(start);
    for (int i = 0; i < int(rows.size()); i++) {
        int place = (places == NULL ? i : places[i]);
        for (int j = rows[i].start; j < rows[i].start + rows[i].size; j++) {
            CpuSparseRow& row = transposed[matrix.entries[j].offset / 4];
            level.restriction.entries[row.start + row.size++] = {4 * place, matrix.entries[j].value};
        }
    }
}

void CpuCoarseMeshes::setPlaces(const vector<int>& newPlaces, int numPlaces) {
    if (havePlaces && places == newPlaces)
        return;
    havePlaces = true;
    places = newPlaces;
    if (numLevels == 0)
        return;
    const vector<int>& order = mesh.getOrder();
    vector<CpuSparseRow>& rows = levels[0].prolongation.rows;
    rows.assign(numPlaces, {0, 0});
    found.resize(order.size());
    for (size_t i = 0; i < order.size(); i++) {
        found[i] = places[order[i]];
        rows[found[i]] = orderedRows[i];
    }
    transpose(levels[0], found.data());
}

vector<const vector<int>*> CpuCoarseMeshes::getParticles() const {
    vector<const vector<int>*> particles;
    for (int i = 0; i < numLevels; i++)
        particles.push_back(&levels[i].particles);
    return particles;
}

/**
 * Call a function with the first and last vertex of each part, on several threads where there are enough.
 */
template <class Function>
static void forEachPart(int numThreads, int numVertices, const Function& function) {
    numThreads = max(1, min(numThreads, numVertices / VERTICES_PER_THREAD));
    CpuThreads::forEachPart(numThreads, numVertices, VERTICES_PER_PART, function);
}

template <class Real>
void CpuCoarseMeshes::kick(const Real* forces, double time, double weight, CoarseVelocities& velocities,
                           int numThreads) {
    for (int l = 0; l < numLevels; l++) {
        Level& level = levels[l];
        const Matrix& matrix = level.restriction;
        Real* vectors = level.getVectors<Real>();
        vector<Vec3>& ofLevel = velocities.getLevels()[l].velocities;
        double scale = sqrt(pow(weight, l + 1)) * time / mass;
        forEachPart(numThreads, level.size(), [&](int first, int last) {
            loops.multiply(matrix.rows.data(), matrix.entries.data(), forces, vectors + 4 * first, first, last);
            for (int i = first; i < last; i++)
                for (int j = 0; j < 3; j++)
                    ofLevel[i][j] += scale * vectors[4 * i + j];
        });
        forces = vectors;
    }
}

template <class Real>
void CpuCoarseMeshes::findMotion(double weight, CoarseVelocities& velocities, int numThreads) {
    for (int l = numLevels - 1; l >= 0; l--) {
        Real* vectors = levels[l].getVectors<Real>();
        const vector<Vec3>& ofLevel = velocities.getLevels()[l].velocities;
        double scale = sqrt(pow(weight, l + 1));
        forEachPart(numThreads, levels[l].size(), [&](int first, int last) {
            if (l + 1 < numLevels)
                multiplyRows(levels[l + 1], first, last, vectors + 4 * first);
            else
                fill(vectors + 4 * first, vectors + 4 * last, Real(0));
            for (int i = first; i < last; i++)
                for (int j = 0; j < 3; j++)
                    vectors[4 * i + j] += Real(scale * ofLevel[i][j]);
        });
    }
}

template <class Real>
void CpuCoarseMeshes::multiplyRows(const Level& level, int first, int last, Real* target) const {
    const Matrix& matrix = level.prolongation;
    loops.multiply(matrix.rows.data(), matrix.entries.data(), level.getVectors<Real>(), target, first, last);
}

template <class Real>
void CpuCoarseMeshes::getMotion(int firstPlace, int lastPlace, Real* motion) const {
    if (numLevels > 0)
        multiplyRows(levels[0], firstPlace, lastPlace, motion);
    else
        fill(motion, motion + 4 * (lastPlace - firstPlace), Real(0));
}

namespace HelfrichPlugin {

#define INSTANTIATE(Real)                                                                                              \
    template void CpuCoarseMeshes::kick(const Real*, double, double, CoarseVelocities&, int);                          \
    template void CpuCoarseMeshes::findMotion<Real>(double, CoarseVelocities&, int);                                   \
    template void CpuCoarseMeshes::getMotion(int, int, Real*) const;
INSTANTIATE(double)
INSTANTIATE(float)
#undef INSTANTIATE

} // namespace HelfrichPlugin
