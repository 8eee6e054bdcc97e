#include "CpuHelfrichMaterials.h"
#include "CpuThreads.h"
#include "openmmhelfrich/internal/HelfrichStencils.h"
#include <algorithm>
#include <cmath>

using namespace HelfrichPlugin;
using namespace std;

/**
 * The number of groups that a thread fills at a time.
 */
static const int GROUPS_PER_PART = 64;

void CpuHelfrichMaterials::update(const HelfrichMesh& mesh, const CpuHelfrichLayout& layout,
                                  const vector<CpuHelfrichLayout::Part>& parts, const HelfrichParameters& p,
                                  bool isSingle, int numThreads) {
    box = p.box;
    TermMask terms;
    for (Term term : {Term::Bending, Term::Gaussian, Term::Line})
        if (p.has(term))
            terms = terms | term;
    if (areValid && table == p.species && speciesRevision == mesh.getSpeciesRevision() &&
        spontaneousCurvature == p.spontaneousCurvature && this->terms == terms && this->isSingle == isSingle)
        return;
    table = p.species;
    speciesRevision = mesh.getSpeciesRevision();
    spontaneousCurvature = p.spontaneousCurvature;
    this->terms = terms;
    this->isSingle = isSingle;
    hasLines = p.has(Term::Line);
    hasGaussian = p.hasGaussianForces();
    if (isSingle)
        fill<float>(mesh, layout, p, numThreads);
    else
        fill<double>(mesh, layout, p, numThreads);
    meetings.resize(hasLines ? parts.size() : 0);
    CpuThreads::forEach(numThreads, meetings.size(), [&](int i) { findMeetings(layout, parts[i], p, meetings[i]); });
    if (hasGaussian)
        addUpGaussian(mesh, p);
    areValid = true;
}

template <class Real>
void CpuHelfrichMaterials::fill(const HelfrichMesh& mesh, const CpuHelfrichLayout& layout, const HelfrichParameters& p,
                                int numThreads) {
    // Arrays of a type have room for one that is larger.

    species.resize(layout.getNumSlots());
    areMixed.resize(layout.getNumGroups());
    for (Array* array : {&bendingModuli, &spontaneousCurvatures, &areaSlopes})
        array->resize(layout.getNumSlots());
    gaussianModuli.resize(hasGaussian ? layout.getNumSlots() : 0);
    lineTensions.reserve(hasLines ? layout.neighbors.capacity() : 0);
    lineTensions.resize(hasLines ? layout.neighbors.size() : 0);
    CpuThreads::forEachPart(numThreads, layout.getNumSlots(), GROUPS_PER_PART * layout.width, [&](int begin, int end) {
        for (int slot = begin; slot < end; slot++) {
            species[slot] = mesh.getSpecies(layout.vertices[slot]);
            HelfrichSpecies material = p.getMaterial(species[slot]);
            reinterpret_cast<Real*>(bendingModuli.data())[slot] = material.bendingModulus;
            reinterpret_cast<Real*>(spontaneousCurvatures.data())[slot] = material.spontaneousCurvature;
            if (hasGaussian)
                reinterpret_cast<Real*>(gaussianModuli.data())[slot] = material.gaussianModulus;
        }
    });
    CpuThreads::forEachPart(numThreads, layout.getNumGroups(), GROUPS_PER_PART, [&](int begin, int end) {
        for (int g = begin; g < end; g++)
            fillRings<Real>(layout, p, g);
    });
    spreadMixed(layout);
}

void CpuHelfrichMaterials::spreadMixed(const CpuHelfrichLayout& layout) {
    // Loops that know of mixtures differ in the last bits.  Which vertices they compute must not depend on the layout's
    // width, which is a divisor of the greatest.

    int numGroups = CpuHelfrichLayout::MAX_WIDTH / layout.width;
    for (int first = 0, last; first < layout.getNumGroups(); first = last) {
        bool isMixed = false;
        for (last = first; last < min(first + numGroups, layout.getNumGroups()) &&
                           layout.groups[last].origin == layout.groups[first].origin;
             last++)
            isMixed = isMixed || areMixed[last];
        fill_n(&areMixed[first], last - first, isMixed);
    }
}

template <class Real>
void CpuHelfrichMaterials::fillRings(const CpuHelfrichLayout& layout, const HelfrichParameters& p, int g) {
    // In a triangle (a, a, b) the boundary is half as long as the edge of the like ones, which has two triangles.

    const CpuHelfrichLayout::Group& group = layout.groups[g];
    Real* tensions = reinterpret_cast<Real*>(lineTensions.data());
    bool isMixed = false;
    for (int lane = 0; lane < layout.width; lane++) {
        int own = species[g * layout.width + lane], valence = layout.valences[g * layout.width + lane];
        auto ofNeighbor = [&](int i) { return species[layout.neighbors[group.start + i * layout.width + lane] / 4]; };
        for (int i = 0; i < group.length; i++) {
            int neighbor = ofNeighbor(i);
            isMixed = isMixed || (i < valence && neighbor != own);
            if (!hasLines)
                continue;
            double tension = 0;
            if (i < valence && neighbor == own)
                tension = 0.5 * (p.getLineTension(own, ofNeighbor(i == 0 ? valence - 1 : i - 1)) +
                                 p.getLineTension(own, ofNeighbor(i == valence - 1 ? 0 : i + 1)));
            tensions[group.start + i * layout.width + lane] = tension;
        }
    }
    areMixed[g] = isMixed && (hasLines || hasGaussian);
}

void CpuHelfrichMaterials::findMeetings(const CpuHelfrichLayout& layout, const CpuHelfrichLayout::Part& part,
                                        const HelfrichParameters& p, vector<Meeting>& found) const {
    found.clear();
    for (int slot = part.firstSlot; slot < part.getEnd(); slot++) {
        int g = slot / layout.width, lane = slot % layout.width, valence = layout.valences[slot];
        if (!areMixed[g])
            continue;
        const int* neighbors = &layout.neighbors[layout.groups[g].start + lane];
        for (int i = 0; i < valence; i++) {
            int j = neighbors[i * layout.width] / 4, k = neighbors[(i + 1 == valence ? 0 : i + 1) * layout.width] / 4;
            int a = species[slot], b = species[j], c = species[k];
            if (a == b || b == c || c == a)
                continue;
            Meeting meeting = {{slot, j, k}, {p.getLineTension(b, c), p.getLineTension(c, a), p.getLineTension(a, b)}};
            if (meeting.tensions[0] != 0 || meeting.tensions[1] != 0 || meeting.tensions[2] != 0)
                found.push_back(meeting);
        }
    }
}

void CpuHelfrichMaterials::addUpGaussian(const HelfrichMesh& mesh, const HelfrichParameters& p) {
    // As if all angles were those of equilateral triangles.  Where the corners of one have the same modulus, the sum of
    // its angles is all that matters.

    gaussianConstant = 0;
    for (int v = 0; v < mesh.getNumVertices(); v++)
        gaussianConstant +=
                p.getMaterial(mesh.getSpecies(v)).gaussianModulus * (2 * M_PI - mesh.valence(v) * (M_PI / 3));
}

template <class Real>
void CpuHelfrichMaterials::setArrays(CpuHelfrichArrays<Real>& arrays) {
    arrays.bendingModuli = reinterpret_cast<Real*>(bendingModuli.data());
    arrays.spontaneousCurvatures = reinterpret_cast<Real*>(spontaneousCurvatures.data());
    arrays.areaSlopes = reinterpret_cast<Real*>(areaSlopes.data());
    arrays.gaussianModuli = hasGaussian ? reinterpret_cast<Real*>(gaussianModuli.data()) : nullptr;
    arrays.lineTensions = hasLines ? reinterpret_cast<Real*>(lineTensions.data()) : nullptr;
    arrays.areMixed = areMixed.data();
}

template void CpuHelfrichMaterials::setArrays(CpuHelfrichArrays<double>&);
template void CpuHelfrichMaterials::setArrays(CpuHelfrichArrays<float>&);

/**
 * Six times the vector from the centroid of three points to the middle between two of them.
 */
static Vector3<double> toMiddle(const Vector3<double> (&x)[3], int opposite, const PeriodicBox& box) {
    return displacement(x[opposite], x[(opposite + 1) % 3], box) +
           displacement(x[opposite], x[(opposite + 2) % 3], box);
}

static void loadPoints(const double* positions, const int (&slots)[3], Vector3<double> (&x)[3]) {
    for (int i = 0; i < 3; i++) {
        const double* point = positions + 4 * slots[i];
        x[i] = {point[0], point[1], point[2]};
    }
}

double CpuHelfrichMaterials::computeMeetings(const double* positions, int part) const {
    // Each of a triangle's vertices adds a third.

    double energy = 0;
    Vector3<double> x[3];
    if (meetings.empty())
        return 0;
    for (const Meeting& meeting : meetings[part]) {
        loadPoints(positions, meeting.slots, x);
        for (int i = 0; i < 3; i++) {
            Vector3<double> d = toMiddle(x, i, box);
            energy += meeting.tensions[i] * sqrt(dot(d, d));
        }
    }
    return energy / 18;
}

void CpuHelfrichMaterials::addGradientOfMeetings(const double* positions, int part, int firstSlot,
                                                 double* gradients) const {
    Vector3<double> x[3];
    if (meetings.empty())
        return;
    for (const Meeting& meeting : meetings[part]) {
        loadPoints(positions, meeting.slots, x);
        double* gradient = gradients + 4 * (meeting.slots[0] - firstSlot);
        for (int i = 0; i < 3; i++) {
            Vector3<double> d = toMiddle(x, i, box);
            double length = sqrt(dot(d, d)), factor = (i == 0 ? -2 : 1) * meeting.tensions[i] / 6;
            factor = (length == 0 ? 0 : factor / length);
            gradient[0] += factor * d.x;
            gradient[1] += factor * d.y;
            gradient[2] += factor * d.z;
        }
    }
}
