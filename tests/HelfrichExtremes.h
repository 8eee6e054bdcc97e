/* Tests at the extremes of geometry and parameters, which every platform must pass: docs/results/extremes.md lists
 * them. This is a part of TestHelfrichForce.h. */

/**
 * Move a membrane so that its first vertex is at the origin.  In extended precision that rounds nothing, and energies
 * far from the origin can be computed exactly.
 */
vector<array<long double, 3>> moveToOrigin(const vector<Vec3>& positions) {
    vector<array<long double, 3>> x;
    for (auto& point : positions) {
        x.push_back({});
        for (int i = 0; i < 3; i++)
            x.back()[i] = (long double) point[i] - positions[0][i];
    }
    return x;
}

HelfrichEquations<long double> computeExactlyAnywhere(const Membrane& membrane, const HelfrichParameters& p) {
    static vector<array<long double, 3>> x;
    x = moveToOrigin(membrane.positions);
    return HelfrichEquations<long double>(membrane.triangles, x, p);
}

vector<Vec3> computeAllForcesExactly(const Membrane& membrane, const HelfrichParameters& p) {
    vector<array<Dual, 3>> x;
    for (auto& point : moveToOrigin(membrane.positions))
        x.push_back({Dual(point[0]), Dual(point[1]), Dual(point[2])});
    vector<Vec3> forces;
    for (auto& point : x) {
        Vec3 force;
        for (int i = 0; i < 3; i++) {
            point[i].slope = 1;
            force[i] = -HelfrichEquations<Dual>(membrane.triangles, x, p).getTotal().slope;
            point[i].slope = 0;
        }
        forces.push_back(force);
    }
    return forces;
}

double getDifference(const vector<Vec3>& a, const vector<Vec3>& b) {
    vector<Vec3> difference;
    for (size_t i = 0; i < a.size(); i++)
        difference.push_back(a[i] - b[i]);
    return getNorm(difference) / getNorm(a);
}

/**
 * The relative change of the exact forces when every coordinate changes by at most half of its last bit: more than the
 * digits that the positions hold nobody can know.
 */
double getConditionOfForces(const Membrane& membrane, const HelfrichParameters& p, const vector<Vec3>& exact) {
    TestRandom random(3);
    double change = 0;
    for (int trial = 0; trial < 3; trial++) {
        Membrane other = membrane;
        for (auto& x : other.positions)
            for (int i = 0; i < 3; i++)
                x[i] *= 1 + random.uniform(-1, 1) * 1.2e-16 * (1 + trial);
        change = max(change, getDifference(exact, computeAllForcesExactly(other, p)));
    }
    return change;
}

/**
 * Assert that energy and forces are the exact ones.
 */
void assertExact(const Membrane& membrane, const HelfrichParameters& p, double energyTolerance, double forceTolerance) {
    MembraneContext context(membrane, p);
    assertEqualRelative(computeExactlyAnywhere(membrane, p).getTotal(), context.getEnergy(), energyTolerance);
    ASSERT(getDifference(computeAllForcesExactly(membrane, p), context.getForces()) <= forceTolerance);
}

void assertFails(MembraneContext& context, const string& words) {
    try {
        context.getEnergy();
    }
    catch (const OpenMMException& error) {
        ASSERT(string(error.what()).find(words) != string::npos);
        return;
    }
    throwException(__FILE__, __LINE__, "no error that says '" + words + "'");
}

/**
 * Make two triangles of a membrane needles with a short edge, or one of them a cap with a small height.
 */
Membrane createThinTriangle(bool isNeedle, double thickness) {
    Membrane blob = createBlob(1);
    array<int, 3> t = blob.triangles[5];
    Vec3 a = blob.positions[t[0]], b = blob.positions[t[1]];
    Vec3& c = blob.positions[t[2]];
    c = isNeedle ? a + (c - a) * thickness : a * 0.6 + b * 0.4 + (c - (a + b) * 0.5) * thickness;
    return blob;
}

void testThinTriangles() {
    // The errors are less than those which the rounding of the positions alone makes; forces are good to 1e-6 down to
    // areas of 1e-10 of the mean.

    for (bool isNeedle : {true, false})
        for (double thickness : {1e-2, 1e-4, 1e-6, 1e-8, 1e-10, 1e-12}) {
            Membrane blob = createThinTriangle(isNeedle, thickness);
            HelfrichParameters p = createParameters(blob, Bending | Area | Volume | AreaDifference);
            vector<Vec3> exact = computeAllForcesExactly(blob, p);
            MembraneContext context(blob, p);
            double condition = getConditionOfForces(blob, p, exact), error = getDifference(exact, context.getForces());
            double energyError = fabs(context.getEnergy() / computeExactly(blob, p).getTotal() - 1);
            ASSERT(error < 1e-15 + condition && energyError < 1e-14 + condition);
            ASSERT(error < 1e-6 || thickness < 1e-11);
        }
}

/**
 * A cube of n*n squares a face, each of two triangles.
 */
Membrane createCube(int n) {
    Membrane cube;
    map<array<int, 3>, int> indices;
    auto add = [&](const array<int, 3>& x) {
        if (indices.insert({x, (int) indices.size()}).second)
            cube.positions.push_back(Vec3(x[0], x[1], x[2]));
        return indices[x];
    };
    for (int axis = 0; axis < 3; axis++)
        for (int side : {0, n})
            for (int u = 0; u < n; u++)
                for (int v = 0; v < n; v++) {
                    auto corner = [&](int du, int dv) {
                        array<int, 3> x;
                        x[axis] = side;
                        x[(axis + 1) % 3] = u + du;
                        x[(axis + 2) % 3] = v + dv;
                        return add(x);
                    };
                    int a = corner(0, 0), b = corner(1, 0), c = corner(1, 1), d = corner(0, 1);
                    if (side == 0)
                        swap(b, d);
                    cube.triangles.push_back({a, b, c});
                    cube.triangles.push_back({a, c, d});
                }
    return cube;
}

void testFlatFaces() {
    Membrane cube = createCube(4);
    HelfrichParameters p = createParameters(cube, Bending | Area | Volume | AreaDifference | Tether);
    assertExact(cube, p, 1e-14, 1e-12);
    HelfrichGeometry geometry = MembraneContext(cube, p).getGeometry();
    ASSERT_EQUAL_TOL(96.0, geometry.area, 1e-14);
    ASSERT_EQUAL_TOL(64.0, geometry.volume, 1e-14);
    ASSERT_EQUAL_TOL(48 * M_PI / 4, geometry.integratedMeanCurvature, 1e-15);
    int numFlat = 0;
    for (size_t i = 0; i < cube.positions.size(); i++) {
        int numEnds = 0;
        for (int axis = 0; axis < 3; axis++)
            numEnds += (cube.positions[i][axis] == 0 || cube.positions[i][axis] == 4);
        if (numEnds == 1) {
            numFlat++;
            ASSERT_EQUAL(0.0, geometry.vertexMeanCurvatures[i]);
        }
    }
    ASSERT_EQUAL(54, numFlat);
}

void testFoldedFlat() {
    // Two faces in one plane: the angle of the rim is pi, on whichever side the faces lie, and all others are 0.

    for (double sign : {1.0, -1.0}) {
        Membrane pillow = createPillow(0);
        for (auto& x : pillow.positions)
            x[2] *= sign;
        double rim = 0;
        for (int i = 0; i < 6; i++) {
            Vec3 edge = pillow.positions[(i + 1) % 6] - pillow.positions[i];
            rim += sqrt(edge.dot(edge));
        }
        MembraneContext context(pillow, createParameters(pillow, Bending | AreaDifference));
        HelfrichGeometry geometry = context.getGeometry();
        ASSERT_EQUAL_TOL(0.5 * M_PI * rim, geometry.integratedMeanCurvature, 1e-15);
        ASSERT_EQUAL(0.0, geometry.volume);
        ASSERT_EQUAL(0.0, geometry.vertexMeanCurvatures[6]);
        ASSERT(isfinite(context.getEnergy()) && isfinite(getNorm(context.getForces())));
    }
}

void testCoincidentVertices() {
    Membrane blob = createBlob(1), joined = blob, touching = blob;
    array<int, 3> t = blob.triangles[5];
    joined.positions[t[0]] = joined.positions[t[1]];
    // Two poles of the octahedron are not bonded.
    touching.positions[2] = touching.positions[5];
    for (TermMask terms : {Bending, AreaDifference, Tether, AllTerms}) {
        MembraneContext context(joined, createParameters(blob, terms));
        assertFails(context, "not finite");
    }
    MembraneContext repelled(touching, createParameters(blob, Repulsion));
    assertFails(repelled, "not finite");
    assertExact(touching, createParameters(blob, Bending | Area | Volume | AreaDifference | Tether), 1e-12, 1e-11);
    for (TermMask terms : {Area, Volume}) {
        HelfrichParameters p = createParameters(blob, terms);
        MembraneContext context(joined, p);
        assertEqualRelative(computeExactly(joined, p).getTotal(), context.getEnergy(), 1e-12);
        ASSERT(isfinite(getNorm(context.getForces())));
    }
}

void testValences() {
    // A tetrahedron; and a pyramid on either side of a polygon of 40 corners, one of whose triangles has a vertex of
    // valence 3 in its middle.

    Membrane tetrahedron, pyramids;
    tetrahedron.positions = {{0, 0, 0}, {1.1, 0, 0.1}, {0.2, 0.9, 0}, {0.3, 0.1, 1}};
    tetrahedron.triangles = {{0, 2, 1}, {0, 1, 3}, {1, 2, 3}, {2, 0, 3}};
    TestRandom random(5);
    for (int i = 0; i < 40; i++)
        pyramids.positions.push_back(Vec3(cos(i * M_PI / 20), sin(i * M_PI / 20), 0) + random.vector(0.02));
    pyramids.positions.push_back(Vec3(0.1, 0, 0.7));
    pyramids.positions.push_back(Vec3(0, -0.1, -0.5));
    for (int i = 0; i < 40; i++) {
        pyramids.triangles.push_back({i, (i + 1) % 40, 40});
        pyramids.triangles.push_back({(i + 1) % 40, i, 41});
    }
    array<int, 3> t = pyramids.triangles.back();
    pyramids.triangles.pop_back();
    pyramids.positions.push_back((pyramids.positions[t[0]] + pyramids.positions[t[1]] + pyramids.positions[t[2]]) /
                                         3.0 +
                                 random.vector(0.02));
    for (int c = 0; c < 3; c++)
        pyramids.triangles.push_back({t[c], t[(c + 1) % 3], 42});
    for (auto& membrane : {tetrahedron, pyramids})
        for (int level = 0; level < 3; level++)
            assertExact(membrane, createParameters(membrane, AllTerms, level), 1e-12, 1e-11);
}

void testScalesAndPlaces() {
    // Small and large membranes, and such a one far away: what positions lose there, the geometry has not lost.

    Membrane blob = createBlob(1);
    for (double scale : {1e-6, 1e6}) {
        Membrane scaled = blob;
        for (auto& x : scaled.positions)
            x *= scale;
        HelfrichParameters p = createParameters(blob, Bending | Area | Volume | AreaDifference);
        p.targetArea *= scale * scale;
        p.targetVolume *= scale * scale * scale;
        p.targetAreaDifference *= scale;
        assertExact(scaled, p, 1e-13, 1e-12);
        assertEqualRelative(MembraneContext(blob, createParameters(blob, Bending)).getEnergy(),
                            MembraneContext(scaled, createParameters(blob, Bending)).getEnergy(), 1e-12);
    }
    Membrane far = blob;
    for (auto& x : far.positions)
        x += Vec3(1e6, -0.7e6, 0.3e6);
    HelfrichParameters p = createParameters(blob, AllTerms);
    assertExact(far, p, 1e-13, 1e-12);
    auto exact = computeExactlyAnywhere(far, p);
    HelfrichGeometry geometry = MembraneContext(far, p).getGeometry();
    assertEqualRelative(exact.volume, geometry.volume, 1e-14);
    assertEqualRelative(exact.area, geometry.area, 1e-14);
    assertEqualRelative(exact.curvature, geometry.integratedMeanCurvature, 1e-13);
}

void testThinVesicles() {
    // A reduced volume of 0.05, and faces that touch but for the last digits: the repulsion holds them apart by
    // energies of any size.

    for (double thickness : {0.02, 1e-6, 1e-12}) {
        Membrane thin = createSphere(1);
        TestRandom random(2);
        for (auto& x : thin.positions)
            x = Vec3(x[0], x[1], x[2] * thickness) + Vec3(0.05, 0.05, 0.05 * thickness) * random.uniform(0, 1);
        HelfrichParameters p = createParameters(thin, AllTerms, 1);
        if (thickness == 0.02) {
            HelfrichGeometry geometry = MembraneContext(thin, p).getGeometry();
            double reducedVolume = 6 * sqrt(M_PI) * geometry.volume / pow(geometry.area, 1.5);
            ASSERT(reducedVolume < 0.05);
        }
        assertExact(thin, p, 1e-9, 1e-9);
    }
}

void testRatiosOfModuli() {
    // Every term twelve orders of magnitude above all others: none drowns, none spoils the rest.

    Membrane blob = createBlob(1);
    for (int large = 0; large < NUM_TERMS; large++) {
        HelfrichParameters p = createParameters(blob, AllTerms);
        for (int i = 0; i < NUM_TERMS; i++)
            p.moduli[Term(i)] *= (i == large ? 1e6 : 1e-6);
        assertExact(blob, p, 1e-12, 1e-11);
        HelfrichEnergyTerms terms = MembraneContext(blob, p).getTerms();
        auto exact = computeExactly(blob, p);
        for (int i = 0; i < NUM_TERMS; i++)
            assertEqualRelative(exact[Term(i)], terms[Term(i)], 1e-12);
    }
}

void testEndsOfTheTether() {
    // One bit to either side of its ends the tether is as good as slack; and every exponent is exact on both branches.

    Membrane blob = createBlob(1);
    Vec3 edge = blob.positions[blob.triangles[3][1]] - blob.positions[blob.triangles[3][0]];
    double length = sqrt(edge.dot(edge));
    for (int exponent = 1; exponent <= 12; exponent++) {
        HelfrichParameters p = createParameters(blob, Tether | Repulsion);
        p.tetherExponent = p.repulsionExponent = exponent;
        assertExact(blob, p, 1e-11, 1e-10);
        for (double end : {nextafter(length, 0), length, nextafter(length, 1)})
            for (bool isMinimum : {true, false}) {
                HelfrichParameters p = createParameters(blob, Tether);
                p.tetherExponent = exponent;
                p.tetherMinLength = isMinimum ? end : 1e-3;
                p.tetherMaxLength = isMinimum ? 10 : end;
                assertExact(blob, p, 1e-11, 1e-10);
            }
    }
}

void testExtremes() {
    testThinTriangles();
    testFlatFaces();
    testFoldedFlat();
    testCoincidentVertices();
    testValences();
    testScalesAndPlaces();
    testThinVesicles();
    testRatiosOfModuli();
    testEndsOfTheTether();
}
