#include "CpuHelfrichKernels.h"
#include "CpuThreads.h"
#include "openmmhelfrich/internal/Interruption.h"
#include "openmm/System.h"
#include "openmm/internal/ContextImpl.h"
#include "openmm/reference/ReferencePlatform.h"
#include <algorithm>
#include <atomic>
#include <cmath>
#include <numeric>

using namespace HelfrichPlugin;
using namespace OpenMM;
using namespace std;

static const int SLOTS_PER_CHUNK = 64;

static ReferencePlatform::PlatformData& getData(ContextImpl& context) {
    return *reinterpret_cast<ReferencePlatform::PlatformData*>(context.getPlatformData());
}

/**
 * The number of vertices or particles that makes it worth to wake another thread.
 */
static const int ITEMS_PER_THREAD = 500;

/**
 * The number of vertices or particles that a thread takes at a time.
 */
static const int ITEMS_PER_PART = 256;

static int chooseNumThreads(ContextImpl& context, int numItems) {
    return max(1, min(getData(context).threads.getNumThreads(), numItems / ITEMS_PER_THREAD));
}

void CpuCalcHelfrichForceKernel::initialize(const System& system, const HelfrichForce& force,
                                            const HelfrichMesh& mesh) {
    this->mesh = &mesh;
    isPeriodic = force.usesPeriodicBoundaryConditions();
    if (isPeriodic)
        loops = &getForProcessor<CpuPeriodicHelfrichLoops>();
    setLayoutWidth(loops->inDouble.width);
}

void CpuCalcHelfrichForceKernel::setLayoutWidth(int width) {
    if (layout.width == width && layout.getNumGroups() != 0)
        return;
    layout.initialize(*mesh, width);
    chunks = layout.divide(*mesh, SLOTS_PER_CHUNK);
    positions.resize(4 * layout.getNumSlots());
    chunkSums.resize(getNumChunks());
    chunkBoxes.resize(getNumChunks());
    particles.resize(layout.getNumSlots());
    revision = mesh->getRevision() - 1;
}

void CpuCalcHelfrichForceKernel::chooseNumThreads(ContextImpl& context) {
    numThreads = ::chooseNumThreads(context, mesh->getNumVertices());
}

template <class Function>
void CpuCalcHelfrichForceKernel::forEachChunk(const Function& function) const {
    CpuThreads::forEach(numThreads, getNumChunks(), function);
}

void CpuCalcHelfrichForceKernel::updateLayout() {
    if (revision == mesh->getRevision())
        return;
    layout.update(*mesh, numThreads);
    chunks = layout.divide(*mesh, SLOTS_PER_CHUNK);
    fixedPositions.clear();
    CpuThreads::forEachPart(numThreads, layout.getNumSlots(), SLOTS_PER_CHUNK, [&](int begin, int end) {
        for (int slot = begin; slot < end; slot++)
            particles[slot] = mesh->getParticles()[layout.vertices[slot]];
    });
    repulsion.followLayout(layout, numThreads);
    materials.invalidate();
    isGeometryKnown = false;
    revision = mesh->getRevision();
}

void CpuCalcHelfrichForceKernel::setBox(const PeriodicBox& newBox) {
    isGeometryKnown &= (newBox == box);
    box = newBox;
    repulsion.setBox(box);
}

template <class Real>
CpuHelfrichArrays<Real> CpuCalcHelfrichForceKernel::prepareArrays(const HelfrichParameters& parameters) {
    updateLayout();
    setBox(parameters.box);
    if (parameters.needsCurvature() || parameters.hasForcesOfSpecies()) {
        bendingSlopes.resize(layout.getNumSlots());
        anglesPerLength.reserve(layout.neighbors.capacity());
        anglesPerLength.resize(layout.neighbors.size());
    }
    CpuHelfrichArrays<Real> arrays = {positions.data(), reinterpret_cast<Real*>(bendingSlopes.data()), NULL, NULL,
                                      reinterpret_cast<Real*>(anglesPerLength.data())};
    arrays.box = parameters.box;
    if constexpr (is_same<Real, float>::value) {
        // No vertex is ever where slots without one stay, for an edge between them would have no length.
        fixedPositions.resize(positions.size(), -1);
        arrays.fixedPositions = fixedPositions.data();
    }
    if (parameters.hasForcesOfSpecies()) {
        materials.update(*mesh, layout, chunks, parameters, is_same<Real, float>::value, numThreads);
        materials.setArrays(arrays);
    }
    return arrays;
}

bool CpuCalcHelfrichForceKernel::canKeepGeometry(const HelfrichParameters& parameters) const {
    return isGeometryWanted && parameters.needsCurvature() && !parameters.hasForcesOfSpecies();
}

void CpuCalcHelfrichForceKernel::keepGeometry(CpuHelfrichArrays<double>& arrays) {
    geometry.areas.resize(layout.getNumSlots());
    geometry.curvatures.resize(layout.getNumSlots());
    geometry.slots = layout.slots.data();
    arrays.areas = geometry.areas.data();
    arrays.curvatures = geometry.curvatures.data();
}

int CpuCalcHelfrichForceKernel::getNumChunks() const {
    return chunks.size();
}

int CpuCalcHelfrichForceKernel::getFirstGroup(int chunk) const {
    return chunks[chunk].firstSlot / layout.width;
}

int CpuCalcHelfrichForceKernel::getLastGroup(int chunk) const {
    return (chunks[chunk].getEnd() + layout.width - 1) / layout.width;
}

int CpuCalcHelfrichForceKernel::getFirstSlot(int chunk) const {
    return chunks[chunk].firstSlot;
}

int CpuCalcHelfrichForceKernel::getLastSlot(int chunk) const {
    return chunks[chunk].getEnd();
}

bool CpuCalcHelfrichForceKernel::loadPositions(const vector<Vec3>& source, int chunk) {
    bool areSame = true;
    auto load = [&](int slot) {
        const Vec3& x = source[particles[slot]];
        double* position = &positions[4 * slot];
        bool isSame = (position[0] == x[0]) & (position[1] == x[1]) & (position[2] == x[2]);
        position[0] = x[0];
        position[1] = x[1];
        position[2] = x[2];
        return isSame;
    };
    for (int slot = getFirstSlot(chunk); slot < getLastSlot(chunk); slot++)
        areSame &= load(slot);
    for (int slot = getLastSlot(chunk); slot < getLastGroup(chunk) * layout.width; slot++)
        load(slot);
    return areSame;
}

void CpuCalcHelfrichForceKernel::loadPositions(ContextImpl& context) {
    const vector<Vec3>& source = *getData(context).positions;
    atomic<bool> areSame{isGeometryKnown};
    forEachChunk([&](int chunk) {
        if (!loadPositions(source, chunk))
            areSame = false;
    });
    isGeometryKnown = areSame;
}

/**
 * A sum that carries the rounding errors along (Neumaier, 1974).
 */
class CompensatedSum {
public:
    void add(double term) {
        double next = sum + term;
        error += (fabs(sum) >= fabs(term) ? (sum - next) + term : (term - next) + sum);
        sum = next;
    }
    double get() const {
        return isfinite(sum) ? sum + error : sum;
    }
private:
    double sum = 0, error = 0;
};

static double addUp(const vector<double>& terms) {
    CompensatedSum total;
    for (double term : terms)
        total.add(term);
    return total.get();
}

static double addUp(const vector<CpuHelfrichSums>& sums, double CpuHelfrichSums::* member, size_t first, size_t last) {
    CompensatedSum total;
    for (size_t chunk = first; chunk < last; chunk++)
        total.add(sums[chunk].*member);
    return total.get();
}

static double addUp(const vector<CpuHelfrichSums>& sums, double CpuHelfrichSums::* member) {
    return addUp(sums, member, 0, sums.size());
}

template <class Real>
void CpuCalcHelfrichForceKernel::computeEnergy(const HelfrichParameters& parameters,
                                               const CpuHelfrichArrays<Real>& arrays, CpuMembraneSums& sums) {
    bool hasMaterials = parameters.hasForcesOfSpecies();
    auto compute = hasMaterials ? loops->in<Real>().computeEnergyOfMaterials : loops->in<Real>().computeEnergy;
    forEachChunk([&](int chunk) {
        compute(layout, parameters, arrays, getFirstGroup(chunk), getLastGroup(chunk), chunkSums[chunk]);
        if (hasMaterials)
            chunkSums[chunk].line += materials.computeMeetings(arrays.positions, chunk);
        if (parameters.has(Term::Repulsion))
            chunkSums[chunk].outdated = repulsion.hasMoved(arrays.positions, getFirstSlot(chunk), getLastSlot(chunk));
    });
    sums.bending = addUp(chunkSums, &CpuHelfrichSums::bending);
    sums.tether = addUp(chunkSums, &CpuHelfrichSums::tether);
    if (hasMaterials) {
        sums.gaussian = addUp(chunkSums, &CpuHelfrichSums::gaussian);
        sums.line = addUp(chunkSums, &CpuHelfrichSums::line);
    }
    addUpSurfaces(sums);
    isGeometryKnown = (arrays.areas != NULL);
    if (isGeometryKnown) {
        geometry.totals = sums.totals;
        geometry.number++;
        hadTether = parameters.has(Term::Tether);
    }
}

void CpuCalcHelfrichForceKernel::addUpSurfaces(CpuMembraneSums& sums) const {
    sums.area = 0;
    for (size_t first = 0, last; first < chunks.size(); first = last) {
        int surface = chunks[first].surface;
        for (last = first; last < chunks.size() && chunks[last].surface == surface; last++)
            ;
        HelfrichTotals& totals = sums.totals[surface];
        totals.area = addUp(chunkSums, &CpuHelfrichSums::area, first, last);
        totals.volume = isPeriodic ? 0 : addUp(chunkSums, &CpuHelfrichSums::volume, first, last);
        totals.curvature = addUp(chunkSums, &CpuHelfrichSums::curvature, first, last);
        sums.area += totals.area;
    }
}

void CpuCalcHelfrichForceKernel::findSlopes(const HelfrichParameters& parameters, CpuMembraneSums& sums) {
    HelfrichTotals spontaneous = getSpontaneousSlopes(parameters);
    for (size_t surface = 0; surface < sums.totals.size(); surface++) {
        sums.slopes[surface] = getSlopesByTotals(parameters, surface, sums.totals[surface]);
        sums.slopes[surface] += spontaneous;
    }
}

void CpuCalcHelfrichForceKernel::updateRepulsion(const HelfrichParameters& parameters, const double* positions) {
    if (parameters.has(Term::Repulsion))
        repulsion.update(*mesh, layout, positions, parameters, addUp(chunkSums, &CpuHelfrichSums::outdated) != 0);
}

void CpuCalcHelfrichForceKernel::computeRepulsion(const HelfrichParameters& parameters, const double* positions,
                                                  int chunk, double* gradients) {
    chunkSums[chunk].repulsion =
            repulsion.compute(positions, parameters, getFirstSlot(chunk), getLastSlot(chunk), gradients);
}

template <class Real>
void CpuCalcHelfrichForceKernel::computeGradient(const HelfrichParameters& parameters, const CpuMembraneSums& sums,
                                                 const CpuHelfrichArrays<Real>& arrays, int chunk, double* gradients) {
    bool hasMaterials = parameters.hasForcesOfSpecies();
    auto compute = hasMaterials ? loops->in<Real>().computeGradientOfMaterials : loops->in<Real>().computeGradient;
    compute(layout, parameters, sums.slopes[chunks[chunk].surface], arrays, getFirstGroup(chunk), getLastGroup(chunk),
            gradients);
    if (hasMaterials)
        materials.addGradientOfMeetings(arrays.positions, chunk, getFirstSlot(chunk), gradients);
    if (parameters.has(Term::Repulsion))
        computeRepulsion(parameters, arrays.positions, chunk, gradients);
}

HelfrichEnergyTerms CpuCalcHelfrichForceKernel::getTerms(const HelfrichParameters& parameters,
                                                         const CpuMembraneSums& sums) const {
    HelfrichEnergyTerms terms;
    HelfrichTotals spontaneous = getSpontaneousSlopes(parameters);
    terms[Term::Bending] = sums.bending;
    for (auto& totals : sums.totals)
        terms[Term::Bending] += spontaneous.area * totals.area + spontaneous.curvature * totals.curvature;
    terms[Term::Tether] = sums.tether;
    terms[Term::Line] = sums.line;
    if (parameters.hasGaussianForces())
        terms[Term::Gaussian] = sums.gaussian + materials.getGaussianConstant();
    if (parameters.has(Term::Repulsion))
        terms[Term::Repulsion] = addUp(chunkSums, &CpuHelfrichSums::repulsion);
    for (size_t surface = 0; surface < sums.totals.size(); surface++)
        addTermsOfTotals(parameters, surface, sums.totals[surface], terms);
    return terms;
}

bool CpuCalcHelfrichForceKernel::execute(ContextImpl& context, const HelfrichParameters& parameters, bool includeForces,
                                         HelfrichEnergyTerms& terms) {
    chooseNumThreads(context);
    auto arrays = prepareArrays<double>(parameters);
    vector<Vec3>& forces = *getData(context).forces;
    CpuMembraneSums sums(mesh->getNumSurfaces());
    loadPositions(context);
    if (canKeepGeometry(parameters))
        keepGeometry(arrays);
    computeEnergy(parameters, arrays, sums);
    if (isfinite(sums.area)) {
        updateRepulsion(parameters, arrays.positions);
        findSlopes(parameters, sums);
        if (includeForces)
            forEachChunk(
                    [&](int chunk) { chunkSums[chunk].force = addForces(parameters, sums, arrays, chunk, forces); });
        else if (parameters.has(Term::Repulsion))
            forEachChunk([&](int chunk) { computeRepulsion(parameters, arrays.positions, chunk, NULL); });
    }
    terms = getTerms(parameters, sums);
    return isfinite(sums.area) && (!includeForces || isfinite(addUp(chunkSums, &CpuHelfrichSums::force)));
}

double CpuCalcHelfrichForceKernel::addForces(const HelfrichParameters& parameters, const CpuMembraneSums& sums,
                                             const CpuHelfrichArrays<double>& arrays, int chunk, vector<Vec3>& forces) {
    alignas(64) double gradients[4 * SLOTS_PER_CHUNK];
    computeGradient(parameters, sums, arrays, chunk, gradients);
    const double* gradient = gradients;
    double sum = 0;
    for (int slot = getFirstSlot(chunk); slot < getLastSlot(chunk); slot++, gradient += 4) {
        forces[particles[slot]] -= Vec3(gradient[0], gradient[1], gradient[2]);
        sum += gradient[0] + gradient[1] + gradient[2];
    }
    return sum;
}

void CpuCalcHelfrichForceKernel::loadState(ContextImpl& context, int chunk) {
    loadPositions(*getData(context).positions, chunk);
    chunkBoxes[chunk] = loops->findBox(positions.data(), getFirstSlot(chunk), getLastSlot(chunk));
    const vector<Vec3>& source = *getData(context).velocities;
    for (int slot = getFirstSlot(chunk); slot < getLastSlot(chunk); slot++) {
        const Vec3& v = source[particles[slot]];
        double mass = context.getSystem().getParticleMass(particles[slot]);
        velocities[4 * slot] = v[0];
        velocities[4 * slot + 1] = v[1];
        velocities[4 * slot + 2] = v[2];
        velocities[4 * slot + 3] = (mass == 0 ? 0 : 1 / mass);
    }
    fill(velocities.begin() + 4 * getLastSlot(chunk), velocities.begin() + 4 * getLastGroup(chunk) * layout.width, 0.0);
}

void CpuCalcHelfrichForceKernel::storeState(ContextImpl& context, const double* positions, int chunk) const {
    for (int slot = getFirstSlot(chunk); slot < getLastSlot(chunk); slot++) {
        const double *x = positions + 4 * slot, *v = &velocities[4 * slot];
        (*getData(context).positions)[particles[slot]] = Vec3(x[0], x[1], x[2]);
        (*getData(context).velocities)[particles[slot]] = Vec3(v[0], v[1], v[2]);
    }
}

template <class Real>
void CpuCalcHelfrichForceKernel::move(const HelfrichParameters& parameters, const CpuMembraneSums& sums,
                                      const CpuHelfrichArrays<Real>& arrays, int chunk, const KickAndDrift& times,
                                      double* nextPositions) {
    // The same operations as those of the integrator's own kernel: the result does not depend on which of them moves
    // the vertices.

    alignas(64) double gradients[4 * SLOTS_PER_CHUNK];
    int firstSlot = getFirstSlot(chunk), lastSlot = getLastGroup(chunk) * layout.width;
    for (int slot = firstSlot; slot < lastSlot; slot += 2) {
        __builtin_prefetch(&velocities[4 * slot], 1);
        __builtin_prefetch(nextPositions + 4 * slot, 1);
    }
    computeGradient(parameters, sums, arrays, chunk, gradients);
    const double* gradient = gradients;
    for (int slot = firstSlot; slot < lastSlot; slot++, gradient += 4) {
        const double* x = arrays.positions + 4 * slot;
        double *v = &velocities[4 * slot], *next = nextPositions + 4 * slot;
        bool isFrozen = (v[3] == 0);
        for (int i = 0; i < 3; i++) {
            v[i] = isFrozen ? v[i] : v[i] - times.kick * v[3] * gradient[i];
            next[i] = isFrozen ? x[i] : x[i] + times.drift * v[i];
        }
    }
    if constexpr (is_same<Real, float>::value)
        chunkBoxes[chunk] = loops->findBox(nextPositions, firstSlot, getLastSlot(chunk));
}

template <class Real>
void CpuCalcHelfrichForceKernel::kick(const HelfrichParameters& parameters, const CpuMembraneSums& sums,
                                      const CpuHelfrichArrays<Real>& arrays, int chunk, double time) {
    alignas(64) double gradients[4 * SLOTS_PER_CHUNK];
    computeGradient(parameters, sums, arrays, chunk, gradients);
    const double* gradient = gradients;
    Real* force = reinterpret_cast<Real*>(forces.data()) + 4 * getFirstSlot(chunk);
    for (int slot = getFirstSlot(chunk); slot < getLastSlot(chunk); slot++, gradient += 4, force += 4) {
        double* v = &velocities[4 * slot];
        for (int i = 0; i < 3; i++) {
            v[i] = (v[3] == 0 ? v[i] : v[i] - time * v[3] * gradient[i]);
            force[i] = Real(-gradient[i]);
        }
        force[3] = 0;
    }
}

template <class Real>
void CpuCalcHelfrichForceKernel::drift(const CpuHelfrichArrays<Real>& arrays, int chunk, double time,
                                       double* nextPositions) {
    alignas(64) Real motions[4 * SLOTS_PER_CHUNK];
    int firstSlot = getFirstSlot(chunk), lastSlot = getLastGroup(chunk) * layout.width;
    coarse->getMeshes(0).getMotion(firstSlot, lastSlot, motions);
    const Real* motion = motions;
    for (int slot = firstSlot; slot < lastSlot; slot++, motion += 4) {
        const double *x = arrays.positions + 4 * slot, *v = &velocities[4 * slot];
        for (int i = 0; i < 3; i++)
            nextPositions[4 * slot + i] = (v[3] == 0 ? x[i] : x[i] + time * (v[i] + motion[i]));
    }
    if constexpr (is_same<Real, float>::value)
        chunkBoxes[chunk] = loops->findBox(nextPositions, firstSlot, getLastSlot(chunk));
}

template <class Real>
void CpuCalcHelfrichForceKernel::moveAll(const HelfrichParameters& parameters, const CpuMembraneSums& sums,
                                         const CpuHelfrichArrays<Real>& arrays, const KickAndDrift& times,
                                         double* nextPositions) {
    if (coarse == NULL) {
        forEachChunk([&](int chunk) { move(parameters, sums, arrays, chunk, times, nextPositions); });
        return;
    }
    CpuCoarseMeshes& meshes = coarse->getMeshes(0);
    CoarseVelocities& ofMeshes = coarse->getVelocities(0);
    forEachChunk([&](int chunk) { kick(parameters, sums, arrays, chunk, times.kick); });
    meshes.kick(reinterpret_cast<const Real*>(forces.data()), times.kick, coarse->getWeight(), ofMeshes, numThreads);
    meshes.findMotion<Real>(coarse->getWeight(), ofMeshes, numThreads);
    forEachChunk([&](int chunk) { drift(arrays, chunk, times.drift, nextPositions); });
}

bool CpuCalcHelfrichForceKernel::roundPositions(CpuHelfrichArrays<float>& arrays) {
    // The forces must be a function of the positions alone, for only then are the steps reversible: origin and unit of
    // the fixed point numbers are those of the step's own positions.  The unit is a power of two, and so adds no error.

    CpuHelfrichBox box = chunkBoxes[0];
    double extent = 0;
    for (int i = 0; i < 3; i++) {
        for (auto& chunkBox : chunkBoxes) {
            if (!isfinite(chunkBox.upper[i] - chunkBox.lower[i]))
                return false;
            box.lower[i] = min(box.lower[i], chunkBox.lower[i]);
            box.upper[i] = max(box.upper[i], chunkBox.upper[i]);
        }
        extent = max(extent, box.upper[i] - box.lower[i]);
    }
    if (!isfinite(extent))
        return false;
    int exponent;
    frexp(extent, &exponent);
    double unit = ldexp(1, exponent - 31);
    forEachChunk([&](int chunk) {
        loops->roundPositions(arrays.positions, getFirstSlot(chunk), getLastSlot(chunk), box.lower, 1 / unit,
                              arrays.fixedPositions);
    });
    arrays.fixedUnit = unit;
    for (int i = 0; i < 3; i++)
        arrays.fixedBox[i] = (uint32_t) (uint64_t) llround(min(arrays.box.lengths[i] / unit, 0x1p62));
    return true;
}

template <class Real>
bool CpuCalcHelfrichForceKernel::makeStep(const HelfrichParameters& parameters, CpuHelfrichArrays<Real>& arrays,
                                          const KickAndDrift& times, double* nextPositions, CpuMembraneSums& sums,
                                          HelfrichEnergyTerms& terms) {
    if constexpr (is_same<Real, float>::value)
        if (!roundPositions(arrays))
            return false;
    if (times.terms == Term::Tether) {
        // Its forces need no sums of this step, and the next one at which all terms act finds what is not finite.

        moveAll(parameters, sums, arrays, times, nextPositions);
        return true;
    }
    computeEnergy(parameters, arrays, sums);
    if (!isfinite(sums.area))
        return false;
    updateRepulsion(parameters, arrays.positions);
    findSlopes(parameters, sums);
    moveAll(parameters, sums, arrays, times, nextPositions);
    terms = getTerms(parameters, sums);
    return isfinite(terms.getTotal());
}

template <class Real>
bool CpuCalcHelfrichForceKernel::makeSteps(ContextImpl& context, const HelfrichParameters& parameters,
                                           const KickAndDriftSequence& sequence, HelfrichEnergyTerms& terms) {
    // Positions and velocities stay in slots for the whole trajectory, and a vertex moves as soon as its gradient is
    // known.

    setLayoutWidth(loops->in<Real>().width);
    chooseNumThreads(context);
    auto arrays = prepareArrays<Real>(parameters);
    nextPositions.resize(positions.size());
    velocities.resize(positions.size());
    if (coarse != NULL) {
        forces.resize(positions.size());
        coarse->getMeshes(0).setPlaces(layout.slots, layout.getNumSlots());
    }
    double* next = nextPositions.data();
    CpuMembraneSums sums(mesh->getNumSurfaces());
    Interruption interruption(mesh->getNumVertices());
    bool isInterrupted = false;
    forEachChunk([&](int chunk) { loadState(context, chunk); });
    isGeometryKnown = false;
    bool isFinite = true;
    for (long long step = 0; step < sequence.size() && isFinite && !isInterrupted; step++) {
        if (step > 0) {
            isInterrupted = interruption.isRequested();
            swap(arrays.positions, next);
        }
        KickAndDrift times = sequence[step];
        HelfrichParameters p = times.getParameters(parameters);
        if constexpr (is_same<Real, double>::value)
            if (step + 1 == sequence.size() && canKeepGeometry(p))
                keepGeometry(arrays);
        isFinite = makeStep(p, arrays, times, next, sums, terms);
    }
    forEachChunk([&](int chunk) { storeState(context, arrays.positions, chunk); });
    if (arrays.positions != positions.data())
        swap(positions, nextPositions);
    if (isInterrupted)
        throw StepInterrupted();
    return isFinite;
}

bool CpuCalcHelfrichForceKernel::makeTrajectory(ContextImpl& context, const HelfrichParameters& parameters,
                                                const KickAndDriftSequence& sequence, bool mixed,
                                                IntegrateHamiltonianTrajectoryKernel* waves,
                                                HelfrichEnergyTerms& terms) {
    coarse = NULL;
    if (waves != NULL)
        coarse = &dynamic_cast<CpuIntegrateHamiltonianTrajectoryKernel&>(*waves).getCoarseMotion();
    bool isFinite = mixed ? makeSteps<float>(context, parameters, sequence, terms)
                          : makeSteps<double>(context, parameters, sequence, terms);
    bool areTermsExact = (!mixed && sequence.back().terms == TermMask::ALL && sequence.back().tetherShare == 1);
    return isFinite && (areTermsExact || execute(context, parameters, false, terms));
}

void CpuCalcHelfrichForceKernel::findGeometry(ContextImpl& context, const HelfrichParameters& parameters) {
    // The loop is that of the energy where both can be the same: what compilers make of another one might differ in the
    // last bits, and so a restarted simulation, which computes the geometry here, from one that has it from before. But
    // no tether is taut.

    HelfrichParameters p;
    p.box = parameters.box;
    p.moduli[Term::Bending] = 1;
    if (parameters.needsCurvature() && !parameters.hasForcesOfSpecies())
        p.moduli[Term::Tether] = parameters.has(Term::Tether);
    p.tetherMaxLength = INFINITY;
    chooseNumThreads(context);
    auto arrays = prepareArrays<double>(p);
    loadPositions(context);
    if (isGeometryKnown && hadTether == p.has(Term::Tether))
        return;
    keepGeometry(arrays);
    CpuMembraneSums sums(mesh->getNumSurfaces());
    computeEnergy(p, arrays, sums);
}

const CpuVertexGeometry& CpuCalcHelfrichForceKernel::getGeometry(ContextImpl& context,
                                                                 const HelfrichParameters& parameters) {
    isGeometryWanted = true;
    findGeometry(context, parameters);
    return geometry;
}

void CpuCalcHelfrichForceKernel::computeGeometry(ContextImpl& context, const PeriodicBox& box,
                                                 HelfrichGeometry& result) {
    HelfrichParameters parameters;
    parameters.box = box;
    findGeometry(context, parameters);
    result.setTotals(geometry.totals);
    result.vertexAreas.resize(mesh->getNumVertices());
    result.vertexMeanCurvatures.resize(mesh->getNumVertices());
    CpuThreads::forEachPart(numThreads, mesh->getNumVertices(), ITEMS_PER_PART, [&](int begin, int end) {
        for (int vertex = begin; vertex < end; vertex++) {
            result.vertexAreas[vertex] = geometry.getArea(vertex);
            result.vertexMeanCurvatures[vertex] = geometry.getCurvature(vertex);
        }
    });
}

CpuHelfrichNeighborList& CpuCalcHelfrichForceKernel::getNeighborList(ContextImpl& context,
                                                                     const HelfrichParameters& parameters) {
    chooseNumThreads(context);
    updateLayout();
    setBox(parameters.box);
    loadPositions(context);
    forEachChunk([&](int chunk) {
        chunkSums[chunk].outdated = repulsion.hasMoved(positions.data(), getFirstSlot(chunk), getLastSlot(chunk));
    });
    return repulsion.getNeighborList(*mesh, layout, positions.data(), parameters.repulsionOnset,
                                     addUp(chunkSums, &CpuHelfrichSums::outdated) != 0);
}

void CpuSweepEdgeFlipsKernel::initialize(const System& system, const HelfrichForce& force, HelfrichMesh& mesh,
                                         CalcHelfrichForceKernel& calculation) {
    this->mesh = &mesh;
    this->calculation = &dynamic_cast<CpuCalcHelfrichForceKernel&>(calculation);
}

bool CpuSweepEdgeFlipsKernel::execute(ContextImpl& context, const HelfrichParameters& parameters, double kT,
                                      long long numAttempts, const Philox& random, long long sweep,
                                      EdgeFlipStatistics& statistics) {
    const CpuVertexGeometry& geometry = calculation->getGeometry(context, parameters);
    if (!geometry.isFinite(parameters.needsCurvature()))
        return false;
    if (!edgeFlips)
        edgeFlips.reset(new CpuEdgeFlipSweep(*mesh, getData(context).threads.getNumThreads()));
    CpuHelfrichNeighborList* neighbors = NULL;
    if (CpuEdgeFlipSweep::needsNeighborList(parameters))
        neighbors = &calculation->getNeighborList(context, parameters);
    edgeFlips->setPositions(*getData(context).positions, geometry, neighbors);
    statistics = edgeFlips->execute(parameters, kT, numAttempts, random, sweep);
    return true;
}

void CpuExchangeSpeciesKernel::initialize(const System& system, const HelfrichForce& force, HelfrichMesh& mesh,
                                          CalcHelfrichForceKernel& calculation) {
    this->mesh = &mesh;
    this->calculation = &dynamic_cast<CpuCalcHelfrichForceKernel&>(calculation);
}

bool CpuExchangeSpeciesKernel::execute(ContextImpl& context, const HelfrichParameters& parameters,
                                       const SpeciesProposal& proposal, double kT, long long numAttempts,
                                       const Philox& random, long long sweep, SpeciesExchangeStatistics& statistics) {
    if (!exchange)
        exchange.reset(new CpuSpeciesExchange(*mesh, getData(context).threads.getNumThreads()));
    const CpuVertexGeometry* geometry = NULL;
    if (parameters.hasForcesOfSpecies()) {
        geometry = &calculation->getGeometry(context, parameters);
        if (!geometry->isFinite(parameters.needsCurvature()))
            return false;
    }
    exchange->prepare(*getData(context).positions, geometry, parameters, proposal);
    statistics = exchange->execute(kT, numAttempts, random, sweep);
    return true;
}

/**
 * Call a function with the first and last particle of each part, on all threads of a Context.
 */
template <class Function>
static void forEachPart(ContextImpl& context, int numParticles, const Function& function) {
    CpuThreads::forEachPart(::chooseNumThreads(context, numParticles), numParticles, ITEMS_PER_PART, function);
}

void CpuIntegrateHamiltonianTrajectoryKernel::initialize(const System& system) {
    for (int i = 0; i < system.getNumParticles(); i++) {
        double mass = system.getParticleMass(i);
        masses.push_back(mass);
        inverseMasses.push_back(mass == 0 ? 0 : 1 / mass);
    }
    partEnergies.resize((inverseMasses.size() + ITEMS_PER_PART - 1) / ITEMS_PER_PART);
}

void CpuIntegrateHamiltonianTrajectoryKernel::setMultilevelWeight(double weight,
                                                                  const vector<const HelfrichMesh*>& meshes) {
    coarse.setWeight(weight, meshes, masses);
}

vector<vector<CoarseVelocity>> CpuIntegrateHamiltonianTrajectoryKernel::getCoarseVelocities() const {
    return coarse.store();
}

void CpuIntegrateHamiltonianTrajectoryKernel::setCoarseVelocities(const vector<vector<CoarseVelocity>>& velocities) {
    coarse.load(velocities);
}

double CpuIntegrateHamiltonianTrajectoryKernel::begin(ContextImpl& context, double kT, double refreshment,
                                                      const Philox& random, long long trajectory) {
    this->kT = kT;
    start.keep(*getData(context).positions, *getData(context).velocities, refreshment, random, trajectory);
    setVelocities(context, 1);
    coarse.begin(kT, refreshment, random, trajectory);
    return computeKineticEnergy(context) + coarse.getKineticEnergy();
}

void CpuIntegrateHamiltonianTrajectoryKernel::setVelocities(ContextImpl& context, double factor) const {
    vector<Vec3>& velocities = *getData(context).velocities;
    forEachPart(context, inverseMasses.size(), [&](int first, int last) {
        for (int i = first; i < last; i++) {
            double deviation = sqrt(kT * inverseMasses[i]);
            velocities[i] = (deviation == 0 ? start.getVelocities()[i] : start.drawVelocity(i, deviation)) * factor;
        }
    });
}

void CpuIntegrateHamiltonianTrajectoryKernel::move(ContextImpl& context, const KickAndDrift& times) {
    vector<Vec3>& positions = *getData(context).positions;
    vector<Vec3>& velocities = *getData(context).velocities;
    vector<Vec3>& forces = *getData(context).forces;
    for (int i = 0; i < coarse.size(); i++)
        findMotion(context, times, i);
    forEachPart(context, inverseMasses.size(), [&](int first, int last) {
        for (int i = first; i < last; i++) {
            if (inverseMasses[i] != 0) {
                velocities[i] += forces[i] * (times.kick * inverseMasses[i]);
                positions[i] += (coarse.size() == 0 ? velocities[i] : velocities[i] + motions[i]) * times.drift;
            }
            forces[i] = Vec3();
        }
    });
}

void CpuIntegrateHamiltonianTrajectoryKernel::findMotion(ContextImpl& context, const KickAndDrift& times,
                                                         int membrane) {
    CpuCoarseMeshes& meshes = coarse.getMeshes(membrane);
    const vector<int>& particles = meshes.getMembrane().getParticles();
    const vector<Vec3>& forces = *getData(context).forces;
    int numVertices = particles.size(), numThreads = ::chooseNumThreads(context, numVertices);
    CoarseVelocities& velocities = coarse.getVelocities(membrane);
    motions.resize(masses.size());
    vectors.resize(4 * numVertices);
    places.resize(numVertices);
    iota(places.begin(), places.end(), 0);
    meshes.setPlaces(places, numVertices);
    forEachPart(context, numVertices, [&](int first, int last) {
        for (int i = first; i < last; i++)
            for (int j = 0; j < 4; j++)
                vectors[4 * i + j] = (j < 3 ? forces[particles[i]][j] : 0);
    });
    meshes.kick(vectors.data(), times.kick, coarse.getWeight(), velocities, numThreads);
    meshes.findMotion<double>(coarse.getWeight(), velocities, numThreads);
    forEachPart(context, numVertices, [&](int first, int last) {
        meshes.getMotion(first, last, &vectors[4 * first]);
        for (int i = first; i < last; i++)
            motions[particles[i]] = Vec3(vectors[4 * i], vectors[4 * i + 1], vectors[4 * i + 2]);
    });
}

double CpuIntegrateHamiltonianTrajectoryKernel::computeKineticEnergy(ContextImpl& context) {
    const vector<Vec3>& velocities = *getData(context).velocities;
    forEachPart(context, inverseMasses.size(), [&](int first, int last) {
        double energy = 0;
        for (int i = first; i < last; i++)
            if (inverseMasses[i] != 0)
                energy += 0.5 * velocities[i].dot(velocities[i]) / inverseMasses[i];
        partEnergies[first / ITEMS_PER_PART] = energy;
    });
    return addUp(partEnergies);
}

double CpuIntegrateHamiltonianTrajectoryKernel::computeCoarseKineticEnergy() const {
    return coarse.getKineticEnergy();
}

void CpuIntegrateHamiltonianTrajectoryKernel::reject(ContextImpl& context) {
    *getData(context).positions = start.getPositions();
    setVelocities(context, -1);
    coarse.reject();
}

void CpuIntegrateHamiltonianTrajectoryKernel::restore(ContextImpl& context) {
    *getData(context).positions = start.getPositions();
    *getData(context).velocities = start.getVelocities();
    coarse.restore();
}
