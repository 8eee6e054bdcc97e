#ifndef HELFRICHEQUATIONS_H_
#define HELFRICHEQUATIONS_H_

/* The energy of HelfrichForce straight from its equations, in any floating point type, and its exact gradient in
 * extended precision.  It shares no line with what it tests. */

#include "Membranes.h"
#include <algorithm>
#include <map>
#include <set>
#include <vector>

namespace HelfrichPlugin {

/**
 * A number and its derivative by one of the coordinates.
 */
struct Dual {
    long double value, slope;
    Dual(long double value = 0, long double slope = 0) : value(value), slope(slope) {
    }
    Dual& operator+=(const Dual& b) {
        return *this = {value + b.value, slope + b.slope};
    }
};

inline Dual operator+(const Dual& a, const Dual& b) {
    return {a.value + b.value, a.slope + b.slope};
}

inline Dual operator-(const Dual& a, const Dual& b) {
    return {a.value - b.value, a.slope - b.slope};
}

inline Dual operator*(const Dual& a, const Dual& b) {
    return {a.value * b.value, a.slope * b.value + a.value * b.slope};
}

inline Dual operator/(const Dual& a, const Dual& b) {
    return {a.value / b.value, (a.slope - a.value / b.value * b.slope) / b.value};
}

inline bool operator<(const Dual& a, const Dual& b) {
    return a.value < b.value;
}

inline Dual sqrt(const Dual& a) {
    long double root = std::sqrt(a.value);
    return {root, a.slope / (2 * root)};
}

inline Dual exp(const Dual& a) {
    long double value = std::exp(a.value);
    return {value, a.slope * value};
}

inline Dual pow(const Dual& a, int n) {
    return {std::pow(a.value, n), n * std::pow(a.value, n - 1) * a.slope};
}

inline Dual atan2(const Dual& y, const Dual& x) {
    long double square = x.value * x.value + y.value * y.value;
    return {std::atan2(y.value, x.value), (y.slope * x.value - x.slope * y.value) / square};
}

template <class Real>
class HelfrichEquations {
public:
    typedef std::array<Real, 3> Point;
    struct Surface {
        Real area = 0, volume = 0, curvature = 0;
    };
    Real area = 0, volume = 0, curvature = 0;
    /// in the order of their first triangles
    std::vector<Surface> surfaces;
    std::vector<Real> vertexAreas, vertexCurvatures;
    HelfrichEquations(const std::vector<std::array<int, 3>>& triangles, const std::vector<Point>& x,
                      const HelfrichParameters& p, const std::vector<int>& species = {})
            : vertexAreas(x.size(), Real(0)), vertexCurvatures(x.size(), Real(0)), triangles(triangles), x(x),
              species(species) {
        for (auto& t : triangles)
            for (int c = 0; c < 3; c++)
                apexes[{t[c], t[(c + 1) % 3]}] = t[(c + 2) % 3];
        findSurfaces();
        addTriangles();
        addEdges(p);
        Real two = 2;
        for (size_t i = 0; i < x.size(); i++)
            if (p.has(Term::Bending)) {
                double modulus = p.moduli[Term::Bending], spontaneous = p.spontaneousCurvature;
                if (p.species) {
                    modulus = (*p.species)[species[i]].bendingModulus;
                    spontaneous += (*p.species)[species[i]].spontaneousCurvature;
                }
                Real excess = vertexCurvatures[i] - Real(spontaneous / 2) * vertexAreas[i];
                energy(Term::Bending) += two * Real(modulus) * excess * excess / vertexAreas[i];
            }
        for (size_t k = 0; k < surfaces.size(); k++) {
            auto add = [&](Term term, Real value, double commonTarget) {
                auto own = p.surfaceTargets.find({term, (int) k});
                double target = (own == p.surfaceTargets.end() ? commonTarget : own->second);
                energy(term) += penalty(p.moduli[term], value, target);
            };
            add(Term::Area, surfaces[k].area, p.targetArea);
            add(Term::Volume, surfaces[k].volume, p.targetVolume);
            add(Term::AreaDifference, two * Real(p.leafletSeparation) * surfaces[k].curvature, p.targetAreaDifference);
            area += surfaces[k].area;
            volume += surfaces[k].volume;
            curvature += surfaces[k].curvature;
        }
        energy(Term::Tension) = Real(p.moduli[Term::Tension]) * area;
        energy(Term::Pressure) = Real(-p.moduli[Term::Pressure]) * volume;
        if (p.has(Term::Repulsion))
            addRepulsion(p);
        if (p.has(Term::Gaussian))
            addGaussian(p);
        if (p.has(Term::Line))
            addLines(p);
        if (p.has(Term::Pair))
            for (auto& edge : apexes)
                energy(Term::Pair) +=
                        Real(p.species->pairEnergies.get(species[edge.first.first], species[edge.first.second]) / 2);
    }
    Real operator[](Term term) const {
        return energies[int(term)];
    }
    Real getTotal() const {
        Real total = 0;
        for (auto& term : energies)
            total += term;
        return total;
    }
private:
    Real& energy(Term term) {
        return energies[int(term)];
    }
    static Point subtract(const Point& a, const Point& b) {
        return {a[0] - b[0], a[1] - b[1], a[2] - b[2]};
    }
    static Real dot(const Point& a, const Point& b) {
        return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    }
    static Point cross(const Point& a, const Point& b) {
        return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
    }
    static Real length(const Point& a) {
        using std::sqrt;
        return sqrt(dot(a, a));
    }
    static Real penalty(double modulus, Real value, double target) {
        Real deviation = modulus == 0 ? Real(0) : value / Real(target) - Real(1);
        return Real(modulus) * deviation * deviation;
    }
    static Real contact(Real r, double onset, int exponent) {
        using std::exp;
        using std::pow;
        return exp(r / (r - Real(onset))) * pow(r, -exponent);
    }
    Point normal(int a, int b, int c) const {
        return cross(subtract(x[b], x[a]), subtract(x[c], x[a]));
    }
    Point unitNormal(int a, int b, int c) const {
        Point n = normal(a, b, c);
        Real norm = length(n);
        return {n[0] / norm, n[1] / norm, n[2] / norm};
    }
    void findSurfaces() {
        // Corners of a triangle point to each other, and so in the end to one and the same vertex of their surface.

        std::vector<int> next(x.size());
        for (int i = 0; i < (int) x.size(); i++)
            next[i] = i;
        auto last = [&](int i) {
            while (next[i] != i)
                i = next[i] = next[next[i]];
            return i;
        };
        for (auto& t : triangles)
            for (int i : t)
                next[last(i)] = last(t[0]);
        std::map<int, int> numbers;
        for (auto& t : triangles)
            numbers.insert({last(t[0]), (int) numbers.size()});
        surfaces.resize(numbers.size());
        for (int i = 0; i < (int) x.size(); i++) {
            auto number = numbers.find(last(i));
            surfaceOf.push_back(number == numbers.end() ? -1 : number->second);
        }
    }
    void addTriangles() {
        for (auto& t : triangles) {
            Real triangleArea = length(normal(t[0], t[1], t[2])) / Real(2);
            surfaces[surfaceOf[t[0]]].area += triangleArea;
            surfaces[surfaceOf[t[0]]].volume += dot(x[t[0]], cross(x[t[1]], x[t[2]])) / Real(6);
            for (int i : t)
                vertexAreas[i] += triangleArea / Real(3);
        }
    }
    void addEdges(const HelfrichParameters& p) {
        using std::atan2;
        for (auto& edge : apexes) {
            int i = edge.first.first, j = edge.first.second;
            if (i > j)
                continue;
            Point e = subtract(x[j], x[i]), nf = unitNormal(i, j, edge.second),
                  ng = unitNormal(j, i, apexes.at({j, i}));
            Real l = length(e), angle = atan2(dot(cross(nf, ng), e) / l, dot(nf, ng)), quarter = l * angle / Real(4);
            vertexCurvatures[i] += quarter;
            vertexCurvatures[j] += quarter;
            surfaces[surfaceOf[i]].curvature += quarter + quarter;
            if (p.has(Term::Tether))
                addTether(l, p);
        }
    }
    void addTether(Real l, const HelfrichParameters& p) {
        using std::pow;
        Real scale = p.tetherLengthScale;
        if (l < Real(p.tetherMinLength))
            energy(Term::Tether) += Real(p.moduli[Term::Tether]) * contact(l, p.tetherMinLength, p.tetherExponent) *
                                    pow(scale, p.tetherExponent);
        else if (Real(p.tetherMaxLength) < l)
            energy(Term::Tether) += Real(p.moduli[Term::Tether]) * pow(Real(p.tetherExponent), p.tetherExponent + 1) *
                                    pow((l - Real(p.tetherMaxLength)) / scale, p.tetherExponent);
    }
    void addRepulsion(const HelfrichParameters& p) {
        using std::pow;
        std::vector<std::set<int>> bonded(x.size()), excluded(x.size());
        for (auto& edge : apexes)
            bonded[edge.first.first].insert(edge.first.second);
        for (size_t i = 0; i < x.size(); i++) {
            if (p.repulsionExclusionLevel >= 1)
                excluded[i] = bonded[i];
            if (p.repulsionExclusionLevel == 2)
                for (int j : bonded[i])
                    excluded[i].insert(bonded[j].begin(), bonded[j].end());
        }
        for (size_t i = 0; i < x.size(); i++)
            for (size_t j = 0; j < x.size(); j++) {
                Real r = i == j ? Real(0) : length(subtract(x[j], x[i]));
                if (i != j && r < Real(p.repulsionOnset) && excluded[i].count(j) == 0)
                    energy(Term::Repulsion) += Real(p.moduli[Term::Repulsion]) *
                                               contact(r, p.repulsionOnset, p.repulsionExponent) *
                                               pow(Real(p.repulsionLengthScale), p.repulsionExponent);
            }
    }
    Real angle(int a, int b, int c) const {
        using std::atan2;
        Point u = subtract(x[b], x[a]), w = subtract(x[c], x[a]);
        return atan2(length(cross(u, w)), dot(u, w));
    }
    void addGaussian(const HelfrichParameters& p) {
        std::vector<Real> defects(x.size(), Real(2 * std::acos(-1.0L)));
        for (auto& t : triangles)
            for (int c = 0; c < 3; c++)
                defects[t[c]] = defects[t[c]] - angle(t[c], t[(c + 1) % 3], t[(c + 2) % 3]);
        for (size_t i = 0; i < x.size(); i++) {
            double modulus = p.species ? (*p.species)[species[i]].gaussianModulus : p.moduli[Term::Gaussian];
            energy(Term::Gaussian) += Real(modulus) * defects[i];
        }
    }
    Point mean(const std::vector<int>& vertices) const {
        Point sum = {0, 0, 0};
        for (int i : vertices)
            for (int c = 0; c < 3; c++)
                sum[c] += x[i][c] / Real((double) vertices.size());
        return sum;
    }
    void addLines(const HelfrichParameters& p) {
        for (auto& t : triangles) {
            std::vector<Point> middles;
            std::vector<double> tensions;
            for (int c = 0; c < 3; c++) {
                int i = t[c], j = t[(c + 1) % 3];
                if (species[i] == species[j])
                    continue;
                middles.push_back(mean({i, j}));
                tensions.push_back(p.species->lineTensions.get(species[i], species[j]));
            }
            if (middles.size() == 2)
                energy(Term::Line) += Real(tensions[0]) * length(subtract(middles[0], middles[1]));
            for (size_t c = 0; c < middles.size() && middles.size() == 3; c++)
                energy(Term::Line) += Real(tensions[c]) * length(subtract(middles[c], mean({t[0], t[1], t[2]})));
        }
    }
    const std::vector<std::array<int, 3>>& triangles;
    const std::vector<Point>& x;
    const std::vector<int> species;
    std::vector<int> surfaceOf;
    std::map<std::pair<int, int>, int> apexes;
    std::array<Real, NUM_TERMS> energies = {};
};

/**
 * The energy in extended precision.
 */
inline HelfrichEquations<long double> computeExactly(const Membrane& membrane, const HelfrichParameters& p) {
    std::vector<std::array<long double, 3>> x;
    for (auto& point : membrane.positions)
        x.push_back({point[0], point[1], point[2]});
    return HelfrichEquations<long double>(membrane.triangles, x, p, getSpecies(membrane));
}

/**
 * The forces on some of the vertices, by automatic differentiation in extended precision.
 */
inline std::vector<OpenMM::Vec3> computeForcesExactly(const Membrane& membrane, const HelfrichParameters& p,
                                                      const std::vector<int>& vertices) {
    std::vector<std::array<Dual, 3>> x;
    for (auto& point : membrane.positions)
        x.push_back({Dual(point[0]), Dual(point[1]), Dual(point[2])});
    std::vector<OpenMM::Vec3> forces;
    for (int vertex : vertices) {
        OpenMM::Vec3 force;
        for (int i = 0; i < 3; i++) {
            x[vertex][i].slope = 1;
            force[i] = -HelfrichEquations<Dual>(membrane.triangles, x, p, getSpecies(membrane)).getTotal().slope;
            x[vertex][i].slope = 0;
        }
        forces.push_back(force);
    }
    return forces;
}

} // namespace HelfrichPlugin

#endif /*HELFRICHEQUATIONS_H_*/
