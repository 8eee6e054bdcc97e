#include "CpuHelfrichKernels.h"
#include "HelfrichEquations.h"
#include "openmm/OpenMMException.h"
#include "openmm/internal/AssertionUtilities.h"
#include <cstdlib>
#include <iostream>
#include <set>

using namespace HelfrichPlugin;
using namespace OpenMM;
using namespace std;

/**
 * The energy of a membrane, without repulsion, and its gradient, by the loops that compute in Real.
 */
template <class Real>
class Loops {
public:
    /**
     * @param moduli  the bending modulus of each vertex; or none, for that of the parameters
     */
    Loops(const Membrane& membrane, const HelfrichParameters& p, const vector<double>& moduli)
            : mesh(membrane.triangles, membrane.positions.size()) {
        auto& loops = getForProcessor<CpuHelfrichLoops>().in<Real>();
        layout.initialize(mesh, loops.width);
        layout.update(mesh, 1);
        fillArrays(membrane, moduli);
        int numSlots = layout.getNumSlots(), numGroups = layout.getNumGroups();
        (moduli.empty() ? loops.computeEnergy : loops.computeEnergyOfMaterials)(layout, p, arrays, 0, numGroups, sums);
        terms[Term::Bending] = sums.bending;
        terms[Term::Tether] = sums.tether;
        addTermsOfTotals(p, 0, sums, terms);
        vector<double, CacheLineAllocator<double>> slotGradients(4 * numSlots);
        (moduli.empty() ? loops.computeGradient : loops.computeGradientOfMaterials)(
                layout, p, getSlopesByTotals(p, 0, sums), arrays, 0, numGroups, slotGradients.data());
        for (int slot : layout.slots)
            gradient.push_back({slotGradients[4 * slot], slotGradients[4 * slot + 1], slotGradients[4 * slot + 2]});
    }
    HelfrichEnergyTerms terms;
    vector<Vec3> gradient;
private:
    typedef vector<Real, CacheLineAllocator<Real>> Array;
    void fillArrays(const Membrane& membrane, const vector<double>& moduli) {
        int numSlots = layout.getNumSlots();
        positions.resize(4 * numSlots);
        fixedPositions.resize(4 * numSlots, -1);
        for (Array* array : {&bendingSlopes, &areaSlopes, &bendingModuli, &spontaneousCurvatures})
            array->resize(numSlots);
        areMixed.resize(layout.getNumGroups(), 0);
        anglesPerLength.resize(layout.neighbors.size());
        for (int slot = 0; slot < numSlots; slot++)
            for (int i = 0; i < 3; i++)
                positions[4 * slot + i] = membrane.positions[layout.vertices[slot]][i];
        for (size_t vertex = 0; vertex < moduli.size(); vertex++)
            bendingModuli[layout.slots[vertex]] = moduli[vertex];
        const double corner[] = {-4, -4, -4}, unit = ldexp(1, -28);
        getForProcessor<CpuHelfrichLoops>().roundPositions(positions.data(), 0, mesh.getNumVertices(), corner, 1 / unit,
                                                           fixedPositions.data());
        arrays = {positions.data(),
                  bendingSlopes.data(),
                  NULL,
                  NULL,
                  NULL,
                  anglesPerLength.data(),
                  fixedPositions.data(),
                  float(unit),
                  bendingModuli.data(),
                  spontaneousCurvatures.data(),
                  areaSlopes.data(),
                  NULL,
                  NULL,
                  areMixed.data()};
    }
    HelfrichMesh mesh;
    CpuHelfrichLayout layout;
    CpuHelfrichSums sums;
    vector<double, CacheLineAllocator<double>> positions;
    vector<int, CacheLineAllocator<int>> fixedPositions;
    vector<char> areMixed;
    Array bendingSlopes, areaSlopes, bendingModuli, spontaneousCurvatures, anglesPerLength;
    CpuHelfrichArrays<Real> arrays;
};

/**
 * Bending alone and with others.
 */
static vector<HelfrichParameters> createSomeParameters(const Membrane& membrane) {
    return {createParameters(membrane, Bending), createParameters(membrane, Bending | Area | Volume | AreaDifference),
            createParameters(membrane, AllTerms).only(~Repulsion)};
}

static void assertEqualEnergies(const HelfrichEnergyTerms& expected, const HelfrichEnergyTerms& found,
                                double tolerance) {
    for (int i = 0; i < NUM_TERMS; i++)
        ASSERT_EQUAL_TOL(0, (found[Term(i)] - expected[Term(i)]) / (1e-300 + fabs(expected[Term(i)])), tolerance);
}

static void assertEqualGradients(const vector<Vec3>& expected, const vector<Vec3>& found, double tolerance) {
    double norm = 0, difference = 0;
    for (size_t i = 0; i < expected.size(); i++) {
        norm += expected[i].dot(expected[i]);
        difference += (found[i] - expected[i]).dot(found[i] - expected[i]);
    }
    ASSERT(norm > 0);
    ASSERT(sqrt(difference / norm) < tolerance);
}

/**
 * The same modulus for every vertex is the same as one modulus.
 */
template <class Real>
void testEqualModuli(double tolerance) {
    for (int subdivisions : {0, 3}) {
        Membrane blob = createBlob(subdivisions);
        for (auto& p : createSomeParameters(blob)) {
            Loops<Real> expected(blob, p, {});
            Loops<Real> found(blob, p, vector<double>(blob.positions.size(), p.moduli[Term::Bending]));
            assertEqualEnergies(expected.terms, found.terms, tolerance);
            assertEqualGradients(expected.gradient, found.gradient, tolerance);
        }
    }
}

/**
 * Moduli that differ, 0 among them.
 */
static vector<double> createModuli(int numVertices) {
    TestRandom random(4);
    vector<double> moduli;
    for (int i = 0; i < numVertices; i++)
        moduli.push_back(i % 7 == 0 ? 0 : random.uniform(1, 60));
    return moduli;
}

/**
 * The bending energy from its equation, the other terms as they were.
 */
template <class Real>
static Real computeEnergyWithModuli(const HelfrichEquations<Real>& equations, const vector<double>& moduli) {
    Real energy = equations.getTotal();
    for (size_t i = 0; i < moduli.size(); i++)
        energy += Real(2 * moduli[i]) * equations.vertexCurvatures[i] * equations.vertexCurvatures[i] /
                  equations.vertexAreas[i];
    return energy;
}

/**
 * The gradient of the same energy, by automatic differentiation.
 */
static vector<Vec3> computeGradientWithModuli(const Membrane& membrane, const HelfrichParameters& p,
                                              const vector<double>& moduli) {
    vector<array<Dual, 3>> x;
    for (auto& point : membrane.positions)
        x.push_back({Dual(point[0]), Dual(point[1]), Dual(point[2])});
    vector<Vec3> gradient;
    for (auto& point : x) {
        gradient.push_back(Vec3());
        for (int i = 0; i < 3; i++) {
            point[i].slope = 1;
            gradient.back()[i] =
                    computeEnergyWithModuli(HelfrichEquations<Dual>(membrane.triangles, x, p), moduli).slope;
            point[i].slope = 0;
        }
    }
    return gradient;
}

/**
 * With a modulus for each vertex, energy and gradient are those of the equation.
 */
template <class Real>
void testDifferentModuli(double tolerance) {
    Membrane blob = createBlob(2);
    vector<double> moduli = createModuli(blob.positions.size());
    for (auto& p : createSomeParameters(blob)) {
        HelfrichParameters others = p.only(~Bending);
        double exact = computeEnergyWithModuli(computeExactly(blob, others), moduli);
        Loops<Real> found(blob, p, moduli);
        ASSERT_EQUAL_TOL(1, found.terms.getTotal() / exact, tolerance);
        assertEqualGradients(computeGradientWithModuli(blob, others, moduli), found.gradient, tolerance);
    }
}

/**
 * Assert that a layout is that of a mesh with no past.
 */
static void assertFresh(const CpuHelfrichLayout& layout, const HelfrichMesh& mesh) {
    CpuHelfrichLayout fresh;
    fresh.initialize(mesh, layout.width);
    fresh.update(mesh, 1);
    ASSERT_EQUAL_CONTAINERS(fresh.vertices, layout.vertices);
    ASSERT_EQUAL_CONTAINERS(fresh.slots, layout.slots);
    ASSERT_EQUAL_CONTAINERS(fresh.valences, layout.valences);
    set<int> places;
    size_t size = 0;
    for (int g = 0; g < layout.getNumGroups(); g++) {
        const CpuHelfrichLayout::Group &group = layout.groups[g], &expected = fresh.groups[g];
        ASSERT_EQUAL(expected.length, group.length);
        ASSERT_EQUAL(expected.isPadded, group.isPadded);
        ASSERT_EQUAL(expected.origin, group.origin);
        for (int lane = 0; lane < layout.width; lane++)
            for (int i = 0; i < group.length; i++) {
                int place = group.start + i * layout.width + lane, valence = layout.valences[g * layout.width + lane];
                // After the last neighbor comes the first one again, and padding may have any but its own vertex.
                int neighbor = (valence > 0 ? fresh.neighbors[expected.start + i * layout.width + lane]
                                            : layout.neighbors[group.start + lane]);
                ASSERT_EQUAL(neighbor, layout.neighbors[place]);
                ASSERT(neighbor % 4 == 0 && neighbor >= 0 && neighbor < 4 * layout.getNumSlots());
                ASSERT(valence > 0 || layout.valences[neighbor / 4] > 0);
                ASSERT(valence > 0 || neighbor / 4 != layout.slots[0]);
                places.insert(place);
                size++;
            }
    }
    ASSERT_EQUAL(size, places.size());
    ASSERT(*places.begin() >= 0 && *places.rbegin() < (int) layout.neighbors.size());
}

/**
 * More slots of padding than rings that are found together have a neighbor, too, of which no length is 0.
 */
void testPaddingIsNoPoint() {
    TestRandom random(9);
    Membrane membrane = createBlob(2);
    ASSERT_EQUAL(2, membrane.positions.size() % 16);
    HelfrichMesh mesh(membrane.triangles, membrane.positions.size());
    for (int round = 0; round < 2000; round++) {
        for (int i = 0; i < 20; i++) {
            int h = random.index(mesh.getNumHalfedges());
            if (mesh.canFlip(h))
                mesh.flip(h);
        }
        CpuHelfrichLayout layout;
        layout.initialize(mesh, 16);
        layout.update(mesh, 1);
        assertFresh(layout, mesh);
    }
}

void testLayoutFollowsFlips() {
    // Whether few or many edges have flipped, or the triangles or the order are others.

    TestRandom random(8);
    for (auto& membrane : {createBlob(0), createSeveralSurfaces(), createBlob(4)})
        for (int width : {2, 8, 16}) {
            HelfrichMesh mesh(membrane.triangles, membrane.positions.size());
            CpuHelfrichLayout layout;
            layout.initialize(mesh, width);
            for (int round = 0; round < 60; round++) {
                vector<int> changed;
                for (int i = random.index(round % 20 == 0 ? mesh.getNumEdges() : mesh.getNumEdges() / 30 + 2); i > 0;
                     i--) {
                    int h = random.index(mesh.getNumHalfedges()), o = mesh.opposite(h);
                    if (!mesh.canFlip(h))
                        continue;
                    changed.insert(changed.end(), {mesh.origin(h), mesh.origin(o), mesh.apex(h), mesh.apex(o)});
                    mesh.flip(h);
                }
                mesh.markChanged(changed);
                if (round == 30)
                    mesh.setTriangles(membrane.triangles);
                if (round == 45)
                    mesh.renewOrder();
                layout.update(mesh, 1 + round % 3);
                assertFresh(layout, mesh);
            }
        }
}

int main() {
    try {
        int numSupported = 0;
        for (const char* name : {"Baseline", "AVX2", "AVX512"}) {
            setenv("OPENMM_HELFRICH_SIMD", name, 1);
            try {
                getForProcessor<CpuHelfrichLoops>();
            }
            catch (const OpenMMException&) {
                continue;
            }
            numSupported++;
            testEqualModuli<double>(1e-14);
            testEqualModuli<float>(1e-6);
            testDifferentModuli<double>(1e-12);
            testDifferentModuli<float>(3e-6);
        }
        ASSERT(numSupported > 0);
        testPaddingIsNoPoint();
        testLayoutFollowsFlips();
    }
    catch (const exception& e) {
        cout << "exception: " << e.what() << endl;
        return 1;
    }
    cout << "Done" << endl;
    return 0;
}
