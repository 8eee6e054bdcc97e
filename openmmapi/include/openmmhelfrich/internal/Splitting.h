#ifndef OPENMM_HELFRICH_SPLITTING_H_
#define OPENMM_HELFRICH_SPLITTING_H_

#include "HelfrichParameters.h"
#include "openmm/OpenMMException.h"
#include <string>
#include <vector>

/* Splittings of Hamiltonian dynamics into kicks, which change velocities, and drifts, which change positions. */

namespace HelfrichPlugin {

/**
 * A kick by the forces at the present positions, and the drift that follows it.
 */
struct KickAndDrift {
    /// the time for which the forces act, and that for which the particles move, measured in ps
    double kick, drift;
    /// the terms that act
    TermMask terms = TermMask::ALL;
    /// the time for which the tether acts, as a fraction of the kick
    double tetherShare = 1;
    /**
     * Get the parameters of the terms that act.
     */
    HelfrichParameters getParameters(const HelfrichParameters& all) const {
        HelfrichParameters p = all.only(terms);
        p.moduli[Term::Tether] *= tetherShare;
        return p;
    }
};

class KickAndDriftSequence;

/**
 * A palindromic splitting: kicks and drifts take turns, and read the same in both directions, so that it is reversible.
 * Since each of them shears phase space, it preserves volume.
 */
struct Splitting {
    /// as fractions of a step, which has as many drifts as stages and begins and ends with a kick
    std::vector<double> kicks, drifts;
    /**
     * Get a splitting by its name.  All are of order 2.
     *
     * @param name  "leapfrog"; or "bcss2" or "bcss3", of two or three stages, whose coefficients minimize the largest
     * expected energy error of harmonic oscillators up to the step where the leapfrog steps of the same cost become
     * unstable (Blanes, Casas and Sanz-Serna, SIAM J. Sci. Comput. 36, A1556, 2014, section 4; for two stages it is
     * near that of Predescu et al., Mol. Phys. 110, 967, 2012)
     */
    static Splitting byName(const std::string& name) {
        if (name == "leapfrog")
            return {{0.5, 0.5}, {1}};
        if (name == "bcss2") {
            const double b = 0.2117809813657482;
            return {{b, 1 - 2 * b, b}, {0.5, 0.5}};
        }
        if (name == "bcss3") {
            const double b = 0.11888010966548, a = 0.29619504261126;
            return {{b, 0.5 - b, 0.5 - b, b}, {a, 1 - 2 * a, a}};
        }
        throw OpenMM::OpenMMException("the splitting is '" + name + "'; it must be 'leapfrog', 'bcss2' or 'bcss3'");
    }
    int getNumStages() const {
        return drifts.size();
    }
    /**
     * Get the kicks and drifts of a number of steps.  The last drift is 0.
     *
     * @param tetherSubsteps  if this is more than 1, the motion under the tether alone takes the place of each drift,
     * in so many steps of leapfrog (r-RESPA; Tuckerman, Berne and Martyna, J. Chem. Phys. 97, 1990, 1992)
     */
    KickAndDriftSequence getSequence(double stepSize, int numSteps, int tetherSubsteps = 1) const;
};

/**
 * The kicks and drifts of a number of steps.  Each is computed when it is asked for: a trajectory of 10^9 steps takes
 * no more memory than one of 10.
 */
class KickAndDriftSequence {
public:
    KickAndDriftSequence(const Splitting& splitting, double stepSize, int numSteps, int tetherSubsteps)
            : splitting(splitting), stepSize(stepSize), numDrifts((long long) numSteps * splitting.getNumStages()),
              tetherSubsteps(tetherSubsteps) {
    }
    long long size() const {
        return numDrifts * tetherSubsteps + 1;
    }
    KickAndDrift operator[](long long i) const {
        long long n = i / tetherSubsteps;
        if (tetherSubsteps == 1)
            return {getKick(n), getDrift(n)};
        double step = getDrift(n) / tetherSubsteps;
        if (i % tetherSubsteps != 0)
            return {step, step, Term::Tether};
        double before = (n == 0 ? 0 : getDrift(n - 1) / tetherSubsteps), kick = getKick(n);
        return {kick, step, TermMask::ALL, 0.5 * (before + step) / kick};
    }
    KickAndDrift back() const {
        return (*this)[size() - 1];
    }
private:
    double getKick(long long n) const {
        // The last kick of a step and the first of the next one are made together.

        int numStages = splitting.getNumStages(), stage = n % numStages;
        if (n == 0 || stage != 0)
            return splitting.kicks[stage] * stepSize;
        return (splitting.kicks[numStages] + (n == numDrifts ? 0 : splitting.kicks[0])) * stepSize;
    }
    double getDrift(long long n) const {
        return n == numDrifts ? 0 : splitting.drifts[n % splitting.getNumStages()] * stepSize;
    }
    const Splitting splitting;
    const double stepSize;
    const long long numDrifts;
    const int tetherSubsteps;
};

inline KickAndDriftSequence Splitting::getSequence(double stepSize, int numSteps, int tetherSubsteps) const {
    return KickAndDriftSequence(*this, stepSize, numSteps, tetherSubsteps);
}

} // namespace HelfrichPlugin

#endif /*OPENMM_HELFRICH_SPLITTING_H_*/
