#include "openmm/internal/AssertionUtilities.h"
#include "openmmhelfrich/internal/HelfrichStencils.h"
#include <iostream>
#include <random>
#include <vector>

using namespace HelfrichPlugin;
using namespace OpenMM;
using namespace std;

/**
 * The four vertices of an edge i-j and its triangles (i, j, k) and (j, i, l).
 */
struct Hinge {
    Vector3<double> i, j, k, l;
};

template <class Real>
Vector3<Real> convert(const Vector3<double>& v) {
    return {Real(v.x), Real(v.y), Real(v.z)};
}

/**
 * What is under test, in any precision.
 */
template <class Real>
Real getAngle(const Hinge& hinge, Real& sine, Real& cosine) {
    Vector3<Real> i = convert<Real>(hinge.i), e = convert<Real>(hinge.j) - i, toK = convert<Real>(hinge.k) - i,
                  toL = convert<Real>(hinge.l) - i;
    Real length = sqrt(dot(e, e));
    dihedralSineCosine(length, cross(e, toK), cross(toL, e), toL, sine, cosine);
    return dihedralAngle(length, cross(e, toK), cross(toL, e), toL);
}

/**
 * The angle from its definition, in extended precision.
 */
long double getExactAngle(const Hinge& hinge) {
    typedef Vector3<long double> Vector;
    Vector i = convert<long double>(hinge.i), e = convert<long double>(hinge.j) - i;
    auto normalize = [](const Vector& v) { return v * (1 / sqrt(dot(v, v))); };
    Vector nf = normalize(cross(e, convert<long double>(hinge.k) - i)),
           ng = normalize(cross(convert<long double>(hinge.l) - i, e));
    return atan2(dot(cross(nf, ng), normalize(e)), dot(nf, ng));
}

/**
 * An edge along x with triangles of different shapes, of which the first lies in the plane z = 0.  Outside is z > 0, so
 * that a convex edge has l below it.
 */
Hinge createHinge(double angle, double length, double heightF, double heightG) {
    return {{0, 0, 0},
            {length, 0, 0},
            {0.3 * length, heightF, 0},
            {0.8 * length, -heightG * cos(angle), -heightG * sin(angle)}};
}

const double ANGLES[] = {1e-8, 1e-4, 1, M_PI - 1e-4};

void testAngleInAlignedOrientation() {
    // With the first triangle in a coordinate plane, coordinates hold the sine to full relative accuracy, and nothing
    // in the stencil may lose it: the angle is good to 1e-12 of itself, and so are the sine and the cosine.

    for (double magnitude : ANGLES)
        for (double angle : {magnitude, -magnitude})
            for (double length : {1e-3, 1.0, 700.0})
                for (double heightG : {0.1, 1.0, 20.0}) {
                    Hinge hinge = createHinge(angle, length, 0.7 * length, heightG * length);
                    double sine, cosine;
                    long double exactSine, exactCosine;
                    double found = getAngle<double>(hinge, sine, cosine);
                    getAngle<long double>(hinge, exactSine, exactCosine);
                    ASSERT_EQUAL_TOL(1.0, found / angle, 1e-12);
                    ASSERT_EQUAL_TOL(1.0, (double) (found / getExactAngle(hinge)), 1e-14);
                    ASSERT_EQUAL_TOL(1.0, (double) (sine / exactSine), 1e-14);
                    ASSERT_EQUAL_TOL(1.0, (double) (cosine / exactCosine), 1e-14);
                }
}

Vector3<double> rotate(const Vector3<double>& v, double a, double b) {
    Vector3<double> w = {v.x * cos(a) - v.y * sin(a), v.x * sin(a) + v.y * cos(a), v.z};
    return {w.x, w.y * cos(b) - w.z * sin(b), w.y * sin(b) + w.z * cos(b)};
}

void testAngleInAnyOrientation() {
    // Rounding a coordinate of a triangle at a general orientation turns it by about 1e-16 rad, so that no stencil in
    // double precision can do better than that absolutely.  This one is not much worse, which is 1e-7 relative at 1e-8
    // rad and 1e-11 at 1e-4 rad.  (An arccosine would be wrong by 1e-8 rad.)

    mt19937 engine(1);
    for (double angle : ANGLES)
        for (int trial = 0; trial < 1000; trial++) {
            Hinge hinge = createHinge(angle, 1, 0.7, 0.9);
            double a = 6 * (engine() / 4294967296.0), b = 6 * (engine() / 4294967296.0), sine, cosine;
            for (auto v : {&hinge.i, &hinge.j, &hinge.k, &hinge.l})
                *v = rotate(*v, a, b) + Vector3<double>{0.1, 0.2, 0.3};
            ASSERT(fabs(getAngle<double>(hinge, sine, cosine) - getExactAngle(hinge)) < 1e-15);
        }
}

void testAngleOfPoint() {
    // All around the circle, most densely near the axes, to within two units in the last place.

    for (double sign : {1.0, -1.0})
        for (double magnitude : {1e-300, 1e-8, 1e-4, 1e-2, 0.1, 0.4, 0.41421356237309503, 0.4143, 0.7, 1.0, 1.5, 2.4,
                                 2.41421356237309505, 2.5, 10.0, 1e4, 1e8, 1e300})
            for (int i = 0; i < 1000; i++)
                for (double x : {1.0, -1.0}) {
                    double y = sign * magnitude * (1 + i * 1e-3);
                    double found = angleOf<ScalarMath>(y, x), exact = atan2((long double) y, (long double) x);
                    ASSERT_EQUAL_TOL(1.0, found / exact, 4.5e-16);
                }
    ASSERT_EQUAL(0.0, angleOf<ScalarMath>(0.0, 0.0));
    ASSERT_EQUAL(0.0, angleOf<ScalarMath>(0.0, 1.0));
    ASSERT_EQUAL(M_PI, angleOf<ScalarMath>(0.0, -1.0));
    ASSERT_EQUAL(-M_PI / 2, angleOf<ScalarMath>(-1.0, 0.0));
}

void testSign() {
    double sine, cosine;
    ASSERT(getAngle<double>(createHinge(0.1, 1, 1, 1), sine, cosine) > 0);
    ASSERT(getAngle<double>(createHinge(-0.1, 1, 1, 1), sine, cosine) < 0);
    ASSERT_EQUAL(0.0, getAngle<double>(createHinge(0, 1, 1, 1), sine, cosine));
    ASSERT_EQUAL(0.0, getAngle<double>(createHinge(1, 1, 0, 1), sine, cosine));
}

void testIntegerPower() {
    ASSERT_EQUAL(1.0, integerPower(0.7, 0));
    ASSERT_EQUAL(0.7, integerPower(0.7, 1));
    ASSERT_EQUAL_TOL(pow(0.7, 9), integerPower(0.7, 9), 1e-15);
}

template <class Potential>
void checkSlope(Potential potential, long double r) {
    // Central differences of sixth order in extended precision.

    long double ignored, slope, h = 1e-4L * r;
    auto at = [&](int n) { return potential(r + n * h, ignored); };
    long double difference = (45 * (at(1) - at(-1)) - 9 * (at(2) - at(-2)) + (at(3) - at(-3))) / (60 * h);
    potential(r, slope);
    ASSERT_EQUAL_TOL(1.0, (double) (difference / slope), 1e-12);
}

void testPotentials() {
    double slope;
    for (int exponent : {1, 2, 3, 6}) {
        auto tether = [&](long double l, long double& s) {
            return tetherPotential<long double>(l, 0.5L, 0.9L, exponent, s);
        };
        auto repulsion = [&](long double r, long double& s) {
            return repulsionPotential<long double>(r, 0.5L, exponent, s);
        };
        for (double l : {0.1, 0.25, 0.4, 0.45, 0.95, 2.0})
            checkSlope(tether, l);
        for (double r : {0.01, 0.25, 0.45})
            checkSlope(repulsion, r);
        for (double l : {0.1, 0.3, 0.499}) {
            double exact = exp(l / (l - 0.5)) * pow(l, -exponent);
            ASSERT_EQUAL_TOL(1.0, tetherPotential(l, 0.5, 0.9, exponent, slope) / exact, 1e-14);
            ASSERT_EQUAL_TOL(1.0, repulsionPotential(l, 0.5, exponent, slope) / exact, 1e-14);
        }
        double exact = pow(exponent, exponent + 1) * pow(1.3 - 0.9, exponent);
        ASSERT_EQUAL_TOL(1.0, tetherPotential(1.3, 0.5, 0.9, exponent, slope) / exact, 1e-14);
    }
}

void testPotentialsAtTheirEnds() {
    // At the ends of the branches energy and slope are zero, and next to them they are not infinite.

    double slope;
    for (double l : {0.5, 0.6, 0.9}) {
        ASSERT_EQUAL(0.0, tetherPotential(l, 0.5, 0.9, 2, slope));
        ASSERT_EQUAL(0.0, slope);
        ASSERT_EQUAL(0.0, repulsionPotential(l, 0.5, 2, slope));
        ASSERT_EQUAL(0.0, slope);
    }
    double below = nextafter(0.5, 0);
    ASSERT_EQUAL(0.0, tetherPotential(below, 0.5, 0.9, 2, slope));
    ASSERT_EQUAL(0.0, slope);
    ASSERT_EQUAL(0.0, repulsionPotential(below, 0.5, 2, slope));
    ASSERT_EQUAL(0.0, slope);
    ASSERT(tetherPotential(nextafter(0.9, 1), 0.5, 0.9, 2, slope) < 1e-30);
    ASSERT(slope < 1e-14);
    ASSERT_EQUAL(0.0, tetherPotential(0.3, 0.0, 0.9, 2, slope));
}

void testNearestImages() {
    // Of all images of a point the nearest is found, for numbers of each precision.

    PeriodicBox box(3, 4, 5);
    for (double x : {-7.4, -1.4, 0.0, 0.3, 1.4, 8.9})
        for (int n : {-2, 0, 1}) {
            Vector3<double> from = {0.1, 0.2, 0.3}, to = {x + 3 * n, x - 4 * n, x + 5 * n};
            Vector3<double> d = displacement(from, to, box), direct = displacement(from, to);
            ASSERT(fabs(d.x) <= 1.5 && fabs(d.y) <= 2 && fabs(d.z) <= 2.5);
            ASSERT_EQUAL_TOL(0.0, remainder(d.x - direct.x, 3), 1e-13);
            ASSERT_EQUAL_TOL(0.0, remainder(d.y - direct.y, 4), 1e-13);
            ASSERT_EQUAL_TOL(0.0, remainder(d.z - direct.z, 5), 1e-13);
            Vector3<double> none = displacement(from, to, PeriodicBox());
            ASSERT(none.x == direct.x && none.y == direct.y && none.z == direct.z);
        }
    ASSERT_EQUAL(2.0f, roundToInteger(1.75f));
    ASSERT_EQUAL(-3.0, roundToInteger(-2.75));
}

int main() {
    try {
        testNearestImages();
        testAngleInAlignedOrientation();
        testAngleInAnyOrientation();
        testAngleOfPoint();
        testSign();
        testIntegerPower();
        testPotentials();
        testPotentialsAtTheirEnds();
    }
    catch (const exception& e) {
        cout << "exception: " << e.what() << endl;
        return 1;
    }
    cout << "Done" << endl;
    return 0;
}
