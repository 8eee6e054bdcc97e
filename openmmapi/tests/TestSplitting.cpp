#include "openmmhelfrich/internal/Splitting.h"
#include "Membranes.h"
#include "openmm/internal/AssertionUtilities.h"
#include <iostream>

using namespace HelfrichPlugin;
using namespace OpenMM;
using namespace std;

/**
 * The time for which a term acts in a kick, by the parameters with which its forces are computed.
 */
static double getTime(const KickAndDrift& kick, Term term) {
    const HelfrichParameters all = createParameters(createBlob(0), EveryTerm);
    return kick.kick * kick.getParameters(all).moduli[term] / all.moduli[term];
}

void testTimesAddUp() {
    // Every term acts for as long as the vertices move, in whichever substeps it does, and at the same times forwards
    // and backwards.

    const double stepSize = 0.3;
    for (string name : {"leapfrog", "bcss2", "bcss3"})
        for (int numSteps : {1, 4})
            for (int tetherSubsteps : {1, 2, 5}) {
                auto sequence = Splitting::byName(name).getSequence(stepSize, numSteps, tetherSubsteps);
                double driftTime = 0;
                for (long long n = 0; n < sequence.size(); n++)
                    driftTime += sequence[n].drift;
                ASSERT_EQUAL_TOL(numSteps * stepSize, driftTime, 1e-14);
                ASSERT_EQUAL(0.0, sequence.back().drift);
                for (int i = 0; i < NUM_TERMS; i++) {
                    double kickTime = 0;
                    for (long long n = 0; n < sequence.size(); n++)
                        kickTime += getTime(sequence[n], Term(i));
                    ASSERT_EQUAL_TOL(numSteps * stepSize, kickTime, 1e-14);
                    for (long long n = 0; n < sequence.size(); n++)
                        ASSERT_EQUAL_TOL(getTime(sequence[n], Term(i)),
                                         getTime(sequence[sequence.size() - 1 - n], Term(i)), 1e-14);
                }
            }
}

void testSubstepsOfTheTether() {
    // In the substeps between, no other term acts.

    auto sequence = Splitting::byName("leapfrog").getSequence(0.3, 2, 3);
    ASSERT_EQUAL(7, (int) sequence.size());
    for (long long n = 0; n < sequence.size(); n++) {
        ASSERT(sequence[n].terms == (n % 3 == 0 ? TermMask::ALL : TermMask(Term::Tether)));
        ASSERT(getTime(sequence[n], Term::Tether) > 0);
    }
}

int main() {
    try {
        testTimesAddUp();
        testSubstepsOfTheTether();
    }
    catch (const exception& e) {
        cout << "exception: " << e.what() << endl;
        return 1;
    }
    cout << "Done" << endl;
    return 0;
}
