#ifndef OPENMM_HELFRICHPARAMETERS_H_
#define OPENMM_HELFRICHPARAMETERS_H_

#include "HelfrichSpecies.h"
#include <algorithm>
#include <cmath>
#include <iterator>
#include <map>
#include <memory>
#include <utility>

/* The home of the terms of the energy: their names, their parameters and what sets these in a Context.  A term that
   depends on the totals of a surface alone is defined here as a whole, for every platform and for edge flips. */

namespace HelfrichPlugin {

/**
 * The terms of the energy, in the order in which they are added up.
 */
enum class Term {
    Bending,
    Area,
    Volume,
    AreaDifference,
    Tether,
    Repulsion,
    Tension,
    Pressure,
    Gaussian,
    Line,
    Pair,
    Count
};

inline constexpr int NUM_TERMS = int(Term::Count);

/**
 * The names of the terms.
 */
inline constexpr const char* TERM_NAMES[] = {"bending", "area",     "volume",   "areaDifference", "tether", "repulsion",
                                             "tension", "pressure", "gaussian", "line",           "pair"};

static_assert(std::size(TERM_NAMES) == NUM_TERMS, "every term has a name");

/**
 * A number for each term.
 */
class TermValues {
public:
    constexpr double& operator[](Term term) {
        return values[int(term)];
    }
    constexpr double operator[](Term term) const {
        return values[int(term)];
    }
private:
    double values[NUM_TERMS] = {};
};

/**
 * The energy of a HelfrichForce, term by term, each measured in kJ/mol.
 */
struct HelfrichEnergyTerms : TermValues {
    /**
     * Get the sum of all terms, in kJ/mol: the energy that the force contributes to the potential energy.
     */
    double getTotal() const {
        double total = 0;
        for (int i = 0; i < NUM_TERMS; i++)
            total += (*this)[Term(i)];
        return total;
    }
};

/**
 * A set of terms.
 */
class TermMask {
public:
    /// all terms
    static const TermMask ALL;
    /// no term
    constexpr TermMask() = default;
    constexpr TermMask(Term term) : bits(1u << int(term)) {
    }
    constexpr bool contains(Term term) const {
        return (bits >> int(term) & 1) != 0;
    }
    constexpr TermMask operator|(TermMask other) const {
        return TermMask(bits | other.bits);
    }
    constexpr TermMask operator~() const {
        return TermMask(~bits & ((1u << NUM_TERMS) - 1));
    }
    constexpr bool operator==(TermMask other) const {
        return bits == other.bits;
    }
    constexpr bool operator!=(TermMask other) const {
        return bits != other.bits;
    }
private:
    constexpr explicit TermMask(unsigned int bits) : bits(bits) {
    }
    unsigned int bits = 0;
};

inline constexpr TermMask TermMask::ALL = ~TermMask();

/**
 * A rectangular periodic box, or none.
 */
struct PeriodicBox {
    /// the lengths of its sides in nm and their inverses, 0 where there is no box
    double lengths[3] = {}, inverses[3] = {};
    PeriodicBox() = default;
    PeriodicBox(double x, double y, double z) : lengths{x, y, z}, inverses{1 / x, 1 / y, 1 / z} {
    }
    bool exists() const {
        return lengths[0] != 0;
    }
    /// the length of the shortest side
    double shortest() const {
        return *std::min_element(lengths, lengths + 3);
    }
    bool operator==(const PeriodicBox& other) const {
        return std::equal(lengths, lengths + 3, other.lengths);
    }
    bool operator!=(const PeriodicBox& other) const {
        return !(*this == other);
    }
};

/**
 * What an evaluation of the energy needs to know besides positions and connectivity, in OpenMM's units: the moduli and
 * the other parameters of a HelfrichForce, whose defaults are these.  In a Context, the values of its own parameters
 * take the place of some: see HelfrichContextParameter.
 */
struct HelfrichParameters {
    /// a term whose modulus is 0 is off; of what depends on the species, this is the greatest of their moduli
    TermValues moduli;
    /// of all vertices, beside that of their species
    double spontaneousCurvature = 0;
    /// NULL if all vertices are alike
    std::shared_ptr<const HelfrichSpeciesTable> species;
    double targetArea = 0, targetVolume = 0;
    double targetAreaDifference = 0, leafletSeparation = 1;
    /// the targets of surfaces that have one of their own, by the term and the number of the surface
    std::map<std::pair<Term, int>, double> surfaceTargets;
    double tetherMinLength = 0, tetherMaxLength = 0, tetherLengthScale = 1;
    int tetherExponent = 2;
    double repulsionOnset = 0, repulsionLengthScale = 1;
    int repulsionExponent = 2, repulsionExclusionLevel = 1;
    /// that of the Context, if the surface is periodic
    PeriodicBox box;
    /**
     * Get whether a term is on.
     */
    bool has(Term term) const {
        return moduli[term] != 0;
    }
    /**
     * Get the material around a vertex.  What belongs to a term that is off is 0.
     *
     * @param index  the vertex's species; any number if all vertices are alike
     */
    HelfrichSpecies getMaterial(int index) const {
        HelfrichSpecies material = {moduli[Term::Bending], 0, moduli[Term::Gaussian]};
        if (species) {
            material = (*species)[index];
            material.bendingModulus *= has(Term::Bending);
            material.gaussianModulus *= has(Term::Gaussian);
        }
        material.spontaneousCurvature = (has(Term::Bending) ? material.spontaneousCurvature + spontaneousCurvature : 0);
        return material;
    }
    /**
     * Get the line tension between two species, which is 0 if the term is off, or if they are the same.
     */
    double getLineTension(int species1, int species2) const {
        return has(Term::Line) ? species->lineTensions.get(species1, species2) : 0;
    }
    /**
     * Get the energy of an edge between vertices of two species.
     */
    double getPairEnergy(int species1, int species2) const {
        return has(Term::Pair) ? species->pairEnergies.get(species1, species2) : 0;
    }
    /**
     * Get whether the Gaussian curvature acts on the vertices.  Where its modulus is the same everywhere, its energy is
     * a constant of the topology.
     */
    bool hasGaussianForces() const {
        return has(Term::Gaussian) && species && species->hasDifferentGaussianModuli();
    }
    /**
     * Get whether a term acts on the vertices whose moduli depend on the species.
     */
    bool hasForcesOfSpecies() const {
        return species && (has(Term::Bending) || has(Term::Line) || hasGaussianForces());
    }
    /**
     * Get what the area, the volume or the area difference of a surface is held to.
     *
     * @param term     the term that holds it there
     * @param surface  the number of the surface
     */
    double getTarget(Term term, int surface) const {
        auto own = surfaceTargets.find({term, surface});
        if (own != surfaceTargets.end())
            return own->second;
        return term == Term::Area ? targetArea : term == Term::Volume ? targetVolume : targetAreaDifference;
    }
    /**
     * Get the terms that are on.
     */
    TermMask getTerms() const {
        TermMask terms;
        for (int i = 0; i < NUM_TERMS; i++)
            if (has(Term(i)))
                terms = terms | Term(i);
        return terms;
    }
    /**
     * Get the same parameters with all but the given terms off.
     */
    HelfrichParameters only(TermMask terms) const {
        HelfrichParameters p = *this;
        for (int i = 0; i < NUM_TERMS; i++)
            if (!terms.contains(Term(i)))
                p.moduli[Term(i)] = 0;
        return p;
    }
    /**
     * Get whether a term depends on the curvatures of the vertices, which are made of dihedral angles.
     */
    bool needsCurvature() const {
        return has(Term::Bending) || has(Term::AreaDifference);
    }
    /**
     * Get whether a term depends on the triangles, whatever their species.
     */
    bool needsTriangles() const {
        return has(Term::Area) || has(Term::Volume) || has(Term::Tension) || has(Term::Pressure) || needsCurvature();
    }
    /**
     * Get whether a term has a meaning only where the surface encloses a positive volume.
     */
    bool needsOrientation() const {
        return has(Term::Volume) || has(Term::Pressure) || hasSpontaneousCurvature();
    }
    /**
     * Get whether vertices have a spontaneous curvature.
     */
    bool hasSpontaneousCurvature() const {
        return has(Term::Bending) &&
               (spontaneousCurvature != 0 || (species && species->getGreatest().spontaneousCurvature != 0));
    }
};

/**
 * A parameter of the Context, which sets one of HelfrichParameters.  It must be finite if its term is on, a target may
 * not be zero, and that of an area or a volume must be positive; a modulus of zero turns its term off.  A surface's own
 * target is another parameter, whose name has the surface's number at its end.
 */
struct HelfrichContextParameter {
    Term term;
    /// its name, which follows that of the force; and after "set" the name of the setter of its default value
    const char* name;
    /// what it sets
    double& (*valueIn)(HelfrichParameters& parameters);
    enum { Positive, NotZero, Any } allowed;
    /**
     * Get whether a value is one that the parameter may have while its term is on.
     */
    bool allows(double value) const {
        return std::isfinite(value) && (allowed == Any || (allowed == NotZero ? value != 0 : value > 0));
    }
};

/**
 * All of them, at most one for each term.
 */
inline constexpr HelfrichContextParameter HELFRICH_CONTEXT_PARAMETERS[] = {
        {Term::Area, "TargetArea", [](HelfrichParameters& p) -> double& { return p.targetArea; },
         HelfrichContextParameter::Positive},
        {Term::Volume, "TargetVolume", [](HelfrichParameters& p) -> double& { return p.targetVolume; },
         HelfrichContextParameter::Positive},
        {Term::AreaDifference, "TargetAreaDifference",
         [](HelfrichParameters& p) -> double& { return p.targetAreaDifference; }, HelfrichContextParameter::NotZero},
        {Term::Tension, "Tension", [](HelfrichParameters& p) -> double& { return p.moduli[Term::Tension]; },
         HelfrichContextParameter::Any},
        {Term::Pressure, "Pressure", [](HelfrichParameters& p) -> double& { return p.moduli[Term::Pressure]; },
         HelfrichContextParameter::Any},
        {Term::Bending, "SpontaneousCurvature", [](HelfrichParameters& p) -> double& { return p.spontaneousCurvature; },
         HelfrichContextParameter::Any}};

/**
 * Get the parameter of the Context of a term that has one.
 */
inline const HelfrichContextParameter& getContextParameter(Term term) {
    auto parameter = std::begin(HELFRICH_CONTEXT_PARAMETERS);
    while (parameter->term != term)
        ++parameter;
    return *parameter;
}

/**
 * The sums over a connected surface on which the energy depends.
 */
template <class Real>
struct HelfrichTotalsOf {
    Real area = 0, volume = 0, curvature = 0;
    HelfrichTotalsOf& operator+=(const HelfrichTotalsOf& other) {
        area += other.area;
        volume += other.volume;
        curvature += other.curvature;
        return *this;
    }
};

typedef HelfrichTotalsOf<double> HelfrichTotals;

/**
 * The energy kappa (x/x0-1)^2 that holds a total x to its target.
 */
template <class Real>
inline Real penalty(double modulus, Real x, double target) {
    if (modulus == 0)
        return 0;
    Real deviation = x / target - 1;
    return modulus * deviation * deviation;
}

/**
 * The derivative of penalty() by x.
 */
template <class Real>
inline Real penaltySlope(double modulus, Real x, double target) {
    return modulus == 0 ? Real(0) : 2 * modulus * (x / target - 1) / target;
}

/**
 * The change of penalty() with x.
 */
class PenaltyChange {
public:
    PenaltyChange() = default;
    PenaltyChange(double modulus, double x, double target)
            : modulus(modulus), inverseTarget(modulus == 0 ? 0 : 1 / target),
              deviation(modulus == 0 ? 0 : x / target - 1) {
    }
    double operator()(double difference) const {
        // (x+d)^2-x^2 = d (2x+d): the small change does not come from the difference of two large energies.

        double relative = difference * inverseTarget;
        return modulus * relative * (2 * deviation + relative);
    }
private:
    double modulus, inverseTarget, deviation;
};

/**
 * The energy kappa x that is linear in a total x.
 */
template <class Real>
inline Real linearEnergy(double modulus, Real x) {
    return modulus == 0 ? Real(0) : modulus * x;
}

/**
 * Compute the terms of the energy that depend on totals alone.
 *
 * @param surface  the number of the surface
 * @param totals   those of the surface
 * @param add      called for each with the term and its energy
 */
template <class Real, class Add>
inline void computeTermsOfTotals(const HelfrichParameters& p, int surface, const HelfrichTotalsOf<Real>& totals,
                                 Add add) {
    add(Term::Area, penalty(p.moduli[Term::Area], totals.area, p.getTarget(Term::Area, surface)));
    add(Term::Volume, penalty(p.moduli[Term::Volume], totals.volume, p.getTarget(Term::Volume, surface)));
    add(Term::AreaDifference, penalty(p.moduli[Term::AreaDifference], 2 * p.leafletSeparation * totals.curvature,
                                      p.getTarget(Term::AreaDifference, surface)));
    add(Term::Tension, linearEnergy(p.moduli[Term::Tension], totals.area));
    add(Term::Pressure, linearEnergy(-p.moduli[Term::Pressure], totals.volume));
}

/**
 * Add the same terms to others.
 */
template <class Real>
inline void addTermsOfTotals(const HelfrichParameters& p, int surface, const HelfrichTotalsOf<Real>& totals,
                             HelfrichEnergyTerms& terms) {
    computeTermsOfTotals(p, surface, totals, [&](Term term, Real energy) { terms[term] += energy; });
}

/**
 * Get the sum of the same terms.
 */
template <class Real>
inline Real energyOfTotals(const HelfrichParameters& p, int surface, const HelfrichTotalsOf<Real>& totals) {
    Real sum = 0;
    computeTermsOfTotals(p, surface, totals, [&](Term term, Real energy) { sum += energy; });
    return sum;
}

/**
 * Get the derivatives of the same terms by the three totals.
 */
template <class Real>
inline HelfrichTotalsOf<Real> getSlopesByTotals(const HelfrichParameters& p, int surface,
                                                const HelfrichTotalsOf<Real>& totals) {
    HelfrichTotalsOf<Real> slopes;
    slopes.area =
            penaltySlope(p.moduli[Term::Area], totals.area, p.getTarget(Term::Area, surface)) + p.moduli[Term::Tension];
    slopes.volume = penaltySlope(p.moduli[Term::Volume], totals.volume, p.getTarget(Term::Volume, surface)) -
                    p.moduli[Term::Pressure];
    double h = p.leafletSeparation;
    slopes.curvature = 2 * h *
                       penaltySlope(p.moduli[Term::AreaDifference], 2 * h * totals.curvature,
                                    p.getTarget(Term::AreaDifference, surface));
    return slopes;
}

/**
 * Get the derivatives by a surface's area and curvature of what a spontaneous curvature C adds to the bending energy
 * where it and the modulus are the same everywhere: 2 kappa sum_i (M_i-CA_i/2)^2/A_i is 2 kappa sum_i M_i^2/A_i, and
 * kappa C^2 A/2 - 2 kappa C M.  Loops over vertices have nothing to do with it then.
 */
inline HelfrichTotals getSpontaneousSlopes(const HelfrichParameters& p) {
    HelfrichTotals slopes;
    if (!p.species && p.hasSpontaneousCurvature()) {
        slopes.area = 0.5 * p.moduli[Term::Bending] * p.spontaneousCurvature * p.spontaneousCurvature;
        slopes.curvature = -2 * p.moduli[Term::Bending] * p.spontaneousCurvature;
    }
    return slopes;
}

/**
 * The change of the terms that depend on totals alone with those of a surface.
 */
class ChangeByTotals {
public:
    ChangeByTotals() = default;
    ChangeByTotals(const HelfrichParameters& p, int surface, const HelfrichTotals& totals)
            : area(p.moduli[Term::Area], totals.area, p.getTarget(Term::Area, surface)),
              volume(p.moduli[Term::Volume], totals.volume, p.getTarget(Term::Volume, surface)),
              areaDifference(p.moduli[Term::AreaDifference], totals.curvature,
                             p.getTarget(Term::AreaDifference, surface) / (2 * p.leafletSeparation)),
              tension(p.moduli[Term::Tension]), pressure(p.moduli[Term::Pressure]) {
    }
    /**
     * Add it to the change of the other terms.
     *
     * @param change       the change of the other terms
     * @param differences  how much the totals change
     * @return the sum
     */
    double addTo(double change, const HelfrichTotals& differences) const {
        return change + area(differences.area) + volume(differences.volume) + areaDifference(differences.curvature) +
               tension * differences.area - pressure * differences.volume;
    }
private:
    PenaltyChange area, volume, areaDifference;
    double tension, pressure;
};

} // namespace HelfrichPlugin

#endif /*OPENMM_HELFRICHPARAMETERS_H_*/
