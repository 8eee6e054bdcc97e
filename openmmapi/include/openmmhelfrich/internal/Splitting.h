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
     * @param name  "leapfrog"; or "bcss2" or "bcss3", of two or three stages, whose coefficients minimise the largest
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
    std::vector<KickAndDrift> getSequence(double stepSize, int numSteps, int tetherSubsteps = 1) const {
        std::vector<KickAndDrift> sequence = getPlainSequence(stepSize, numSteps);
        return tetherSubsteps == 1 ? sequence : divideDrifts(sequence, tetherSubsteps);
    }
private:
    std::vector<KickAndDrift> getPlainSequence(double stepSize, int numSteps) const {
        std::vector<KickAndDrift> sequence = {{kicks[0] * stepSize, 0}};
        for (int step = 0; step < numSteps; step++)
            for (int stage = 0; stage < getNumStages(); stage++) {
                bool isLastStage = (stage + 1 == getNumStages()), isLast = (isLastStage && step + 1 == numSteps);
                sequence.back().drift = drifts[stage] * stepSize;
                sequence.push_back({(kicks[stage + 1] + (isLastStage && !isLast ? kicks[0] : 0)) * stepSize, 0});
            }
        return sequence;
    }
    static std::vector<KickAndDrift> divideDrifts(const std::vector<KickAndDrift>& sequence, int tetherSubsteps) {
        std::vector<KickAndDrift> result;
        double before = 0;
        for (auto& outer : sequence) {
            double step = outer.drift / tetherSubsteps;
            result.push_back({outer.kick, step, TermMask::ALL, 0.5 * (before + step) / outer.kick});
            for (int i = 1; i < tetherSubsteps && step != 0; i++)
                result.push_back({step, step, Term::Tether});
            before = step;
        }
        return result;
    }
};

} // namespace HelfrichPlugin

#endif /*OPENMM_HELFRICH_SPLITTING_H_*/
