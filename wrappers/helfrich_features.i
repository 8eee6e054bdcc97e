// How methods appear in Python: exceptions, the interpreter's lock, units, ownership, and documentation where it
// differs from that in C++.

%ignore HelfrichPlugin::HelfrichForce::getParameters;
%ignore HelfrichPlugin::HelfrichGeometry;
%ignore HelfrichPlugin::HelfrichSurfaceGeometry;

%fragment("HelfrichExceptions", "header") {
static void setOpenMMException(const char* message) {
    if (PyErr_Occurred())
        return; // a listener's, or a signal's
    PyObject* type = PyObject_GetAttrString(PyImport_AddModule("openmm"), "OpenMMException");
    if (type != NULL)
        PyErr_SetString(type, message);
    Py_XDECREF(type);
}

/**
 * Lets other Python threads run for as long as it exists.
 */
class GilRelease {
public:
    GilRelease() : state(PyEval_SaveThread()) {
    }
    ~GilRelease() {
        PyEval_RestoreThread(state);
    }
private:
    PyThreadState* state;
};
}
%fragment("HelfrichExceptions");

%exception {
    try {
        $action
    }
    catch (std::exception& e) {
        setOpenMMException(e.what());
        SWIG_fail;
    }
}

%define HELFRICH_LONG_CALL(method)
%exception method {
    try {
        GilRelease release;
        $action
    }
    catch (std::exception& e) {
        setOpenMMException(e.what());
        SWIG_fail;
    }
}
%enddef
HELFRICH_LONG_CALL(*::step)
HELFRICH_LONG_CALL(*::getEnergyTermsInContext)
HELFRICH_LONG_CALL(*::getGeometryInContext)
HELFRICH_LONG_CALL(*::setTrianglesInContext)
HELFRICH_LONG_CALL(*::setVertexSpeciesInContext)

// What an argument is called says what dimension it has, and what is got by a method has that of an argument.
%define HELFRICH_UNIT(method, argument)
%pythonappend HelfrichPlugin::method %{
        val = unit.Quantity(val, _UNITS["argument"])
%}
%enddef
HELFRICH_UNIT(HelfrichForce::getBendingModulus, modulus)
HELFRICH_UNIT(HelfrichForce::getAreaModulus, modulus)
HELFRICH_UNIT(HelfrichForce::getTargetArea, area)
HELFRICH_UNIT(HelfrichForce::getVolumeModulus, modulus)
HELFRICH_UNIT(HelfrichForce::getTargetVolume, volume)
HELFRICH_UNIT(HelfrichForce::getAreaDifferenceModulus, modulus)
HELFRICH_UNIT(HelfrichForce::getTargetAreaDifference, areaDifference)
HELFRICH_UNIT(HelfrichForce::getLeafletSeparation, separation)
HELFRICH_UNIT(HelfrichForce::getTetherLengthScale, length)
HELFRICH_UNIT(HelfrichForce::getRepulsionLengthScale, length)
HELFRICH_UNIT(HelfrichForce::getTension, tension)
HELFRICH_UNIT(HelfrichForce::getPressure, pressure)
HELFRICH_UNIT(HelfrichForce::getSpontaneousCurvature, spontaneousCurvature)
HELFRICH_UNIT(HelfrichForce::getGaussianModulus, modulus)
HELFRICH_UNIT(HelfrichForce::getLineTension, lineTension)
HELFRICH_UNIT(HelfrichForce::getPairEnergy, energy)
HELFRICH_UNIT(MonteCarloMove::getTemperature, temperature)
HELFRICH_UNIT(HamiltonianTrajectoryIntegrator::getLastEnergyChange, modulus)
HELFRICH_UNIT(ShearWaveIntegrator::getAmplitude, amplitude)
HELFRICH_UNIT(ShearWaveIntegrator::getMinWaveNumber, minWaveNumber)
HELFRICH_UNIT(ShearWaveIntegrator::getMaxWaveNumber, maxWaveNumber)
HELFRICH_UNIT(SpeciesExchangeIntegrator::getChemicalPotential, chemicalPotential)
HELFRICH_UNIT(HybridMonteCarloIntegrator::getStepSize, stepSize)
%ignore HelfrichPlugin::SpeciesExchangeIntegrator::getChemicalPotentials;

%pythonappend HelfrichPlugin::HelfrichForce::getTether %{
        val[:3] = map(unit.Quantity, val[:3], (_UNITS[name] for name in ("modulus", "minLength", "maxLength")))
%}
%pythonappend HelfrichPlugin::HelfrichForce::getRepulsion %{
        val[:2] = map(unit.Quantity, val[:2], (_UNITS[name] for name in ("modulus", "onset")))
%}
%pythonappend HelfrichPlugin::HelfrichForce::getSpeciesParameters %{
        names = ("bendingModulus", "spontaneousCurvature", "gaussianModulus")
        val[:] = map(unit.Quantity, val, (_UNITS[name] for name in names))
%}
%pythonappend HelfrichPlugin::HelfrichForce::getEnergyTermsInContext %{
        val = {term: unit.Quantity(energy, unit.kilojoule_per_mole) for term, energy in val.items()}
%}
%pythonappend HelfrichPlugin::HelfrichForce::getGeometryInContext %{
        val = HelfrichGeometry._fromNumbers(*val)
%}

// The documentation comes from the headers, by SWIG's option -doxygen: this replaces what is different in Python, and
// formulas, which it garbles.
%typemap(doctype) OpenMM::Context& "openmm.Context"
%typemap(doctype) const std::vector<std::array<int, 3> >& "array of integers, shape (T, 3)"
%typemap(doctype) const std::vector<int>& "array of integers, shape (N,)"
%feature("docstring") HelfrichPlugin::HelfrichForce "
This class gives closed triangulated surfaces the elastic energy of a fluid lipid membrane (Helfrich, 1973).
Each vertex is a particle of the System.  The energy is the sum of eleven terms, each present only when its
modulus is not zero:

 - bending, 2 kappa_B sum_i (M_i-C_0 A_i/2)^2/A_i, which is kappa_B/2 times the integral of (2H-C_0)^2 in
   Juelicher's discretization: a vertex has the mean curvature M_i = 1/4 sum_j l_ij phi_ij of its edges, of length l
   and dihedral angle phi, and as A_i a third of the area of its triangles (Juelicher, J. Phys. II 6, 1797, 1996)
 - area, kappa_A (A/A_0-1)^2
 - volume, kappa_V (V/V_0-1)^2
 - area difference, kappa_dA (dA/dA_0-1)^2, with dA = 2h sum_i M_i
 - tether, kappa_T sum_e T(l_e/l_0), which keeps every edge between a minimum and a maximum length: see setTether()
 - repulsion, kappa_R sum_i sum_j R(r_ij), which keeps surfaces from crossing themselves and each
   other: see setRepulsion()
 - tension, sigma A, linear, beside the area term or instead of it
 - pressure, -pV, linear, beside the volume term or instead of it
 - gaussian, sum_i kappabar_i (2 pi - sum theta), with theta the angles of the triangles at the vertex: the integral of
   kappabar K.  Where the modulus is the same everywhere it is a constant of the topology, 4 pi (1-g) kappabar for a
   surface of genus g, and there are no forces
 - line, lambda_ab times the length of the boundary between the species a and b, summed over them.  In a triangle of
   the species (a, a, b) the boundary joins the midpoints of its two mixed edges; in one of (a, b, c) it joins all
   three midpoints to the centroid
 - pair, J_ab summed over the edges, which bond vertices of the species a and b.  There are no forces: it acts on flips
   and exchanges

The first six are those of Siggel et al., J. Chem. Phys. 157, 174801 (2022).

To use it, create a HelfrichForce, add the triangles with addTriangle() or setTriangles(), set the moduli and targets,
and add it to a System.  The three targets, the tension, the pressure and the spontaneous curvature are parameters of
the Context: change them there with Context.setParameter(), using the names that getTargetAreaParameter() and its
siblings return.

The triangles may form several connected surfaces, nested or side by side.  They are numbered from 0 in the order of
their first triangles.  Area, volume and area difference are held to their targets for each surface by itself:
setTargetArea() and its siblings set the target of every surface, or of one.  The moduli are those of all.  Vertices
repel each other whichever surface they belong to.  A particle may be a vertex of one HelfrichForce only.

The triangles of a Force are those that a new Context starts with.  An EdgeFlipIntegrator, or setTrianglesInContext(),
changes those of a Context: getTrianglesInContext() returns the live ones.

Curvature is positive where the surface is convex seen from outside: on a sphere of radius R, H = 1/R, and the bending
energy is 8 pi kappa_B (1-C_0 R/2)^2.  So C_0 is the sum of the principal curvatures that the membrane would like, and
kappa_B stands for kappa in kappa/2 times the integral.  Other programs have other conventions, with H = (c_1+c_2)/2 in
all of these.  Where it is kappa/2 times the integral of (2H-c)^2, as in FreeDTS, the modulus is the same and c = C_0;
FreeDTS's Gaussian modulus has the other sign.  Where it is 2 kappa times that of (H-H_0)^2, the modulus is the same and
H_0 = C_0/2.  Where it is kappa times that of (H-H_0)^2, as in Mem3DG and Surface Evolver, the modulus is twice as large
and H_0 = C_0/2.

A membrane of several materials has species, added with addSpecies(), and each vertex has one of them: see
setVertexSpecies().  The moduli of bending and of the Gaussian curvature are then those of the species.  There may be as
many species as vertices, so that a field that varies along the surface is one species a vertex.

Edges that must not flip, those of a frame or a border between two materials for example, are marked with
addFixedEdge().

The System's periodic boundary conditions do not apply to this force.

Arguments are numbers in nm, kJ/mol and the units that these make up, or Quantities.
";
%feature("docstring") HelfrichPlugin::HelfrichForce::setTether "
Set the parameters of the tether term: T(l) = exp(l/(l-l_c1)) l^(-r) for l <= l_c1, r^(r+1) (l-l_c0)^r for l >= l_c0,
and 0 between, where lengths are in units of that of setTetherLengthScale().  By default the term is off.

:type modulus: float
:param modulus: the modulus kappa_T, measured in kJ/mol; 0 turns the term off
:type minLength: float
:param minLength: the length l_c1, measured in nm, below which an edge is pushed apart
:type maxLength: float
:param maxLength: the length l_c0, measured in nm, above which an edge is pulled together
:type exponent: int
:param exponent: the exponent r, at least 1
";
%feature("docstring") HelfrichPlugin::HelfrichForce::setTetherLengthScale "
Set the unit l_0 of the lengths in the tether term, measured in nm.  One modulus multiplies a wall that goes as l^(-r)
and a spring that goes as l^r: l_0 sets which of them is the harder.  With the mean length of the edges, a tether is the
same whatever the unit of a mesh; with the default of 1 nm, lengths are in nm.

:type length: float
:param length: the unit of length l_0, measured in nm
";
%feature("docstring") HelfrichPlugin::HelfrichForce::setRepulsion "
Set the parameters of the repulsion term: R(r) = exp(r/(r-onset)) r^(-n) below the onset and 0 above it,
where lengths are in units of that of setRepulsionLengthScale().  The sum runs over both orders of a pair.  By default
the term is off.

:type modulus: float
:param modulus: the modulus kappa_R, measured in kJ/mol; 0 turns the term off
:type onset: float
:param onset: the distance, measured in nm, below which two vertices repel each other
:type exponent: int
:param exponent: the exponent n, at least 1
:type exclusionLevel: int, optional
:param exclusionLevel: which pairs the sum leaves out, by the live connectivity: none (0), bonded vertices (1, the
    default), or bonded vertices and those that share a bonded vertex (2)
";
%feature("docstring") HelfrichPlugin::HelfrichForce::setRepulsionLengthScale "
Set the unit of the lengths in the repulsion term, measured in nm.  With the mean length of the edges, a repulsion is
the same whatever the unit of a mesh; with the default of 1 nm, lengths are in nm.

:type length: float
:param length: the unit of length, measured in nm
";
%feature("docstring") HelfrichPlugin::HelfrichForce::getTriangleParameters "
Get the particles of a triangle.

:type index: int
:param index: the index of the triangle
:rtype: list
:return: the indices of its three particles
";
%feature("docstring") HelfrichPlugin::HelfrichForce::getFixedEdgeParameters "
Get the particles of an edge that never flips.

:type index: int
:param index: the index of the fixed edge
:rtype: list
:return: the indices of its two particles
";
%feature("docstring") HelfrichPlugin::HelfrichForce::getTriangles "
Get all triangles.

:rtype: array of int32, shape (T, 3)
:return: the particles of each triangle, a copy
";
%feature("docstring") HelfrichPlugin::HelfrichForce::getTether "
Get the parameters of the tether term.

:rtype: list
:return: the modulus kappa_T (a Quantity, in kJ/mol), the lengths l_c1 below which an edge is pushed apart and l_c0
    above which it is pulled together (Quantities, in nm), and the exponent r: the arguments of setTether()
";
%feature("docstring") HelfrichPlugin::HelfrichForce::getRepulsion "
Get the parameters of the repulsion term.

:rtype: list
:return: the modulus kappa_R (a Quantity, in kJ/mol), the onset (a Quantity, in nm) below which two vertices repel each
    other, the exponent, and the exclusion level (0, 1 or 2): the arguments of setRepulsion()
";
%feature("docstring") HelfrichPlugin::HelfrichForce::getTrianglesInContext "
Get the live triangles of a Context, which edge flips change.

:type context: Context
:param context: the Context to query
:rtype: array of int32, shape (T, 3)
:return: the particles of each triangle, a copy
";
%feature("docstring") HelfrichPlugin::HelfrichForce::getSpeciesParameters "
Get the moduli of a species.

:type index: int
:param index: the number of the species
:rtype: list
:return: the bending modulus (a Quantity, in kJ/mol), the spontaneous curvature (a Quantity, in 1/nm) and the Gaussian
    modulus (a Quantity, in kJ/mol): the arguments of addSpecies()
";
%feature("docstring") HelfrichPlugin::HelfrichForce::getVertexSpecies "
Get the species that the vertices of a new Context have; none if they were not set.

:rtype: array of int32, shape (N,)
:return: the number of the species of each vertex, in ascending order of the particles' indices, a copy
";
%feature("docstring") HelfrichPlugin::HelfrichForce::getVertexSpeciesInContext "
Get the live species of the vertices of a Context, which exchanges change.

:type context: Context
:param context: the Context to query
:rtype: array of int32, shape (N,)
:return: the number of the species of each vertex, in ascending order of the particles' indices, a copy; none if this
    Force had no species when the Context was created
";
%feature("docstring") HelfrichPlugin::HelfrichForce::getTermNames "
Get the names of the terms of the energy, in the order in which they are added up.

:rtype: tuple
:return: the names (str), which are the keys of what getEnergyTermsInContext() returns
";
%feature("docstring") HelfrichPlugin::HelfrichForce::getEnergyTermsInContext "
Compute the energy of each term for the present positions of a Context.

:type context: Context
:param context: the Context to query
:rtype: dict
:return: the energies of the terms, by the names that getTermNames() returns (Quantities, in kJ/mol): their sum is the
    potential energy of this force
";
%feature("docstring") HelfrichPlugin::HelfrichForce::getGeometryInContext "
Compute the geometry of the membrane for the present positions of a Context.

:type context: Context
:param context: the Context to query
:rtype: HelfrichGeometry
:return: areas, volumes and curvatures, of the whole, of each connected surface and of each vertex
";
