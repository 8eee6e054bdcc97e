#include "Assertions.h"
#include "Membranes.h"
#include "openmm/OpenMMException.h"
#include "openmm/internal/AssertionUtilities.h"
#include "openmmhelfrich/internal/HelfrichMesh.h"
#include <algorithm>
#include <functional>
#include <iostream>
#include <set>
#include <string>

using namespace HelfrichPlugin;
using namespace OpenMM;
using namespace std;

typedef vector<array<int, 3>> Triangles;

/**
 * The triangles, each from its smallest particle, in ascending order: what does not depend on how they are stored.
 */
Triangles normalize(Triangles triangles) {
    for (auto& t : triangles)
        rotate(t.begin(), min_element(t.begin(), t.end()), t.end());
    sort(triangles.begin(), triangles.end());
    return triangles;
}

void testConnectivity() {
    Membrane sphere = createSphere(2);
    HelfrichMesh mesh(sphere.triangles, sphere.positions.size());
    ASSERT_EQUAL(66, mesh.getNumVertices());
    ASSERT_EQUAL(128, mesh.getNumTriangles());
    ASSERT_EQUAL(192, mesh.getNumEdges());
    ASSERT_EQUAL(384, mesh.getNumHalfedges());
    ASSERT_EQUAL_CONTAINERS(sphere.triangles, mesh.getTriangles());
    mesh.validate();
    for (int h = 0; h < mesh.getNumHalfedges(); h++) {
        ASSERT_EQUAL(mesh.origin(h), sphere.triangles[h / 3][h % 3]);
        ASSERT_EQUAL(mesh.tip(h), mesh.origin(mesh.next(h)));
        ASSERT_EQUAL(mesh.apex(h), mesh.origin(mesh.previous(h)));
        ASSERT_EQUAL(h, mesh.opposite(mesh.opposite(h)));
        ASSERT_EQUAL(mesh.tip(h), mesh.origin(mesh.opposite(h)));
        ASSERT_EQUAL(mesh.origin(h), mesh.origin(mesh.rotate(h)));
        ASSERT_EQUAL(mesh.apex(h), mesh.tip(mesh.rotate(h)));
    }
    for (int v = 0; v < 66; v++)
        ASSERT_EQUAL(v < 6 ? 4 : 6, mesh.valence(v));
}

void testParticlesOfSeveralMembranes() {
    // Two tetrahedra on some of twelve particles: vertices are numbered in ascending order of the particles.

    Triangles triangles = {{9, 7, 5}, {9, 5, 2}, {9, 2, 7}, {5, 7, 2}, {0, 3, 4}, {0, 4, 8}, {0, 8, 3}, {4, 3, 8}};
    HelfrichMesh mesh(triangles, 12);
    ASSERT_EQUAL_CONTAINERS((vector<int>{0, 2, 3, 4, 5, 7, 8, 9}), mesh.getParticles());
    ASSERT_EQUAL_CONTAINERS(triangles, mesh.getTriangles());
    ASSERT(mesh.areBonded(0, 2));
    ASSERT(!mesh.areBonded(0, 1));
    for (int h = 0; h < mesh.getNumHalfedges(); h++)
        ASSERT(!mesh.canFlip(h));
    ASSERT_EQUAL_CONTAINERS((vector<int>{1, 0, 1, 1, 0, 0, 1, 0}), mesh.getSurfaces());
    mesh.validate();
}

void testExclusions() {
    Membrane sphere = createSphere(2);
    HelfrichMesh mesh(sphere.triangles, sphere.positions.size());
    vector<set<int>> bonded(66);
    for (auto& t : sphere.triangles)
        for (int c = 0; c < 3; c++)
            bonded[t[c]].insert({t[(c + 1) % 3], t[(c + 2) % 3]});
    int numExcluded = 0;
    for (int i = 0; i < 66; i++)
        for (int j = 0; j < 66; j++) {
            if (i == j)
                continue;
            bool shareNeighbor =
                    any_of(bonded[i].begin(), bonded[i].end(), [&](int n) { return bonded[n].count(j) > 0; });
            ASSERT_EQUAL(bonded[i].count(j) > 0, mesh.areBonded(i, j));
            ASSERT(!mesh.areExcluded(i, j, 0));
            ASSERT_EQUAL(mesh.areBonded(i, j), mesh.areExcluded(i, j, 1));
            ASSERT_EQUAL(mesh.areBonded(i, j) || shareNeighbor, mesh.areExcluded(i, j, 2));
            numExcluded += mesh.areExcluded(i, j, 2);
            for (int ignored = 0; ignored < 66; ignored++) {
                bool shareOther = any_of(bonded[i].begin(), bonded[i].end(),
                                         [&](int n) { return n != ignored && bonded[n].count(j) > 0; });
                ASSERT_EQUAL(mesh.areBonded(i, j) || shareOther, mesh.areExcluded(i, j, 2, ignored));
            }
            for (int level = 0; level <= 2; level++) {
                bool isVisited = false;
                mesh.forEachExcluded(i, level, [&](int excluded) { isVisited |= (excluded == j); });
                ASSERT_EQUAL(mesh.areExcluded(i, j, level), isVisited);
            }
        }
    ASSERT(numExcluded > 384 && numExcluded < 66 * 65);
}

void testFlip() {
    Membrane sphere = createSphere(2);
    HelfrichMesh mesh(sphere.triangles, sphere.positions.size());
    int h = 0;
    while (!mesh.canFlip(h))
        h++;
    int o = mesh.opposite(h), i = mesh.origin(h), j = mesh.tip(h), k = mesh.apex(h), l = mesh.apex(o);
    int edge = mesh.previous(h), otherSide = mesh.previous(o);
    mesh.flip(h);
    ASSERT(!mesh.areBonded(i, j));
    ASSERT(mesh.areBonded(k, l));
    ASSERT_EQUAL(otherSide, mesh.opposite(edge));
    ASSERT_EQUAL_CONTAINERS((set<int>{k, l}), (set<int>{mesh.origin(edge), mesh.tip(edge)}));
    mesh.validate();

    // The flip back restores the surface, though not where its triangles are stored.

    mesh.flip(edge);
    mesh.validate();
    ASSERT_EQUAL_CONTAINERS(normalize(sphere.triangles), normalize(mesh.getTriangles()));
}

void testUnflip() {
    // It restores all that a flip changes: where the triangles are stored, what is beyond them, and which edges are
    // fixed.

    TestRandom random(4);
    Membrane sphere = createSphere(2);
    HelfrichMesh mesh(sphere.triangles, sphere.positions.size());
    mesh.setFixedEdges(
            {{sphere.triangles[5][0], sphere.triangles[5][1]}, {sphere.triangles[70][1], sphere.triangles[70][2]}});
    for (int attempt = 0; attempt < 2000; attempt++) {
        int h = random.index(mesh.getNumHalfedges());
        if (!mesh.canFlip(h))
            continue;
        HelfrichMesh before = mesh;
        mesh.flip(h);
        ASSERT(mesh.getTriangles() != before.getTriangles());
        HelfrichMesh flipped = mesh;
        mesh.unflip(h);
        mesh.validate();
        ASSERT(mesh.getTriangles() == before.getTriangles());
        for (int n = 0; n < mesh.getNumHalfedges(); n++)
            ASSERT_EQUAL(before.isFixed(n), mesh.isFixed(n));
        mesh = flipped;
    }
}

void testCirculators() {
    // Around each vertex they come to each triangle once, in order, however the edges were flipped.

    TestRandom random(5);
    Membrane sphere = createSphere(2);
    HelfrichMesh mesh(sphere.triangles, sphere.positions.size());
    for (int attempt = 0; attempt < 300; attempt++) {
        int h = random.index(mesh.getNumHalfedges());
        if (mesh.canFlip(h))
            mesh.flip(h);
    }
    vector<set<int>> bonded(66);
    for (auto& t : mesh.getTriangles())
        for (int c = 0; c < 3; c++)
            bonded[t[c]].insert({t[(c + 1) % 3], t[(c + 2) % 3]});
    for (int v = 0; v < 66; v++) {
        vector<int> halfedges, neighbors;
        for (int h : mesh.outgoingHalfedges(v))
            halfedges.push_back(h);
        for (int neighbor : mesh.neighbors(v))
            neighbors.push_back(neighbor);
        ASSERT_EQUAL(mesh.valence(v), (int) halfedges.size());
        ASSERT_EQUAL_CONTAINERS(bonded[v], (set<int>(neighbors.begin(), neighbors.end())));
        for (int i = 0; i < mesh.valence(v); i++) {
            ASSERT_EQUAL(v, mesh.origin(halfedges[i]));
            ASSERT_EQUAL(neighbors[i], mesh.tip(halfedges[i]));
            ASSERT_EQUAL(neighbors[(i + 1) % mesh.valence(v)], mesh.apex(halfedges[i]));
        }
    }
}

void testManyFlips() {
    // Whatever flips are made, the surface stays closed, with Euler characteristic 2 and no vertex of fewer than three
    // neighbors.  (The neighbors of a vertex with three are bonded to each other, so that no flip can take one away
    // without doubling an edge.)

    TestRandom random(3);
    for (int subdivisions : {0, 1, 2}) {
        Membrane sphere = createSphere(subdivisions);
        HelfrichMesh mesh(sphere.triangles, sphere.positions.size());
        int numFlips = 0, numDoubled = 0, lowestValence = 99;
        for (int attempt = 0; attempt < 5000; attempt++) {
            int h = random.index(mesh.getNumHalfedges());
            ASSERT_EQUAL(!mesh.areBonded(mesh.apex(h), mesh.apex(mesh.opposite(h))), mesh.canFlip(h));
            if (!mesh.canFlip(h)) {
                numDoubled++;
                continue;
            }
            mesh.flip(h);
            mesh.validate();
            numFlips++;
            for (int v = 0; v < mesh.getNumVertices(); v++)
                lowestValence = min(lowestValence, mesh.valence(v));
            set<pair<int, int>> edges;
            for (auto& t : mesh.getTriangles())
                for (int c = 0; c < 3; c++)
                    edges.insert(minmax(t[c], t[(c + 1) % 3]));
            ASSERT_EQUAL(mesh.getNumEdges(), (int) edges.size());
            ASSERT_EQUAL(2, mesh.getNumVertices() - (int) edges.size() + mesh.getNumTriangles());
        }
        ASSERT(numFlips > 1000);
        ASSERT(numDoubled > 100);
        ASSERT_EQUAL(3, lowestValence);
    }
}

void testChanges() {
    // Who knew an earlier revision learns of all vertices that changed since, or that more have than are told.

    Membrane sphere = createSphere(2);
    HelfrichMesh mesh(sphere.triangles, sphere.positions.size());
    auto find = [&](long long since) {
        vector<int> vertices;
        ASSERT(mesh.findChanges(since, vertices));
        return vertices;
    };
    vector<int> none;
    long long first = mesh.getRevision();
    ASSERT(find(first).empty());
    ASSERT(!mesh.findChanges(first - 1, none) && !mesh.findChanges(first + 1, none));
    mesh.markChanged({7, 3, 9, 3});
    ASSERT_EQUAL(first + 1, mesh.getRevision());
    mesh.markChanged({5, 7});
    ASSERT((find(first) == vector<int>{3, 5, 7, 9}) && (find(first + 1) == vector<int>{5, 7}));
    ASSERT(find(first + 2).empty() && !mesh.findChanges(first - 1, none));
    mesh.markChanged(vector<int>(mesh.getNumVertices(), 1));
    ASSERT((find(first + 2) == vector<int>{1}) && !mesh.findChanges(first + 1, none));
    for (auto& change : vector<function<void()>>{[&] { mesh.markChanged(); }, [&] { mesh.renewOrder(); },
                                                 [&] { mesh.setOrder(mesh.getOrder()); },
                                                 [&] { mesh.setTriangles(mesh.getTriangles()); }}) {
        long long before = mesh.getRevision();
        change();
        ASSERT_EQUAL(before + 1, mesh.getRevision());
        ASSERT(!mesh.findChanges(before, none) && find(before + 1).empty());
        mesh.markChanged({2});
        ASSERT(find(before + 1) == vector<int>{2});
    }
}

void testSetTriangles() {
    Membrane sphere = createSphere(1), blob = sphere;
    HelfrichMesh mesh(sphere.triangles, sphere.positions.size()), flipped = mesh;
    for (int h = 0; h < flipped.getNumHalfedges(); h++)
        if (flipped.canFlip(h))
            flipped.flip(h);
    long long revision = mesh.getRevision();
    mesh.setTriangles(flipped.getTriangles());
    ASSERT(mesh.getRevision() > revision);
    ASSERT_EQUAL_CONTAINERS(flipped.getTriangles(), mesh.getTriangles());
    for (int h = 0; h < mesh.getNumHalfedges(); h++)
        ASSERT_EQUAL(flipped.opposite(h), mesh.opposite(h));
    mesh.validate();
}

typedef vector<array<int, 2>> Edges;

/**
 * Every seventh of the edges of triangles, as particles in either order.
 */
Edges chooseEdges(const Triangles& triangles) {
    Edges edges;
    int n = 0;
    for (auto& t : triangles)
        for (int c = 0; c < 3; c++)
            if (t[c] < t[(c + 1) % 3] && n++ % 7 == 0)
                edges.push_back(n % 2 == 0 ? array<int, 2>{t[c], t[(c + 1) % 3]} : array<int, 2>{t[(c + 1) % 3], t[c]});
    return edges;
}

void testFixedEdges() {
    // However the halfedges are rewired around them, the fixed edges stay what they are.

    TestRandom random(5);
    for (int subdivisions : {1, 2}) {
        Membrane sphere = createSphere(subdivisions);
        HelfrichMesh mesh(sphere.triangles, sphere.positions.size());
        for (int h = 0; h < mesh.getNumHalfedges(); h++)
            ASSERT(!mesh.isFixed(h));
        Edges edges = chooseEdges(sphere.triangles);
        mesh.setFixedEdges(edges);
        int numFlips = 0, numKept = 0;
        for (int attempt = 0; attempt < 20000; attempt++) {
            int h = random.index(mesh.getNumHalfedges());
            if (mesh.isFixed(h)) {
                ASSERT(!mesh.canFlip(h));
                numKept++;
            }
            if (!mesh.canFlip(h))
                continue;
            mesh.flip(h);
            numFlips++;
            if (numFlips % 10 == 0)
                mesh.validate();
        }
        ASSERT(numFlips > 5000);
        ASSERT(numKept > 1000);
        auto isChosen = [&](int a, int b) {
            return find(edges.begin(), edges.end(), array<int, 2>{a, b}) != edges.end() ||
                   find(edges.begin(), edges.end(), array<int, 2>{b, a}) != edges.end();
        };
        int numFixed = 0;
        for (int h = 0; h < mesh.getNumHalfedges(); h++) {
            ASSERT_EQUAL(isChosen(mesh.origin(h), mesh.tip(h)), mesh.isFixed(h));
            numFixed += mesh.isFixed(h);
        }
        ASSERT_EQUAL(2 * (int) edges.size(), numFixed);

        // The triangles of a run that goes on have them too, and those without them leave everything as it was.

        HelfrichMesh fresh(sphere.triangles, sphere.positions.size());
        fresh.setFixedEdges(edges);
        fresh.setTriangles(mesh.getTriangles());
        for (int h = 0; h < mesh.getNumHalfedges(); h++)
            ASSERT_EQUAL(mesh.isFixed(h), fresh.isFixed(h));
        fresh.setFixedEdges({});
        ASSERT(!fresh.isFixed(0) && !fresh.isFixed(1) && !fresh.isFixed(2));
    }
}

void testSurfaces() {
    // They are numbered by their first triangles, flips leave them as they are, and an order has them one by one.

    Membrane several = createSeveralSurfaces();
    HelfrichMesh mesh(several.triangles, several.positions.size());
    ASSERT_EQUAL(3, mesh.getNumSurfaces());
    vector<int> sizes(3, 0), surfaces = mesh.getSurfaces();
    int numFound = 0;
    for (auto& t : several.triangles) {
        ASSERT_EQUAL(mesh.getSurface(t[0]), mesh.getSurface(t[1]));
        ASSERT_EQUAL(mesh.getSurface(t[0]), mesh.getSurface(t[2]));
        ASSERT(mesh.getSurface(t[0]) <= numFound);
        numFound = max(numFound, mesh.getSurface(t[0]) + 1);
    }
    for (int surface : surfaces)
        sizes[surface]++;
    ASSERT_EQUAL_CONTAINERS(sizes, mesh.getSurfaceSizes());
    TestRandom random(3);
    for (int i = 0; i < 500; i++) {
        int h = random.index(mesh.getNumHalfedges());
        if (mesh.canFlip(h))
            mesh.flip(h);
    }
    mesh.validate();
    mesh.renewOrder();
    vector<int> order = mesh.getOrder(), changes;
    for (size_t i = 1; i < order.size(); i++)
        if (mesh.getSurface(order[i]) != mesh.getSurface(order[i - 1]))
            changes.push_back(i);
    ASSERT_EQUAL(2, (int) changes.size());
    mesh.setOrder(order);
    swap(order[0], order.back());
    assertThrows([&] { mesh.setOrder(order); }, {"order", "surface together"});
    ASSERT_EQUAL_CONTAINERS(surfaces, mesh.getSurfaces());

    // Triangles in which they have other numbers are refused, and so are those that make others of them.

    Triangles triangles = mesh.getTriangles(), reversed(triangles.rbegin(), triangles.rend());
    ASSERT(HelfrichMesh(reversed, several.positions.size()).getSurfaces() != surfaces);
    assertThrows([&] { mesh.setTriangles(reversed); }, {"particle", "belongs to surface", "as before"});
    ASSERT_EQUAL_CONTAINERS(triangles, mesh.getTriangles());
    Membrane two = join({createSphere(0), createSphere(0)});
    HelfrichMesh pair(two.triangles, two.positions.size());
    for (auto& t : two.triangles)
        for (int& particle : t)
            particle = (particle == 0 ? 6 : particle == 6 ? 0 : particle);
    assertThrows([&] { pair.setTriangles(two.triangles); }, {"particle 0 belongs to surface 1, and not to surface 0"});
}

void testInvalidTriangles() {
    const Triangles octahedron = createSphere(0).triangles;
    auto check = [&](function<void(Triangles&)> damage, const vector<string>& details) {
        Triangles triangles = octahedron;
        damage(triangles);
        assertThrows([&] { HelfrichMesh(triangles, 7); }, details);
    };
    check([](Triangles& t) { t.clear(); }, {"no triangles"});
    check([](Triangles& t) { t[3][1] = 7; }, {"triangle 3 (4, 7, 2)", "index 7", "0 to 6"});
    check([](Triangles& t) { t[0][0] = -1; }, {"triangle 0", "-1", "0 to 6"});
    check([](Triangles& t) { t[2][1] = t[2][0]; }, {"triangle 2 (3, 3, 2)", "repeats"});
    check([](Triangles& t) { t.pop_back(); }, {"edge", "only", "closed"});
    check([](Triangles& t) { swap(t[4][0], t[4][1]); }, {"triangles", " 4", "counter-clockwise"});
    check([](Triangles& t) { t.push_back(t[5]); }, {"triangle 8 repeats triangle 5", "once"});
    check([](Triangles& t) { t.push_back({0, 1, 6}); }, {"edge 0-1", "3 triangles", "two"});

    // A pillow of two triangles, back to back, has two neighbors a vertex.
    assertThrows([] { HelfrichMesh({{0, 1, 2}, {2, 1, 0}}, 3); }, {"particle 0", "2 neighbors", "three"});
    // Two tetrahedra that share particle 3.
    assertThrows(
            [] {
                HelfrichMesh({{0, 1, 2}, {0, 3, 1}, {1, 3, 2}, {2, 3, 0}, {4, 5, 6}, {4, 3, 5}, {5, 3, 6}, {6, 3, 4}},
                             7);
            },
            {"particle 3", "fan"});
}

void testInvalidFixedEdges() {
    const Triangles octahedron = createSphere(0).triangles;
    HelfrichMesh mesh(octahedron, 8);
    mesh.setFixedEdges({{1, 0}});
    for (array<int, 2> edge : {array<int, 2>{0, 3}, array<int, 2>{0, 0}, array<int, 2>{0, 7}, array<int, 2>{7, 0},
                               array<int, 2>{-1, 2}, array<int, 2>{2, 99}})
        assertThrows([&] { mesh.setFixedEdges({{2, 0}, edge}); },
                     {"fixed edge 1 (" + to_string(edge[0]) + "-" + to_string(edge[1]) + ")",
                      "not an edge of the triangles"});
    assertThrows([&] { mesh.setFixedEdges({{0, 1}, {2, 0}, {1, 0}}); }, {"fixed edge 2 (1-0)", "twice"});
    HelfrichMesh other(octahedron, 8);
    for (int h = 0; h < other.getNumHalfedges(); h++)
        if (min(other.origin(h), other.tip(h)) == 0 && max(other.origin(h), other.tip(h)) == 1 && other.canFlip(h)) {
            other.flip(h);
            break;
        }
    ASSERT(!other.areBonded(0, 1));
    assertThrows([&] { mesh.setTriangles(other.getTriangles()); },
                 {"fixed edge 0 (1-0)", "not an edge of the triangles"});
    ASSERT_EQUAL_CONTAINERS(octahedron, mesh.getTriangles());
    mesh.validate();
    for (int h = 0; h < mesh.getNumHalfedges(); h++)
        ASSERT_EQUAL(max(mesh.origin(h), mesh.tip(h)) == 1, mesh.isFixed(h));
}

void testInvalidNewTriangles() {
    const Triangles octahedron = createSphere(0).triangles;
    HelfrichMesh mesh(octahedron, 8);
    Triangles moved = octahedron, tetrahedron = {{0, 1, 2}, {0, 3, 1}, {1, 3, 2}, {2, 3, 0}}, open = octahedron;
    for (auto& t : moved)
        for (int& i : t)
            i++;
    open.pop_back();
    for (auto& invalid : {moved, tetrahedron, open}) {
        assertThrows([&] { mesh.setTriangles(invalid); }, {"HelfrichForce"});
        ASSERT_EQUAL_CONTAINERS(octahedron, mesh.getTriangles());
        mesh.validate();
    }
}

int main() {
    try {
        testConnectivity();
        testParticlesOfSeveralMembranes();
        testSurfaces();
        testExclusions();
        testFlip();
        testUnflip();
        testCirculators();
        testManyFlips();
        testChanges();
        testSetTriangles();
        testFixedEdges();
        testInvalidTriangles();
        testInvalidFixedEdges();
        testInvalidNewTriangles();
    }
    catch (const exception& e) {
        cout << "exception: " << e.what() << endl;
        return 1;
    }
    cout << "Done" << endl;
    return 0;
}
