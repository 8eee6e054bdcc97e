// The energy of a sphere in C++, with the headers and libraries that the wheel installs beside OpenMM's:
//
//   libs=$(python -c 'import os, openmm.version as v; print(os.path.dirname(v.openmm_library_path))')
//   c++ -std=c++17 sphere.cpp -I$libs/include -L$libs/lib -Wl,-rpath,$libs/lib -lOpenMMHelfrich -lOpenMM -o sphere
//   ./sphere $libs/lib/plugins

#include "OpenMM.h"
#include "openmmhelfrich/HelfrichForce.h"
#include <algorithm>
#include <cmath>
#include <iostream>
#include <map>
#include <utility>
#include <vector>

using namespace OpenMM;
using namespace std;

// Divides each triangle of an octahedron into four, again and again, with all corners on the unit sphere.
static void makeSphere(int subdivisions, vector<Vec3>& vertices, vector<vector<int>>& triangles) {
    vertices = {{1, 0, 0}, {-1, 0, 0}, {0, 1, 0}, {0, -1, 0}, {0, 0, 1}, {0, 0, -1}};
    triangles = {{0, 2, 4}, {2, 1, 4}, {1, 3, 4}, {3, 0, 4}, {2, 0, 5}, {1, 2, 5}, {3, 1, 5}, {0, 3, 5}};
    for (int i = 0; i < subdivisions; i++) {
        vector<vector<int>> coarse = triangles;
        map<pair<int, int>, int> midpoints;
        auto midpoint = [&](int a, int b) {
            auto found = midpoints.emplace(minmax(a, b), vertices.size());
            if (found.second) {
                Vec3 sum = vertices[a] + vertices[b];
                vertices.push_back(sum / sqrt(sum.dot(sum)));
            }
            return found.first->second;
        };
        triangles.clear();
        for (auto& t : coarse) {
            int ab = midpoint(t[0], t[1]), bc = midpoint(t[1], t[2]), ca = midpoint(t[2], t[0]);
            triangles.insert(triangles.end(), {{t[0], ab, ca}, {t[1], bc, ab}, {t[2], ca, bc}, {ab, bc, ca}});
        }
    }
}

int main(int argc, char* argv[]) {
    if (argc != 2) {
        cerr << "usage: sphere FOLDER_OF_PLUGINS" << endl;
        return 2;
    }
    Platform::loadPluginsFromDirectory(argv[1]);
    vector<Vec3> vertices;
    vector<vector<int>> triangles;
    makeSphere(4, vertices, triangles);
    System system;
    for (size_t i = 0; i < vertices.size(); i++)
        system.addParticle(1.0);
    auto* force = new HelfrichPlugin::HelfrichForce();
    for (auto& t : triangles)
        force->addTriangle(t[0], t[1], t[2]);
    force->setBendingModulus(1.0); // kappa of kappa/2 times the integral of (2H-C_0)^2, with C_0 = 0
    system.addForce(force);
    for (const char* name : {"Reference", "CPU"}) {
        VerletIntegrator integrator(0.001);
        Context context(system, integrator, Platform::getPlatformByName(name));
        context.setPositions(vertices);
        double energy = context.getState(State::Energy).getPotentialEnergy();
        cout << name << ": E_B/8 pi kappa = " << energy / (8 * acos(-1.0)) << endl;
        if (abs(energy / (8 * acos(-1.0)) - 1) > 0.05)
            return 1;
    }
    return 0;
}
