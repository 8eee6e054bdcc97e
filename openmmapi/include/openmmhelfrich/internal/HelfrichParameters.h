#ifndef OPENMM_HELFRICHPARAMETERS_H_
#define OPENMM_HELFRICHPARAMETERS_H_

#include "openmmhelfrich/HelfrichForce.h"
#include "openmmhelfrich/internal/HelfrichStencils.h"

namespace HelfrichPlugin {

/**
 * What an evaluation of the energy needs to know besides positions and connectivity: the moduli of a HelfrichForce and
 * the targets of a Context, in OpenMM's units.
 */
struct HelfrichParameters {
    double bendingModulus = 0;
    double areaModulus = 0, targetArea = 0;
    double volumeModulus = 0, targetVolume = 0;
    double areaDifferenceModulus = 0, targetAreaDifference = 0, leafletSeparation = 0;
    double tetherModulus = 0, tetherMinLength = 0, tetherMaxLength = 0, tetherLengthScale = 1;
    int tetherExponent = 0;
    double repulsionModulus = 0, repulsionOnset = 0;
    int repulsionExponent = 0, repulsionExclusionLevel = 0;
    bool needsCurvature() const {
        return bendingModulus != 0 || areaDifferenceModulus != 0;
    }
    bool needsTriangles() const {
        return areaModulus != 0 || volumeModulus != 0 || needsCurvature();
    }
};

/**
 * The sums over the whole surface on which the energy depends.
 */
struct HelfrichTotals {
    double area = 0, volume = 0, curvature = 0;
    HelfrichTotals& operator+=(const HelfrichTotals& other) {
        area += other.area;
        volume += other.volume;
        curvature += other.curvature;
        return *this;
    }
};

/**
 * The energy kappa (x/x0-1)^2 that holds a total x to its target.
 */
inline double penalty(double modulus, double x, double target) {
    if (modulus == 0)
        return 0;
    double deviation = x/target-1;
    return modulus*deviation*deviation;
}

/**
 * The derivative of penalty() by x.
 */
inline double penaltySlope(double modulus, double x, double target) {
    return modulus == 0 ? 0 : 2*modulus*(x/target-1)/target;
}

/**
 * The terms of the energy that depend on totals alone.
 */
inline void addPenalties(const HelfrichParameters& p, const HelfrichTotals& totals, HelfrichEnergyTerms& terms) {
    terms.area += penalty(p.areaModulus, totals.area, p.targetArea);
    terms.volume += penalty(p.volumeModulus, totals.volume, p.targetVolume);
    terms.areaDifference += penalty(p.areaDifferenceModulus, 2*p.leafletSeparation*totals.curvature, p.targetAreaDifference);
}

/**
 * The derivatives of the same terms by the three totals.
 */
inline HelfrichTotals penaltySlopes(const HelfrichParameters& p, const HelfrichTotals& totals) {
    HelfrichTotals slopes;
    slopes.area = penaltySlope(p.areaModulus, totals.area, p.targetArea);
    slopes.volume = penaltySlope(p.volumeModulus, totals.volume, p.targetVolume);
    double h = p.leafletSeparation;
    slopes.curvature = 2*h*penaltySlope(p.areaDifferenceModulus, 2*h*totals.curvature, p.targetAreaDifference);
    return slopes;
}

/**
 * The tether's potential of an edge of length l, which its modulus multiplies.
 *
 * @param[out] slope  its derivative by l
 */
template <class Real>
inline Real tetherPotential(const HelfrichParameters& p, Real l, Real& slope) {
    Real scale = p.tetherLengthScale;
    Real potential = tetherPotential<Real>(l/scale, p.tetherMinLength/scale, p.tetherMaxLength/scale, p.tetherExponent, slope);
    slope = slope/scale;
    return potential;
}

} // namespace HelfrichPlugin

#endif /*OPENMM_HELFRICHPARAMETERS_H_*/
