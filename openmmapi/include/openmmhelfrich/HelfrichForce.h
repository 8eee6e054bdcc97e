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
 * The geometry of a membrane.  The arrays have one element a vertex, in ascending order of the particles'
 * indices.
 */
struct OPENMM_EXPORT_HELFRICH HelfrichGeometry {
    /// total area A, in nm^2
    double area = 0;
    /// enclosed volume V, in nm^3, positive when the triangles are counter-clockwise seen from outside
    double volume = 0;
    /// integrated mean curvature M, in nm: 4 pi R on a sphere
    double integratedMeanCurvature = 0;
    /// area difference between the leaflets, 2hM, in nm^2
    double areaDifference = 0;
    /// area of each vertex: a third of that of its triangles, in nm^2; they add up to the total area
    std::vector<double> vertexAreas;
    /// integrated mean curvature of each vertex, in nm; they add up to the integrated mean curvature
    std::vector<double> vertexMeanCurvatures;
};

/**
 * This class gives a closed triangulated surface the elastic energy of a fluid lipid membrane (Helfrich, 1973).
 * Each vertex is a particle of the System.  The energy is the sum of eight terms, each present only when its modulus
 * is not zero.
 *
 * <ul>
 * <li>bending, \f$2\kappa_B\sum_i \hat M_i^2/\hat A_i\f$, in Juelicher's discretization: a vertex has the
 * mean curvature \f$\hat M_i=\frac14\sum_j l_{ij}\varphi_{ij}\f$ of its edges, of length l and dihedral angle phi, and
 * a third of the area of its triangles (Juelicher, J. Phys. II 6, 1797, 1996)</li> <li>area,
 * \f$\kappa_A(A/A_0-1)^2\f$</li> <li>volume, \f$\kappa_V(V/V_0-1)^2\f$</li> <li>area difference, \f$\kappa_{\Delta
 * A}(\Delta A/\Delta A_0-1)^2\f$, with \f$\Delta A=2h\sum_i\hat M_i\f$</li> <li>tether, \f$\kappa_T\sum_e
 * T(l_e/l_0)\f$, which keeps every edge between a minimum and a maximum length</li> <li>repulsion,
 * \f$\kappa_R\sum_i\sum_{j\ne i} R(r_{ij})\f$, which keeps the surface from crossing itself</li>
 * <li>tension, \f$\sigma A\f$, linear, beside the area term or instead of it</li>
 * <li>pressure, \f$-pV\f$, linear, beside the volume term or instead of it</li>
 * </ul>
 *
 * The first six are those of Siggel et al., J. Chem. Phys. 157, 174801 (2022).
 *
 * To use it, create a HelfrichForce, add the triangles with addTriangle() or setTriangles(), set the moduli and
 * targets, and add it to a System.  The three targets, the tension and the pressure are parameters of the Context:
 * change them there with Context::setParameter(), using the names that getTargetAreaParameter() and its siblings
 * return.
 *
 * The triangles of a Force are those that a new Context starts with.  An EdgeFlipIntegrator, or
 * setTrianglesInContext(), changes those of a Context: getTrianglesInContext() returns the live ones.
 *
 * Edges that must not flip, those of a frame or a border between two materials for example, are marked with
 * addFixedEdge().
 *
 * The System's periodic boundary conditions do not apply to this force.
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
     * Get the bending modulus kappa_B, measured in kJ/mol.
     */
    double getBendingModulus() const {
        return parameters.moduli[Term::Bending];
    }
    /**
     * Set the bending modulus kappa_B, measured in kJ/mol.  The default, 0, turns the term off.
     */
    void setBendingModulus(double modulus);
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
     */
    double getTargetArea() const {
        return parameters.targetArea;
    }
    /**
     * Set the target area A_0, measured in nm^2: the default value of the Context's parameter.
     */
    void setTargetArea(double area);
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
     */
    double getTargetVolume() const {
        return parameters.targetVolume;
    }
    /**
     * Set the target volume V_0, measured in nm^3: the default value of the Context's parameter.
     */
    void setTargetVolume(double volume);
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
     */
    double getTargetAreaDifference() const {
        return parameters.targetAreaDifference;
    }
    /**
     * Set the target area difference dA_0, measured in nm^2: the default value of the Context's parameter.
     */
    void setTargetAreaDifference(double areaDifference);
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
     * above it. The sum runs over both orders of a pair.  By default the term is off.
     *
     * @param modulus         the modulus kappa_R, measured in kJ/mol; 0 turns the term off
     * @param onset           the distance, measured in nm, below which two vertices repel each other
     * @param exponent        the exponent n, from 1 to 100
     * @param exclusionLevel  which pairs the sum leaves out, by the live connectivity: none (0), bonded vertices (1),
     * or bonded vertices and those that share a bonded vertex (2)
     */
    void setRepulsion(double modulus, double onset, int exponent, int exclusionLevel = 1);
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
     * Get the name of the Context parameter that holds the target area: the Force's name followed by "TargetArea".
     */
    std::string getTargetAreaParameter() const;
    /**
     * Get the name of the Context parameter that holds the target volume: the Force's name followed by "TargetVolume".
     */
    std::string getTargetVolumeParameter() const;
    /**
     * Get the name of the Context parameter that holds the target area difference: the Force's name followed by
     * "TargetAreaDifference".
     */
    std::string getTargetAreaDifferenceParameter() const;
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
     * Get the live triangles of a Context, which edge flips change.
     *
     * @param context         the Context to query
     * @param[out] triangles  the particles of each triangle
     */
    void getTrianglesInContext(OpenMM::Context& context, std::vector<std::array<int, 3>>& triangles) const;
    /**
     * Replace the live triangles of a Context.  They must connect the same particles as before, and have every fixed
     * edge.
     *
     * @param context    the Context to change
     * @param triangles  the particles of each triangle
     */
    void setTrianglesInContext(OpenMM::Context& context, const std::vector<std::array<int, 3>>& triangles) const;
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
     * Copy the moduli, the leaflet separation, and the tether's (its length scale too) and repulsion's parameters from
     * this Force to a Context. The triangles, the fixed edges and the parameters of the Context, which are the targets,
     * the tension and the pressure, do not change: see setTrianglesInContext() and Context::setParameter().
     *
     * @param context  the Context to change
     */
    void updateParametersInContext(OpenMM::Context& context);
    /**
     * A membrane is never periodic: this returns false.
     */
    bool usesPeriodicBoundaryConditions() const {
        return false;
    }
protected:
    OpenMM::ForceImpl* createImpl() const;
private:
    std::vector<std::array<int, 3>> triangles;
    std::vector<std::array<int, 2>> fixedEdges;
    HelfrichParameters parameters;
};

} // namespace HelfrichPlugin

#endif /*OPENMM_HELFRICHFORCE_H_*/
