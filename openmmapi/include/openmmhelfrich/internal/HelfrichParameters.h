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
 * Get whether the totals of a geometry are finite, that of the curvature if it is needed.
 */
inline bool isFinite(const HelfrichGeometry& geometry, bool needsCurvature) {
    return std::isfinite(geometry.area) && std::isfinite(geometry.volume) &&
           (!needsCurvature || std::isfinite(geometry.integratedMeanCurvature));
}

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
 * The terms of the energy that depend on totals alone.
 */
template <class Real>
inline void addPenalties(const HelfrichParameters& p, const HelfrichTotalsOf<Real>& totals,
                         HelfrichEnergyTerms& terms) {
    terms.area += penalty(p.areaModulus, totals.area, p.targetArea);
    terms.volume += penalty(p.volumeModulus, totals.volume, p.targetVolume);
    terms.areaDifference +=
            penalty(p.areaDifferenceModulus, 2 * p.leafletSeparation * totals.curvature, p.targetAreaDifference);
}

/**
 * The derivatives of the same terms by the three totals.
 */
template <class Real>
inline HelfrichTotalsOf<Real> penaltySlopes(const HelfrichParameters& p, const HelfrichTotalsOf<Real>& totals) {
    HelfrichTotalsOf<Real> slopes;
    slopes.area = penaltySlope(p.areaModulus, totals.area, p.targetArea);
    slopes.volume = penaltySlope(p.volumeModulus, totals.volume, p.targetVolume);
    double h = p.leafletSeparation;
    slopes.curvature = 2 * h * penaltySlope(p.areaDifferenceModulus, 2 * h * totals.curvature, p.targetAreaDifference);
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
    Real potential = tetherPotential<Real>(l / scale, p.tetherMinLength / scale, p.tetherMaxLength / scale,
                                           p.tetherExponent, slope);
    slope = slope / scale;
    return potential;
}

} // namespace HelfrichPlugin

#endif /*OPENMM_HELFRICHPARAMETERS_H_*/
