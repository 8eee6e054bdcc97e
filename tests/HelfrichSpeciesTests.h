/* Tests of species and of what depends on them, which every platform must pass.  This is a part of TestHelfrichForce.h.
 */

void testSpontaneousCurvatureOfSpheres() {
    // The energy is that of a sphere, 8 pi kappa (1-C R/2)^2, to which the mesh converges with the square of the edges'
    // length.

    const double R = 50, modulus = 20;
    for (double reduced : {-1.0, 0.6, 2.0, 3.0}) {
        double previous = 0;
        for (int subdivisions : {3, 4, 5}) {
            Membrane sphere = createIcosphere(subdivisions);
            for (auto& x : sphere.positions)
                x *= R;
            HelfrichParameters p;
            p.moduli[Term::Bending] = modulus;
            MembraneContext context(sphere, withSpontaneousCurvature(p, reduced / R));
            double ratio = context.getEnergy() / (8 * M_PI * modulus), error = ratio - pow(1 - reduced / 2, 2);
            ASSERT(fabs(error) < 0.06 / pow(4, subdivisions - 3) * (1 + fabs(reduced)));
            ASSERT(previous == 0 || fabs(error) < 0.3 * fabs(previous));
            previous = error;
        }
    }
}

void testOneSpeciesIsOneMaterial() {
    // Species that are all alike are the same as one material, and the Context's curvature is added to theirs.

    Membrane blob = createBlob(2);
    HelfrichParameters uniform = withSpontaneousCurvature(createParameters(blob, AllTerms), 0.9), p = uniform;
    uniform.moduli[Term::Gaussian] = -8;
    auto table = make_shared<HelfrichSpeciesTable>();
    for (int i = 0; i < NUM_SPECIES; i++)
        table->add({uniform.moduli[Term::Bending], 0.5, -8});
    p.species = table;
    p.spontaneousCurvature = 0.4;
    p.moduli[Term::Gaussian] = -8;
    MembraneContext expected(blob, uniform), found(blob, p);
    for (int i = 0; i < NUM_TERMS; i++)
        ASSERT_EQUAL_TOL(expected.getTerms()[Term(i)], found.getTerms()[Term(i)], 1e-12);
    ASSERT_EQUAL_TOL(4 * M_PI * -8, found.getTerms()[Term::Gaussian], 1e-14);
    assertEqualVectors(expected.getForces(), found.getForces(), 1e-12);
}

void testRelabeledSpecies() {
    Membrane blob = createBlob(2), other = blob;
    HelfrichParameters p = createParameters(blob, EveryTerm), q = p;
    const int newLabel[] = {2, 0, 1}, oldLabel[] = {1, 2, 0};
    auto table = make_shared<HelfrichSpeciesTable>();
    for (int i : oldLabel)
        table->add((*p.species)[i]);
    p.species->lineTensions.forEach(
            [&](int a, int b, double value) { table->lineTensions.set(newLabel[a], newLabel[b], value); });
    p.species->pairEnergies.forEach(
            [&](int a, int b, double value) { table->pairEnergies.set(newLabel[a], newLabel[b], value); });
    q.species = table;
    other.species = getSpecies(blob);
    for (int& species : other.species)
        species = newLabel[species];
    MembraneContext context(blob, p), relabeled(other, q);
    assertEqualRelative(context.getEnergy(), relabeled.getEnergy(), 1e-13);
    assertEqualVectors(context.getForces(), relabeled.getForces(), 1e-13);
}

void testDefectsAddUp() {
    // What two species have of the Gaussian curvature is 4 pi together, for each surface.

    for (const Membrane& membrane : {createBlob(2), createSeveralSurfaces(), createIcosphere(4)}) {
        double sum = 0, numSurfaces = 0;
        for (int species = 0; species < NUM_SPECIES; species++) {
            HelfrichParameters p;
            auto table = make_shared<HelfrichSpeciesTable>();
            for (int i = 0; i < NUM_SPECIES; i++)
                table->add({0, 0, i == species ? 1.0 : 0.0});
            p.species = table;
            p.moduli[Term::Gaussian] = 1;
            MembraneContext context(membrane, p);
            double part = context.getTerms()[Term::Gaussian];
            ASSERT(fabs(part) > 0.1);
            sum += part;
            numSurfaces = context.forces[0]->getNumSurfacesInContext(*context.context);
        }
        ASSERT_EQUAL_TOL(numSurfaces, sum / (4 * M_PI), 1e-12);
    }
}

void testPatchOfASphere() {
    // By Gauss and Bonnet a cap of angle a has the Gaussian curvature 2 pi (1-cos a), and its boundary, which is
    // 2 pi sin a long on the unit sphere, the geodesic curvature cos a/sin a.  Vertices within the boundary's own width
    // count for one side or the other.

    for (double angle : {0.7, 1.2, 2.0}) {
        Membrane sphere = createIcosphere(5);
        for (auto& x : sphere.positions)
            sphere.species.push_back(x[2] > cos(angle));
        HelfrichParameters p;
        auto table = make_shared<HelfrichSpeciesTable>();
        table->add({0, 0, 3});
        table->add({0, 0, -5});
        table->lineTensions.set(0, 1, 7);
        p.species = table;
        p.moduli[Term::Gaussian] = -5;
        p.moduli[Term::Line] = 7;
        HelfrichEnergyTerms terms = MembraneContext(sphere, p).getTerms();
        double byBoundary = -(-5 - 3) * 2 * M_PI * cos(angle), constant = 2 * M_PI * (3 - 5);
        ASSERT_EQUAL_TOL(byBoundary + constant, terms[Term::Gaussian], 0.03);
        // The boundary goes along a lattice, and is longer than the circle by up to a few percent times its zigzag.
        double ratio = terms[Term::Line] / (7 * 2 * M_PI * sin(angle));
        ASSERT(ratio > 1 && ratio < 1.2);
    }
}

void testChangingSpecies() {
    // The forces follow the live species, alone and after flips, and the parameters of species.

    Membrane blob = createBlob(2), other = blob;
    other.species = getSpecies(blob);
    TestRandom random(3);
    for (int i = 0; i < 20; i++)
        swap(other.species[random.index(other.species.size())], other.species[random.index(other.species.size())]);
    other.species[3] = 1;
    HelfrichParameters p = createParameters(blob, EveryTerm, 2);
    MembraneContext context(blob, p), fresh(other, p);
    HelfrichForce& force = *context.forces[0];
    double before = context.getEnergy();
    vector<int> live;
    force.setVertexSpeciesInContext(*context.context, other.species);
    force.getVertexSpeciesInContext(*context.context, live);
    ASSERT_EQUAL_CONTAINERS(other.species, live);
    ASSERT_EQUAL(fresh.getEnergy(), context.getEnergy());
    assertEqualVectors(fresh.getForces(), context.getForces(), 0);
    context.context->reinitialize(true);
    ASSERT_EQUAL(before, context.getEnergy());

    // A change of a species' moduli, or of those between two, and of the curvature of all.

    for (int change = 0; change < 4; change++) {
        auto table = make_shared<HelfrichSpeciesTable>(*p.species);
        if (change == 0)
            table->set(1, {13, -0.4, 2});
        if (change == 1)
            table->lineTensions.set(0, 2, 9);
        if (change == 2)
            table->pairEnergies.set(0, 0, -4);
        if (change == 3)
            p.spontaneousCurvature = -0.7;
        p.species = table;
        p.moduli[Term::Gaussian] = table->getGreatest().gaussianModulus;
        force.setSpeciesParameters(1, (*table)[1].bendingModulus, (*table)[1].spontaneousCurvature,
                                   (*table)[1].gaussianModulus);
        force.setLineTension(2, 0, table->lineTensions.get(0, 2));
        force.setPairEnergy(0, 0, table->pairEnergies.get(0, 0));
        ASSERT(change == 3 || before == context.getEnergy());
        force.updateParametersInContext(*context.context);
        context.context->setParameter(force.getSpontaneousCurvatureParameter(), p.spontaneousCurvature);
        MembraneContext changed(blob, p);
        ASSERT(fabs(changed.getEnergy() - before) > 1);
        ASSERT_EQUAL(changed.getEnergy(), context.getEnergy());
        assertEqualVectors(changed.getForces(), context.getForces(), 0);
        before = changed.getEnergy();
    }
}

void testOneSpeciesAVertex() {
    // A field that varies along the surface.

    Membrane blob = createBlob(2);
    HelfrichParameters p;
    TestRandom random(5);
    auto table = make_shared<HelfrichSpeciesTable>();
    for (size_t i = 0; i < blob.positions.size(); i++) {
        blob.species.push_back(blob.positions.size() - 1 - i);
        table->add({random.uniform(5, 40), random.uniform(-2, 2), random.uniform(-20, 0)});
    }
    for (size_t i = 0; i < blob.positions.size(); i++)
        for (size_t j = 0; j < i; j++)
            table->lineTensions.set(i, j, random.uniform(0, 10));
    p.species = table;
    p.moduli[Term::Bending] = p.moduli[Term::Gaussian] = p.moduli[Term::Line] = 1;
    MembraneContext context(blob, p);
    assertEqualRelative(computeExactly(blob, p).getTotal(), context.getEnergy(), 1e-12);
    vector<int> some;
    vector<Vec3> found;
    for (size_t i = 0; i < blob.positions.size(); i += 5) {
        some.push_back(i);
        found.push_back(context.getForces()[i]);
    }
    assertEqualVectors(computeForcesExactly(blob, p, some), found, 1e-11);
}

void testTableOfSpecies() {
    // What all species have in common is that of a search through them, whatever was set before.

    TestRandom random(6);
    HelfrichSpeciesTable table;
    vector<HelfrichSpecies> expected;
    ASSERT_EQUAL(0.0, table.getGreatest().bendingModulus);
    ASSERT(!table.hasDifferentGaussianModuli());
    auto check = [&] {
        HelfrichSpecies greatest;
        bool isDifferent = false;
        for (auto& each : expected) {
            isDifferent |= (each.gaussianModulus != expected[0].gaussianModulus);
            for (auto member : {&HelfrichSpecies::bendingModulus, &HelfrichSpecies::spontaneousCurvature,
                                &HelfrichSpecies::gaussianModulus})
                if (fabs(each.*member) > fabs(greatest.*member))
                    greatest.*member = each.*member;
        }
        ASSERT_EQUAL(greatest.bendingModulus, table.getGreatest().bendingModulus);
        ASSERT_EQUAL(greatest.spontaneousCurvature, table.getGreatest().spontaneousCurvature);
        ASSERT_EQUAL(greatest.gaussianModulus, table.getGreatest().gaussianModulus);
        ASSERT_EQUAL(isDifferent, table.hasDifferentGaussianModuli());
    };
    auto draw = [&](double gaussian) {
        return HelfrichSpecies{double(random.index(9)), random.index(9) - 4.0, gaussian};
    };
    for (int i = 0; i < 700; i++) {
        expected.push_back(draw(-1));
        table.add(expected.back());
        check();
    }
    for (int i = 0; i < 2000; i++) {
        int index = random.index(expected.size());
        expected[index] = draw(random.index(500) == 0 ? -2 : -1);
        table.set(index, expected[index]);
        check();
    }
}

void testTableOfPairs() {
    // It is that of a map, with its greatest number, whatever was set before.

    TestRandom random(2);
    HelfrichSpeciesPairs pairs;
    map<pair<int, int>, double> expected;
    for (int i = 0; i < 2000; i++) {
        int a = random.index(20) * 50, b = random.index(20) * 50;
        double value = random.index(3) == 0 ? 0 : random.uniform(-5, 5);
        pairs.set(a, b, value);
        expected[{min(a, b), max(a, b)}] = value;
        double greatest = 0;
        for (auto& each : expected) {
            ASSERT_EQUAL(each.second, pairs.get(each.first.second, each.first.first));
            greatest = max(greatest, fabs(each.second));
        }
        ASSERT_EQUAL(greatest, fabs(pairs.getGreatest()));
    }
    int numPairs = 0;
    pairs.forEach([&](int a, int b, double value) {
        numPairs++;
        ASSERT(a <= b && expected.at({a, b}) == value && value != 0);
    });
    for (auto& each : expected)
        numPairs -= (each.second != 0);
    ASSERT_EQUAL(0, numPairs);
    ASSERT_EQUAL(0.0, pairs.get(7, 50));
    ASSERT_EQUAL(0.0, pairs.get(5000, 1));
}

void testInvalidSpecies() {
    Membrane blob = createBlob(1);
    HelfrichForce force;
    assertThrows([&] { force.setLineTension(0, 1, 2); }, {"setLineTension", "no species 0", "there are 0"});
    assertThrows([&] { force.addSpecies(-1, 0); }, {"addSpecies: the bending modulus is -1", "not negative"});
    assertThrows([&] { force.addSpecies(1, NAN); }, {"addSpecies: the spontaneous curvature is nan", "finite"});
    assertThrows([&] { force.addSpecies(1, 0, INFINITY); }, {"addSpecies: the Gaussian modulus is inf"});
    assertThrows([&] { force.setSpontaneousCurvature(NAN); }, {"setSpontaneousCurvature", "nan"});
    assertThrows([&] { force.setGaussianModulus(NAN); }, {"setGaussianModulus", "nan"});
    force.setBendingModulus(5);
    ASSERT_EQUAL(0, force.addSpecies(20, 0));
    ASSERT_EQUAL(1, force.addSpecies(30, 0, -10));
    ASSERT_EQUAL(30.0, force.getBendingModulus());
    assertThrows([&] { force.setBendingModulus(1); }, {"setBendingModulus", "2 species", "setSpeciesParameters"});
    assertThrows([&] { force.setGaussianModulus(1); }, {"setGaussianModulus", "2 species"});
    assertThrows([&] { force.setLineTension(1, 1, 2); }, {"setLineTension", "1 and 1", "different"});
    assertThrows([&] { force.setLineTension(0, 1, NAN); }, {"setLineTension: the line tension is nan"});
    assertThrows([&] { force.setPairEnergy(0, 2, 1); }, {"setPairEnergy", "no species 2"});
    assertThrows([&] { force.setPairEnergy(0, 1, INFINITY); }, {"setPairEnergy: the energy is inf"});
    assertThrows([&] { force.setVertexSpecies({0, -1}); }, {"setVertexSpecies", "vertex 1", "-1"});
    auto createContext = [&](const vector<int>& species, bool hasSpecies) {
        HelfrichForce* force = new HelfrichForce();
        force->setTriangles(blob.triangles);
        force->setVertexSpecies(species);
        for (int i = 0; i < 2 && hasSpecies; i++)
            force->addSpecies(20, 0);
        MembraneContext context(blob.positions, {force});
    };
    vector<int> species(blob.positions.size(), 1);
    createContext(species, true);
    createContext({}, true);
    assertThrows([&] { createContext(species, false); }, {"vertex 0 is of species 1", "there are 0 species"});
    species[7] = 2;
    assertThrows([&] { createContext(species, true); }, {"vertex 7 is of species 2", "there are 2 species"});
    species.pop_back();
    assertThrows([&] { createContext(species, true); }, {"17 species of vertices for 18 vertices"});
    HelfrichParameters p = createParameters(blob, EveryTerm);
    MembraneContext context(blob, p), uniform(blob, createParameters(blob, AllTerms));
    const HelfrichForce& valid = *context.forces[0];
    double energy = context.getEnergy();
    assertThrows([&] { valid.setVertexSpeciesInContext(*context.context, {0, 1}); }, {"2 species of vertices"});
    assertThrows([&] { valid.setVertexSpeciesInContext(*context.context, vector<int>(18, 3)); }, {"of species 3"});
    assertThrows([&] { uniform.forces[0]->setVertexSpeciesInContext(*uniform.context, vector<int>(18, 0)); },
                 {"no species when the Context was created"});
    ASSERT_EQUAL(energy, context.getEnergy());
    context.context->setParameter(valid.getSpontaneousCurvatureParameter(), NAN);
    assertThrows([&] { context.getEnergy(); }, {"bending term is on", "SpontaneousCurvature is nan"});

    // Which way is out matters to a spontaneous curvature.

    for (auto& t : blob.triangles)
        swap(t[0], t[1]);
    HelfrichParameters bending = createParameters(blob, Bending);
    MembraneContext(blob, bending).getEnergy();
    MembraneContext inverted(blob, withSpontaneousCurvature(bending));
    assertThrows([&] { inverted.getEnergy(); }, {"which side of the surface is outside", "inside out"});
}

void testSpecies() {
    testSpontaneousCurvatureOfSpheres();
    testOneSpeciesIsOneMaterial();
    testRelabeledSpecies();
    testDefectsAddUp();
    testPatchOfASphere();
    testChangingSpecies();
    testOneSpeciesAVertex();
    testTableOfSpecies();
    testTableOfPairs();
    testInvalidSpecies();
}
