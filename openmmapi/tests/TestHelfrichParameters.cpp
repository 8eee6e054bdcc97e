#include "openmmhelfrich/internal/HelfrichParameters.h"
#include "Membranes.h"
#include "openmm/internal/AssertionUtilities.h"
#include <iostream>
#include <set>
#include <string>

using namespace HelfrichPlugin;
using namespace OpenMM;
using namespace std;

void testMasks() {
    ASSERT(~TermMask::ALL == TermMask());
    for (int bits = 0; bits < 1 << NUM_TERMS; bits++) {
        TermMask terms = getTermsOfBits(bits), others = ~terms;
        ASSERT((terms | others) == TermMask::ALL);
        ASSERT(terms != others);
        for (int i = 0; i < NUM_TERMS; i++) {
            ASSERT_EQUAL((bits >> i & 1) != 0, terms.contains(Term(i)));
            ASSERT(others.contains(Term(i)) != terms.contains(Term(i)));
        }
    }
}

void testTermsThatAreOn() {
    // Nothing but the moduli of other terms changes, and what a term needs is what any of those needs that are on.

    const HelfrichParameters all = createParameters(createBlob(0), EveryTerm);
    ASSERT(all.getTerms() == TermMask::ALL);
    for (int bits = 0; bits < 1 << NUM_TERMS; bits++) {
        TermMask terms = getTermsOfBits(bits);
        HelfrichParameters p = all.only(terms);
        ASSERT(p.getTerms() == terms);
        bool needsCurvature = false, needsTriangles = false;
        for (int i = 0; i < NUM_TERMS; i++) {
            ASSERT_EQUAL(terms.contains(Term(i)) ? all.moduli[Term(i)] : 0.0, p.moduli[Term(i)]);
            needsCurvature = needsCurvature || (p.has(Term(i)) && all.only(Term(i)).needsCurvature());
            needsTriangles = needsTriangles || (p.has(Term(i)) && all.only(Term(i)).needsTriangles());
        }
        ASSERT_EQUAL(needsCurvature, p.needsCurvature());
        ASSERT_EQUAL(needsTriangles, p.needsTriangles());
        ASSERT_EQUAL(all.targetArea, p.targetArea);
        ASSERT_EQUAL(all.tetherMinLength, p.tetherMinLength);
        ASSERT_EQUAL(all.repulsionExclusionLevel, p.repulsionExclusionLevel);
    }
}

static double computeEnergy(const HelfrichParameters& p, const HelfrichTotals& totals) {
    HelfrichEnergyTerms terms;
    addTermsOfTotals(p, 0, totals, terms);
    return terms.getTotal();
}

void testTermsOfTotals() {
    // Slopes and changes are those of the energy, of each term alone and of all together.

    const HelfrichParameters all = createParameters(createBlob(0), EveryTerm);
    HelfrichTotals totals;
    totals.area = 7;
    totals.volume = 2.2;
    totals.curvature = 11;
    double HelfrichTotals::* const members[] = {&HelfrichTotals::area, &HelfrichTotals::volume,
                                                &HelfrichTotals::curvature};
    int numTerms = 0;
    for (int bits = 1; bits < 1 << NUM_TERMS; bits++) {
        HelfrichParameters p = all.only(getTermsOfBits(bits));
        double energy = computeEnergy(p, totals);
        numTerms += (energy != 0);
        HelfrichTotals slopes = getSlopesByTotals(p, 0, totals);
        ChangeByTotals change(p, 0, totals);
        for (auto member : members)
            for (double difference : {1e-3, -0.5}) {
                HelfrichTotals differences, before = totals, after = totals;
                differences.*member = difference;
                after += differences;
                before.*member -= difference;
                double expected = computeEnergy(p, after) - energy,
                       expectedSlope = (computeEnergy(p, after) - computeEnergy(p, before)) / (2 * difference);
                ASSERT_EQUAL_TOL(5 + expected, change.addTo(5, differences), 1e-12 * (1 + energy));
                ASSERT_EQUAL_TOL(expectedSlope, slopes.*member, 1e-9 * (1 + energy));
            }
    }
    ASSERT(numTerms > 0);
}

void testTargetsOfSurfaces() {
    // A surface with a target of its own has the energy, slopes and changes of that target, and the others those of
    // the common one.

    HelfrichParameters common = createParameters(createBlob(0), EveryTerm), own = common, other = common;
    own.targetArea = 6.5;
    own.targetVolume = 2.7;
    own.targetAreaDifference = -1.2;
    other.surfaceTargets = {{{Term::Area, 2}, own.targetArea},
                            {{Term::Volume, 2}, own.targetVolume},
                            {{Term::AreaDifference, 2}, own.targetAreaDifference}};
    HelfrichTotals totals = {7, 2.2, 11}, differences = {0.1, -0.2, 0.3};
    for (int surface = 0; surface < 4; surface++) {
        const HelfrichParameters& expected = (surface == 2 ? own : common);
        HelfrichEnergyTerms expectedTerms, terms;
        addTermsOfTotals(expected, 0, totals, expectedTerms);
        addTermsOfTotals(other, surface, totals, terms);
        for (int i = 0; i < NUM_TERMS; i++)
            ASSERT_EQUAL(expectedTerms[Term(i)], terms[Term(i)]);
        HelfrichTotals expectedSlopes = getSlopesByTotals(expected, 0, totals),
                       slopes = getSlopesByTotals(other, surface, totals);
        ASSERT_EQUAL(expectedSlopes.area, slopes.area);
        ASSERT_EQUAL(expectedSlopes.volume, slopes.volume);
        ASSERT_EQUAL(expectedSlopes.curvature, slopes.curvature);
        ASSERT_EQUAL(ChangeByTotals(expected, 0, totals).addTo(0, differences),
                     ChangeByTotals(other, surface, totals).addTo(0, differences));
    }
    ASSERT(computeEnergy(own, totals) != computeEnergy(common, totals));
}

void testContextParameters() {
    // Each sets a parameter of its own, and only a modulus turns its term on; a target may not be zero.

    HelfrichParameters p;
    set<string> names;
    set<const double*> places;
    for (auto& parameter : HELFRICH_CONTEXT_PARAMETERS) {
        names.insert(parameter.name);
        places.insert(&parameter.valueIn(p));
        HelfrichParameters set;
        parameter.valueIn(set) = 1;
        ASSERT_EQUAL(parameter.term == Term::Tension || parameter.term == Term::Pressure, set.has(parameter.term));
        ASSERT_EQUAL(parameter.allows(0), set.has(parameter.term) || parameter.term == Term::Bending);
        ASSERT_EQUAL(parameter.allows(-1), parameter.term != Term::Area && parameter.term != Term::Volume);
        ASSERT(parameter.allows(1) && !parameter.allows(NAN) && !parameter.allows(INFINITY));
    }
    for (auto& parameter : HELFRICH_CONTEXT_PARAMETERS)
        ASSERT_EQUAL(&parameter, &getContextParameter(parameter.term));
    ASSERT_EQUAL(size(HELFRICH_CONTEXT_PARAMETERS), names.size());
    ASSERT_EQUAL(size(HELFRICH_CONTEXT_PARAMETERS), places.size());
}

int main() {
    try {
        testMasks();
        testTermsThatAreOn();
        testTermsOfTotals();
        testTargetsOfSurfaces();
        testContextParameters();
    }
    catch (const exception& e) {
        cout << "exception: " << e.what() << endl;
        return 1;
    }
    cout << "Done" << endl;
    return 0;
}
