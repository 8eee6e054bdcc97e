#include "openmm/internal/AssertionUtilities.h"
#include "openmmhelfrich/internal/Philox.h"
#include <cmath>
#include <iostream>
#include <vector>

using namespace HelfrichPlugin;
using namespace OpenMM;
using namespace std;

typedef array<uint32_t, 4> Words;

void testKnownAnswers() {
    // The vectors that the algorithm's authors publish (Random123, kat_vectors).

    ASSERT_EQUAL_CONTAINERS((Words{0x6627e8d5, 0xe169c58d, 0xbc57ac4c, 0x9b00dbd8}), Philox(0, 0)(0, 0));
    ASSERT_EQUAL_CONTAINERS((Words{0x408f276d, 0x41c83b0e, 0xa20bc7c6, 0x6d5451fd}),
                            Philox(0xffffffff, 0xffffffff)(0xffffffffffffffff, 0xffffffffffffffff));
    ASSERT_EQUAL_CONTAINERS((Words{0xd16cfe09, 0x94fdcceb, 0x5001e420, 0x24126ea1}),
                            Philox(0xa4093822, 0x299f31d0)(0x0370734413198a2e, 0x85a308d3243f6a88));
}

void testStreamsDiffer() {
    Words words = Philox(1, 2)(3, 4);
    for (const Words& other : {Philox(2, 2)(3, 4), Philox(1, 3)(3, 4), Philox(1, 2)(4, 4), Philox(1, 2)(3, 5)})
        for (int i = 0; i < 4; i++)
            ASSERT(words[i] != other[i]);
}

void testUniform() {
    ASSERT_EQUAL(0.0, Philox::uniform(0, 0));
    ASSERT_EQUAL(0.5, Philox::uniform(0x80000000, 0));
    ASSERT_EQUAL(1 - 0x1p-53, Philox::uniform(0xffffffff, 0xffffffff));
    Philox random(7, 1);
    const int n = 200000;
    double sum = 0, sumOfSquares = 0;
    for (int i = 0; i < n; i++) {
        auto words = random(0, i);
        double u = Philox::uniform(words[2], words[3]);
        sum += u;
        sumOfSquares += u * u;
    }
    // Four standard errors, at a fixed seed.
    ASSERT_EQUAL_TOL(0.5, sum / n, 4 * sqrt(1 / 12.0 / n));
    ASSERT_EQUAL_TOL(1 / 3.0, sumOfSquares / n, 4 * sqrt(4 / 45.0 / n));
}

void testIndex() {
    ASSERT_EQUAL(0u, Philox::index(0, 0xffffffff, 1));
    ASSERT_EQUAL(6u, Philox::index(0xffffffff, 0xffffffff, 7));
    ASSERT_EQUAL(0xfffffffeu, Philox::index(0xffffffff, 0xffffffff, 0xffffffff));
    Philox random(9, 1);
    const int n = 70000, numBins = 7;
    vector<int> count(numBins, 0);
    for (int i = 0; i < n; i++) {
        auto words = random(i, 0);
        count[Philox::index(words[0], words[1], numBins)]++;
    }
    double chiSquare = 0, expected = n / numBins;
    for (int c : count)
        chiSquare += (c - expected) * (c - expected) / expected;
    // The 99th percentile of chi square with six degrees of freedom.
    ASSERT(chiSquare < 16.81);
}

int main() {
    try {
        testKnownAnswers();
        testStreamsDiffer();
        testUniform();
        testIndex();
    }
    catch (const exception& e) {
        cout << "exception: " << e.what() << endl;
        return 1;
    }
    cout << "Done" << endl;
    return 0;
}
