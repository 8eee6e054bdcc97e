#ifndef OPENMM_HELFRICHFORCE_H_
#define OPENMM_HELFRICHFORCE_H_

#include "internal/HelfrichParameters.h"
#include "internal/windowsExportHelfrich.h"
#include "openmm/Context.h"
#include "openmm/Force.h"
#include <array>
#include <string>
#include <vector>

namespace HelfrichPlugin {

/**
 * The geometry of a connected surface.
 */
struct OPENMM_EXPORT_HELFRICH HelfrichSurfaceGeometry {
    HelfrichSurfaceGeometry() = default;
    template <class Real>
    explicit HelfrichSurfaceGeometry(const HelfrichTotalsOf<Real>& totals)
            : area(totals.area), volume(totals.volume), integratedMeanCurvature(totals.curvature) {
    }
    /// total area A, in nm^2
    double area = 0;
    /// enclosed volume V, in nm^3, positive when the triangles are counter-clockwise seen from outside; 0 of a periodic
    /// membrane
    double volume = 0;
    /// integrated mean curvature M, in nm: 4 pi R on a sphere
    double integratedMeanCurvature = 0;
    /// area difference between the leaflets, 2hM, in nm^2
    double areaDifference = 0;
};

/**
 * The geometry of a membrane: the sums over all of its connected surfaces, and each of these.  The arrays of vertices
 * have one element a vertex, in ascending order of the particles' indices.
 */
struct OPENMM_EXPORT_HELFRICH HelfrichGeometry : HelfrichSurfaceGeometry {
    /// each surface, in the order of their first triangles
    std::vector<HelfrichSurfaceGeometry> surfaces;
    /// area of each vertex: a third of that of its triangles, in nm^2; they add up to the total area
    std::vector<double> vertexAreas;
    /// integrated mean curvature of each vertex, in nm; they add up to the integrated mean curvature
    std::vector<double> vertexMeanCurvatures;
    /**
     * Set the sums and the surfaces, but for the area differences, to totals of the surfaces.
     */
    template <class Real>
    void setTotals(const std::vector<HelfrichTotalsOf<Real>>& totals) {
        HelfrichTotalsOf<Real> sum;
        surfaces.clear();
        for (auto& ofSurface : totals) {
            sum += ofSurface;
            surfaces.emplace_back(ofSurface);
        }
        static_cast<HelfrichSurfaceGeometry&>(*this) = HelfrichSurfaceGeometry(sum);
    }
};

/**
 * This class gives closed triangulated surfaces the elastic energy of a fluid lipid membrane (Helfrich, 1973).
 * Each vertex is a particle of the System.  The energy is the sum of eleven terms, each present only when its
 * modulus is not zero.
 *
 * <ul>
 * <li>bending, \f$2\kappa_B\sum_i (\hat M_i-\frac12C_0\hat A_i)^2/\hat A_i\f$, which is
 * \f$\frac{\kappa_B}2\oint(2H-C_0)^2dA\f$ in Juelicher's discretization: a vertex has the mean curvature \f$\hat
 * M_i=\frac14\sum_j l_{ij}\varphi_{ij}\f$ of its edges, of length l and dihedral angle phi, and a third of the area of
 * its triangles (Juelicher, J. Phys. II 6, 1797, 1996)</li> <li>area,
 * \f$\kappa_A(A/A_0-1)^2\f$</li> <li>volume, \f$\kappa_V(V/V_0-1)^2\f$</li> <li>area difference, \f$\kappa_{\Delta
 * A}(\Delta A/\Delta A_0-1)^2\f$, with \f$\Delta A=2h\sum_i\hat M_i\f$</li> <li>tether, \f$\kappa_T\sum_e
 * T(l_e/l_0)\f$, which keeps every edge between a minimum and a maximum length</li> <li>repulsion,
 * \f$\kappa_R\sum_i\sum_{j\ne i} R(r_{ij})\f$, which keeps surfaces from crossing themselves and each other</li>
 * <li>tension, \f$\sigma A\f$, linear, beside the area term or instead of it</li>
 * <li>pressure, \f$-pV\f$, linear, beside the volume term or instead of it</li>
 * <li>gaussian, \f$\sum_i\bar\kappa_i(2\pi-\sum\theta)\f$, with theta the angles of the triangles at the vertex: the
 * integral of \f$\bar\kappa K\f$.  Where the modulus is the same everywhere it is a constant of the topology,
 * \f$4\pi(1-g)\bar\kappa\f$ for a surface of genus g, and there are no forces</li>
 * <li>line, \f$\sum\lambda_{ab}\f$ times the length of the boundary between the species a and b.  In a triangle of
 * the species (a, a, b) the boundary joins the midpoints of its two mixed edges; in one of (a, b, c) it joins all three
 * midpoints to the centroid</li>
 * <li>pair, \f$\sum_e J_{ab}\f$ over the edges, which bond vertices of the species a and b.  There are no forces: it
 * acts on flips and exchanges</li>
 * </ul>
 *
 * The first six are those of Siggel et al., J. Chem. Phys. 157, 174801 (2022).
 *
 * To use it, create a HelfrichForce, add the triangles with addTriangle() or setTriangles(), set the moduli and
 * targets, and add it to a System.  The three targets, the tension, the pressure and the spontaneous curvature are
 * parameters of the Context: change them there with Context::setParameter(), using the names that
 * getTargetAreaParameter() and its siblings return.
 *
 * The triangles may form several connected surfaces, nested or side by side.  They are numbered from 0 in the order of
 * their first triangles.  Area, volume and area difference are held to their targets for each surface by itself:
 * setTargetArea() and its siblings set the target of every surface, or of one.  The moduli are those of all.  Vertices
 * repel each other whichever surface they belong to.  A particle may be a vertex of one HelfrichForce only.
 *
 * The triangles of a Force are those that a new Context starts with.  An EdgeFlipIntegrator, or
 * setTrianglesInContext(), changes those of a Context: getTrianglesInContext() returns the live ones.
 *
 * Curvature is positive where the surface is convex seen from outside: on a sphere of radius R, H = 1/R, and the
 * bending energy is \f$8\pi\kappa_B(1-C_0R/2)^2\f$.  So C_0 is the sum of the principal curvatures that the membrane
 * would like, and kappa_B stands for kappa in \f$\frac\kappa2\oint\f$.  Other programs have other conventions, with H =
 * (c_1+c_2)/2 in all of these.  Where it is \f$\frac\kappa2\oint(2H-c)^2\f$, as in FreeDTS, the modulus is the same and
 * c = C_0; FreeDTS's Gaussian modulus has the other sign.  Where it is \f$2\kappa\oint(H-H_0)^2\f$, as in Mem3DG from
 * version 0.0.7 on, the modulus is the same and H_0 = C_0/2.  Where it is \f$\kappa\oint(H-H_0)^2\f$, as in Surface
 * Evolver and earlier versions of Mem3DG, the modulus is twice as large and H_0 = C_0/2.
 *
 * A membrane of several materials has species, added with addSpecies(), and each vertex has one of them: see
 * setVertexSpecies().  The moduli of bending and of the Gaussian curvature are then those of the species.  There may be
 * as many species as vertices, so that a field that varies along the surface is one species a vertex.
 *
 * Edges that must not flip, those of a frame or a border between two materials for example, are marked with
 * addFixedEdge().
 *
 * A membrane may be periodic: see setUsesPeriodicBoundaryConditions().
 */
class OPENMM_EXPORT_HELFRICH HelfrichForce : public OpenMM::Force {
public:
    /**
     * Create a HelfrichForce with no triangles and every term off.
     */
    HelfrichForce();
    /**
     * Get the number of triangles.
     */
    int getNumTriangles() const {
        return triangles.size();
    }
    /**
     * Add a triangle.  Its particles are in counter-clockwise order, seen from outside.
     *
     * @param particle1  the index of the first particle
     * @param particle2  the index of the second particle
     * @param particle3  the index of the third particle
     * @return the index of the triangle that was added
     */
    int addTriangle(int particle1, int particle2, int particle3);
    /**
     * Get the particles of a triangle.
     *
     * @param index           the index of the triangle
     * @param[out] particle1  the index of the first particle
     * @param[out] particle2  the index of the second particle
     * @param[out] particle3  the index of the third particle
     */
    void getTriangleParameters(int index, int& particle1, int& particle2, int& particle3) const;
    /**
     * Set the particles of a triangle.  A Context that exists already does not change.
     *
     * @param index      the index of the triangle
     * @param particle1  the index of the first particle
     * @param particle2  the index of the second particle
     * @param particle3  the index of the third particle
     */
    void setTriangleParameters(int index, int particle1, int particle2, int particle3);
    /**
     * Get all triangles.
     */
    const std::vector<std::array<int, 3>>& getTriangles() const {
        return triangles;
    }
    /**
     * Replace all triangles.
     *
     * @param triangles  the particles of each triangle, in counter-clockwise order seen from outside
     */
    void setTriangles(const std::vector<std::array<int, 3>>& triangles);
    /**
     * Get the number of edges that never flip.
     */
    int getNumFixedEdges() const {
        return fixedEdges.size();
    }
    /**
     * Mark an edge that never flips: attempts to flip it are rejected by rule.  It must be an edge of the triangles
     * when a Context is created, and of those given to setTrianglesInContext(), and may be marked once.
     *
     * @param particle1  the index of one of its particles
     * @param particle2  the index of the other
     * @return the index of the fixed edge that was added
     */
    int addFixedEdge(int particle1, int particle2);
    /**
     * Get the particles of an edge that never flips.
     *
     * @param index           the index of the fixed edge
     * @param[out] particle1  the index of one of its particles
     * @param[out] particle2  the index of the other
     */
    void getFixedEdgeParameters(int index, int& particle1, int& particle2) const;
    /**
     * Set the particles of an edge that never flips.  A Context that exists already does not change.
     *
     * @param index      the index of the fixed edge
     * @param particle1  the index of one of its particles
     * @param particle2  the index of the other
     */
    void setFixedEdgeParameters(int index, int particle1, int particle2);
    /**
     * Get the number of species.
     */
    int getNumSpecies() const {
        return parameters.species ? parameters.species->getNumSpecies() : 0;
    }
    /**
     * Add a species of vertices.  Where there are species, their moduli take the place of those of setBendingModulus()
     * and setGaussianModulus(), which throw an exception from then on.
     *
     * @param bendingModulus        kappa in kappa/2 times the integral of (2H-C_0)^2, measured in kJ/mol
     * @param spontaneousCurvature  C_0, measured in 1/nm, positive where the membrane would be convex seen from
     * outside; setSpontaneousCurvature() adds to it
     * @param gaussianModulus       kappa-bar in kappa-bar times the integral of K, measured in kJ/mol
     * @return the number of the species: they are numbered from 0
     */
    int addSpecies(double bendingModulus, double spontaneousCurvature, double gaussianModulus = 0);
    /**
     * Get the moduli of a species.
     *
     * @param index                      the number of the species
     * @param[out] bendingModulus        kappa, measured in kJ/mol
     * @param[out] spontaneousCurvature  C_0, measured in 1/nm
     * @param[out] gaussianModulus       kappa-bar, measured in kJ/mol
     */
    void getSpeciesParameters(int index, double& bendingModulus, double& spontaneousCurvature,
                              double& gaussianModulus) const;
    /**
     * Set the moduli of a species.  See addSpecies().
     *
     * @param index                 the number of the species
     * @param bendingModulus        kappa, measured in kJ/mol
     * @param spontaneousCurvature  C_0, measured in 1/nm
     * @param gaussianModulus       kappa-bar, measured in kJ/mol
     */
    void setSpeciesParameters(int index, double bendingModulus, double spontaneousCurvature,
                              double gaussianModulus = 0);
    /**
     * Get the species that the vertices of a new Context have; none if they were not set.
     */
    const std::vector<int>& getVertexSpecies() const {
        return vertexSpecies;
    }
    /**
     * Set the species that the vertices of a new Context have.  Without it all are of species 0.
     *
     * @param species  the number of the species of each vertex, in ascending order of the particles' indices
     */
    void setVertexSpecies(const std::vector<int>& species);
    /**
     * Get the line tension between two species, measured in kJ/mol/nm.
     *
     * @param species1  the number of one of them
     * @param species2  the number of the other
     */
    double getLineTension(int species1, int species2) const;
    /**
     * Set the line tension between two species, measured in kJ/mol/nm: the energy of their boundary by its length.
     * Where it is positive, boundaries shrink.  The default is 0.
     *
     * @param species1     the number of one of them
     * @param species2     the number of another
     * @param lineTension  the line tension
     */
    void setLineTension(int species1, int species2, double lineTension);
    /**
     * Get the energy of an edge between vertices of two species, measured in kJ/mol.
     *
     * @param species1  the number of one of them
     * @param species2  the number of the other, or the same
     */
    double getPairEnergy(int species1, int species2) const;
    /**
     * Set the energy J of an edge between vertices of two species, measured in kJ/mol.  The default is 0.
     *
     * @param species1  the number of one of them
     * @param species2  the number of the other, or the same
     * @param energy    the energy; negative where the two would be neighbors
     */
    void setPairEnergy(int species1, int species2, double energy);
    /**
     * Get the bending modulus kappa_B, measured in kJ/mol: of several species, the greatest.
     */
    double getBendingModulus() const {
        return parameters.moduli[Term::Bending];
    }
    /**
     * Set the bending modulus kappa_B, measured in kJ/mol: kappa in kappa/2 times the integral of (2H-C_0)^2.  The
     * default, 0, turns the term off.  Where there are species, each has its own: see addSpecies().
     */
    void setBendingModulus(double modulus);
    /**
     * Get the spontaneous curvature C_0, measured in 1/nm.
     */
    double getSpontaneousCurvature() const {
        return parameters.spontaneousCurvature;
    }
    /**
     * Set the spontaneous curvature C_0, measured in 1/nm: the default value of the Context's parameter.  It is the sum
     * of the principal curvatures for which the membrane has no bending energy, positive where that is convex seen from
     * outside.  Where there are species, it is added to that of each.
     */
    void setSpontaneousCurvature(double spontaneousCurvature);
    /**
     * Get the Gaussian modulus kappa-bar, measured in kJ/mol: of several species, that which is greatest in size.
     */
    double getGaussianModulus() const {
        return parameters.moduli[Term::Gaussian];
    }
    /**
     * Set the Gaussian modulus kappa-bar, measured in kJ/mol: kappa-bar in kappa-bar times the integral of K.  The same
     * everywhere, it adds a constant of the topology to the energy, 4 pi (1-g) kappa-bar for a surface of genus g.  The
     * default, 0, turns the term off.  Where there are species, each has its own: see addSpecies().
     */
    void setGaussianModulus(double modulus);
    /**
     * Get the modulus kappa_A of the area term, measured in kJ/mol.
     */
    double getAreaModulus() const {
        return parameters.moduli[Term::Area];
    }
    /**
     * Set the modulus kappa_A of the area term, measured in kJ/mol.  The default, 0, turns the term off.
     */
    void setAreaModulus(double modulus);
    /**
     * Get the target area A_0, measured in nm^2.
     *
     * @param surface  the number of the surface; -1 for all surfaces without a target of their own
     */
    double getTargetArea(int surface = -1) const;
    /**
     * Set the target area A_0, measured in nm^2: the default value of the Context's parameter.
     *
     * @param area     the target of each surface by itself
     * @param surface  the number of the surface to have it; -1 for all, whatever they had before
     */
    void setTargetArea(double area, int surface = -1);
    /**
     * Get the modulus kappa_V of the volume term, measured in kJ/mol.
     */
    double getVolumeModulus() const {
        return parameters.moduli[Term::Volume];
    }
    /**
     * Set the modulus kappa_V of the volume term, measured in kJ/mol.  The default, 0, turns the term off.
     */
    void setVolumeModulus(double modulus);
    /**
     * Get the target volume V_0, measured in nm^3.
     *
     * @param surface  the number of the surface; -1 for all surfaces without a target of their own
     */
    double getTargetVolume(int surface = -1) const;
    /**
     * Set the target volume V_0, measured in nm^3: the default value of the Context's parameter.
     *
     * @param volume   the target of each surface by itself
     * @param surface  the number of the surface to have it; -1 for all, whatever they had before
     */
    void setTargetVolume(double volume, int surface = -1);
    /**
     * Get the modulus kappa_dA of the area difference term, measured in kJ/mol.
     */
    double getAreaDifferenceModulus() const {
        return parameters.moduli[Term::AreaDifference];
    }
    /**
     * Set the modulus kappa_dA of the area difference term, measured in kJ/mol.  The default, 0, turns the term off.
     */
    void setAreaDifferenceModulus(double modulus);
    /**
     * Get the target area difference dA_0, measured in nm^2.
     *
     * @param surface  the number of the surface; -1 for all surfaces without a target of their own
     */
    double getTargetAreaDifference(int surface = -1) const;
    /**
     * Set the target area difference dA_0, measured in nm^2: the default value of the Context's parameter.
     *
     * @param areaDifference  the target of each surface by itself
     * @param surface         the number of the surface to have it; -1 for all, whatever they had before
     */
    void setTargetAreaDifference(double areaDifference, int surface = -1);
    /**
     * Get the distance h between the neutral surfaces of the two leaflets, measured in nm.
     */
    double getLeafletSeparation() const {
        return parameters.leafletSeparation;
    }
    /**
     * Set the distance h between the neutral surfaces of the two leaflets, measured in nm.  The default is 1 nm.
     */
    void setLeafletSeparation(double separation);
    /**
     * Get the parameters of the tether term.
     *
     * @param[out] modulus    the modulus kappa_T, measured in kJ/mol
     * @param[out] minLength  the length l_c1, measured in nm, below which an edge is pushed apart
     * @param[out] maxLength  the length l_c0, measured in nm, above which an edge is pulled together
     * @param[out] exponent   the exponent r
     */
    void getTether(double& modulus, double& minLength, double& maxLength, int& exponent) const;
    /**
     * Set the parameters of the tether term: \f$T(l)=\exp(l/(l-l_{c1}))\,l^{-r}\f$ for \f$l\le l_{c1}\f$,
     * \f$r^{r+1}(l-l_{c0})^r\f$ for \f$l\ge l_{c0}\f$, and 0 between, where lengths are in units of that of
     * setTetherLengthScale(). By default the term is off.
     *
     * @param modulus    the modulus kappa_T, measured in kJ/mol; 0 turns the term off
     * @param minLength  the length l_c1, measured in nm, below which an edge is pushed apart
     * @param maxLength  the length l_c0, measured in nm, above which an edge is pulled together
     * @param exponent   the exponent r, from 1 to 100
     */
    void setTether(double modulus, double minLength, double maxLength, int exponent);
    /**
     * Get the unit l_0 of the lengths in the tether term, measured in nm.
     */
    double getTetherLengthScale() const {
        return parameters.tetherLengthScale;
    }
    /**
     * Set the unit l_0 of the lengths in the tether term, measured in nm.  One modulus multiplies a wall that goes as
     * \f$l^{-r}\f$ and a spring that goes as \f$l^r\f$: l_0 sets which of them is the harder.  With the mean length of
     * the edges, a tether is the same whatever the unit of a mesh; with the default of 1 nm, lengths are in nm.
     */
    void setTetherLengthScale(double length);
    /**
     * Get the parameters of the repulsion term.
     *
     * @param[out] modulus         the modulus kappa_R, measured in kJ/mol
     * @param[out] onset           the distance, measured in nm, below which two vertices repel each other
     * @param[out] exponent        the exponent r
     * @param[out] exclusionLevel  0, 1 or 2
     */
    void getRepulsion(double& modulus, double& onset, int& exponent, int& exclusionLevel) const;
    /**
     * Set the parameters of the repulsion term: \f$R(r)=\exp(r/(r-r_o))\,r^{-n}\f$ below the onset \f$r_o\f$ and 0
     * above it, where lengths are in units of that of setRepulsionLengthScale(). The sum runs over both orders of a
     * pair.  By default the term is off.
     *
     * @param modulus         the modulus kappa_R, measured in kJ/mol; 0 turns the term off
     * @param onset           the distance, measured in nm, below which two vertices repel each other
     * @param exponent        the exponent n, from 1 to 100
     * @param exclusionLevel  which pairs the sum leaves out, by the live connectivity: none (0), bonded vertices (1),
     * or bonded vertices and those that share a bonded vertex (2)
     */
    void setRepulsion(double modulus, double onset, int exponent, int exclusionLevel = 1);
    /**
     * Get the unit of the lengths in the repulsion term, measured in nm.
     */
    double getRepulsionLengthScale() const {
        return parameters.repulsionLengthScale;
    }
    /**
     * Set the unit of the lengths in the repulsion term, measured in nm.  With the mean length of the edges, a
     * repulsion is the same whatever the unit of a mesh; with the default of 1 nm, lengths are in nm.
     */
    void setRepulsionLengthScale(double length);
    /**
     * Get the tension sigma, measured in kJ/mol/nm^2.
     */
    double getTension() const {
        return parameters.moduli[Term::Tension];
    }
    /**
     * Set the tension sigma, measured in kJ/mol/nm^2: the default value of the Context's parameter.  The surface
     * shrinks where it is positive, and grows where it is negative.  The default, 0, turns the term off.
     */
    void setTension(double tension);
    /**
     * Get the pressure p, measured in kJ/mol/nm^3.
     */
    double getPressure() const {
        return parameters.moduli[Term::Pressure];
    }
    /**
     * Set the pressure p, measured in kJ/mol/nm^3, by which that inside the surface exceeds that outside: the default
     * value of the Context's parameter.  It blows the surface up where it is positive, and presses it together where
     * it is negative.  The default, 0, turns the term off.
     */
    void setPressure(double pressure);
    /**
     * Get the name of the Context parameter that holds the target area: the Force's name followed by "TargetArea", and
     * by the number of the surface if that has a target of its own.
     *
     * @param surface  the number of the surface; -1 for all surfaces without a target of their own
     */
    std::string getTargetAreaParameter(int surface = -1) const;
    /**
     * Get the name of the Context parameter that holds the target volume: the Force's name followed by "TargetVolume",
     * and by the number of the surface if that has a target of its own.
     *
     * @param surface  the number of the surface; -1 for all surfaces without a target of their own
     */
    std::string getTargetVolumeParameter(int surface = -1) const;
    /**
     * Get the name of the Context parameter that holds the target area difference: the Force's name followed by
     * "TargetAreaDifference", and by the number of the surface if that has a target of its own.
     *
     * @param surface  the number of the surface; -1 for all surfaces without a target of their own
     */
    std::string getTargetAreaDifferenceParameter(int surface = -1) const;
    /**
     * Get the name of the Context parameter that holds the tension: the Force's name followed by "Tension".  It turns
     * the term on and off in that Context: it may be any finite number, also where this Force has none.
     */
    std::string getTensionParameter() const;
    /**
     * Get the name of the Context parameter that holds the pressure: the Force's name followed by "Pressure".  It turns
     * the term on and off in that Context: it may be any finite number, also where this Force has none.
     */
    std::string getPressureParameter() const;
    /**
     * Get the name of the Context parameter that holds the spontaneous curvature: the Force's name followed by
     * "SpontaneousCurvature".  It may be any finite number.
     */
    std::string getSpontaneousCurvatureParameter() const;
    /**
     * Get the number of connected surfaces, which flips do not change.
     *
     * @param context  the Context to query
     */
    int getNumSurfacesInContext(OpenMM::Context& context) const;
    /**
     * Get the live triangles of a Context, which edge flips change.
     *
     * @param context         the Context to query
     * @param[out] triangles  the particles of each triangle
     */
    void getTrianglesInContext(OpenMM::Context& context, std::vector<std::array<int, 3>>& triangles) const;
    /**
     * Replace the live triangles of a Context.  They must connect the same particles as before to the same surfaces, in
     * the same order, and have every fixed edge.
     *
     * @param context    the Context to change
     * @param triangles  the particles of each triangle
     */
    void setTrianglesInContext(OpenMM::Context& context, const std::vector<std::array<int, 3>>& triangles) const;
    /**
     * Get the live species of the vertices of a Context, which exchanges change.
     *
     * @param context       the Context to query
     * @param[out] species  the number of the species of each vertex, in ascending order of the particles' indices; none
     * if this Force had no species when the Context was created
     */
    void getVertexSpeciesInContext(OpenMM::Context& context, std::vector<int>& species) const;
    /**
     * Set the live species of the vertices of a Context.  This Force must have had species when it was created.
     *
     * @param context  the Context to change
     * @param species  the number of the species of each vertex, in ascending order of the particles' indices
     */
    void setVertexSpeciesInContext(OpenMM::Context& context, const std::vector<int>& species) const;
    /**
     * Get all moduli and other parameters, with the default values of those that a Context has.
     */
    const HelfrichParameters& getParameters() const {
        return parameters;
    }
    /**
     * Get the names of the terms of the energy, in the order in which they are added up.
     */
    static std::vector<std::string> getTermNames();
    /**
     * Get whether a term is on: whether its modulus in this Force is not zero.  One that is a parameter of the Context
     * may have another value there.
     *
     * @param name  one of the names that getTermNames() returns
     */
    bool hasTerm(const std::string& name) const;
    /**
     * Compute the energy of each term for the present positions of a Context.
     *
     * @param context  the Context to query
     */
    HelfrichEnergyTerms getEnergyTermsInContext(OpenMM::Context& context) const;
    /**
     * Compute the geometry of the membrane for the present positions of a Context.
     *
     * @param context  the Context to query
     */
    HelfrichGeometry getGeometryInContext(OpenMM::Context& context) const;
    /**
     * Copy the moduli, those of species and between them included, the leaflet separation, and the tether's and
     * repulsion's parameters, with their length scales, from this Force to a Context. The triangles, the species of the
     * vertices, the fixed edges and the parameters of the Context, which are the targets, the tension, the pressure and
     * the spontaneous curvature, do not change: see setTrianglesInContext(), setVertexSpeciesInContext() and
     * Context::setParameter().
     *
     * @param context  the Context to change
     */
    void updateParametersInContext(OpenMM::Context& context);
    /**
     * Get whether the membrane is periodic, as a sheet is.
     */
    bool usesPeriodicBoundaryConditions() const {
        return periodic;
    }
    /**
     * Set whether the membrane is periodic: whether vertices interact with the nearest image of each other in the
     * Context's periodic box, which must be rectangular, with sides at least twice as long as any edge.  A sheet
     * without borders goes on across the box, and is a torus for the connectivity.  It encloses no volume: volume and
     * pressure must be off, and the geometry's volume is 0.  Its outside is where its triangles are counter-clockwise.
     * The default is false.
     *
     * @param periodic  whether it is periodic, in Contexts created from now on
     */
    void setUsesPeriodicBoundaryConditions(bool periodic) {
        this->periodic = periodic;
    }
protected:
    OpenMM::ForceImpl* createImpl() const;
private:
    void setTarget(const char* method, Term term, double& targetOfAll, double value, int surface);
    double getTarget(const char* method, Term term, int surface) const;
    std::vector<std::array<int, 3>> triangles;
    HelfrichSpeciesTable& changeSpecies();
    void takeModuliOfSpecies();
    void requireOneMaterial(const char* method) const;
    void checkSpeciesPair(const char* method, int species1, int species2) const;
    std::vector<std::array<int, 2>> fixedEdges;
    std::vector<int> vertexSpecies;
    HelfrichParameters parameters;
    bool periodic = false;
};

} // namespace HelfrichPlugin

#endif /*OPENMM_HELFRICHFORCE_H_*/
