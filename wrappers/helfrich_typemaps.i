// Triangles are numpy arrays of shape (T, 3), energies and geometry plain Python objects, to which helfrich_features.i
// adds the units.

%fragment("HelfrichTriangles", "header") {

/**
 * Report what is wrong with an array of triangles, as a ValueError.
 */
static bool rejectTriangles(const char* caller, const std::string& problem) {
    PyErr_Format(PyExc_ValueError, "%s: triangles must be an array of integers of shape (T, 3), not %s", caller,
                 problem.c_str());
    return false;
}

static std::string describeShape(PyArrayObject* array) {
    std::string shape;
    for (int i = 0; i < PyArray_NDIM(array); i++)
        shape += (i == 0 ? "" : ", ")+std::to_string((long long) PyArray_DIM(array, i));
    return "one of shape ("+shape+(PyArray_NDIM(array) == 1 ? ",)" : ")");
}

static std::string describeType(PyArrayObject* array) {
    PyObject* text = PyObject_Str((PyObject*) PyArray_DESCR(array));
    const char* name = (text == NULL ? NULL : PyUnicode_AsUTF8(text));
    std::string result = std::string("one of ")+(name == NULL ? "an unknown type" : name);
    Py_XDECREF(text);
    PyErr_Clear();
    return result;
}

/**
 * Copy 64 bit integers to triangles, unless one does not fit into an int.
 */
static bool copyTriangles(const char* caller, const npy_int64* values, bool wereUnsigned,
                          std::vector<std::array<int, 3> >& triangles) {
    for (size_t i = 0; i < 3*triangles.size(); i++) {
        npy_int64 value = values[i];
        if (value != (npy_int64) (int) value || (wereUnsigned && value < 0)) {
            std::string number = (wereUnsigned ? std::to_string((unsigned long long) value)
                                               : std::to_string((long long) value));
            return rejectTriangles(caller, "one with the value "+number+" (triangle "+std::to_string(i/3)+
                                           "), which does not fit into 32 bits");
        }
        triangles[i/3][i%3] = (int) value;
    }
    return true;
}

/**
 * Copy an array of shape (T, 3) and any type of integer to triangles.  Only an array of another type than int32 and
 * int64, or one that is not contiguous, is copied twice.
 */
static bool arrayToTriangles(const char* caller, PyArrayObject* array, std::vector<std::array<int, 3> >& triangles) {
    bool isEmptyList = (PyArray_NDIM(array) == 1 && PyArray_DIM(array, 0) == 0);
    if (!isEmptyList && (PyArray_NDIM(array) != 2 || PyArray_DIM(array, 1) != 3))
        return rejectTriangles(caller, describeShape(array));
    triangles.resize(PyArray_DIM(array, 0));
    if (triangles.empty())
        return true;
    if (!PyArray_ISINTEGER(array))
        return rejectTriangles(caller, describeType(array));
    bool isInt32 = (PyArray_ISSIGNED(array) && PyArray_ITEMSIZE(array) == sizeof(npy_int32));
    PyArrayObject* plain = (PyArrayObject*) PyArray_FROM_OTF((PyObject*) array, isInt32 ? NPY_INT32 : NPY_INT64,
                                                             NPY_ARRAY_CARRAY_RO | NPY_ARRAY_FORCECAST);
    if (plain == NULL)
        return false;
    bool success = true;
    if (isInt32)
        memcpy(triangles[0].data(), PyArray_DATA(plain), 3*sizeof(npy_int32)*triangles.size());
    else
        success = copyTriangles(caller, (const npy_int64*) PyArray_DATA(plain), PyArray_ISUNSIGNED(array), triangles);
    Py_DECREF(plain);
    return success;
}

/**
 * Convert an array, or a sequence of triples, to triangles.  If that is not possible, a Python error is set.
 */
static bool objectToTriangles(const char* caller, PyObject* object, std::vector<std::array<int, 3> >& triangles) {
    PyArrayObject* array = (PyArrayObject*) PyArray_FROM_O(object);
    if (array == NULL) {
        PyErr_Clear();
        return rejectTriangles(caller, "a ragged sequence");
    }
    bool success = arrayToTriangles(caller, array, triangles);
    Py_DECREF(array);
    return success;
}

/**
 * Copy triangles to a new array of type int32.
 */
static PyObject* trianglesToArray(const std::vector<std::array<int, 3> >& triangles) {
    npy_intp shape[] = {(npy_intp) triangles.size(), 3};
    PyObject* array = PyArray_SimpleNew(2, shape, NPY_INT32);
    if (array != NULL && !triangles.empty())
        memcpy(PyArray_DATA((PyArrayObject*) array), triangles[0].data(), 3*sizeof(npy_int32)*triangles.size());
    return array;
}
}

%typemap(in, fragment="HelfrichTriangles")
const std::vector<std::array<int, 3> >& (std::vector<std::array<int, 3> > triangles) {
    if (!objectToTriangles("$symname", $input, triangles))
        SWIG_fail;
    $1 = &triangles;
}
%typemap(out, fragment="HelfrichTriangles") const std::vector<std::array<int, 3> >& {
    $result = trianglesToArray(*$1);
}
%typemap(in, numinputs=0) std::vector<std::array<int, 3> >& triangles (std::vector<std::array<int, 3> > found) {
    $1 = &found;
}
%typemap(argout, fragment="HelfrichTriangles") std::vector<std::array<int, 3> >& triangles {
    Py_XDECREF($result);
    $result = trianglesToArray(*$1);
}
%typemap(argout) const std::vector<std::array<int, 3> >& triangles {
}

// Species of vertices are numpy arrays of shape (N,).
%fragment("HelfrichIntegers", "header") {
/**
 * Convert an array, or a sequence of whole numbers, to integers.  If that is not possible, a Python error is set.
 */
static bool objectToIntegers(const char* caller, const char* argument, PyObject* object, std::vector<int>& integers) {
    PyArrayObject* given = (PyArrayObject*) PyArray_FROM_O(object);
    PyErr_Clear();
    bool isEmpty = (given != NULL && PyArray_SIZE(given) == 0);
    bool isRight = (given != NULL && PyArray_NDIM(given) == 1 && (isEmpty || PyArray_ISINTEGER(given)));
    PyArrayObject* plain = NULL;
    if (isRight)
        plain = (PyArrayObject*) PyArray_FROM_OTF((PyObject*) given, NPY_INT64,
                                                  NPY_ARRAY_CARRAY_RO | NPY_ARRAY_FORCECAST);
    Py_XDECREF(given);
    if (!isRight) {
        PyErr_Format(PyExc_ValueError, "%s: %s must be an array of integers of shape (N,)", caller, argument);
        return false;
    }
    if (plain == NULL)
        return false;
    const npy_int64* values = (const npy_int64*) PyArray_DATA(plain);
    integers.resize(PyArray_SIZE(plain));
    for (size_t i = 0; i < integers.size() && isRight; i++) {
        integers[i] = (int) values[i];
        isRight = (integers[i] == values[i]);
        if (!isRight)
            PyErr_Format(PyExc_ValueError, "%s: %s has the value %lld, which does not fit into 32 bits", caller,
                         argument, (long long) values[i]);
    }
    Py_DECREF(plain);
    return isRight;
}

/**
 * Copy integers to a new array of type int32.
 */
static PyObject* integersToArray(const std::vector<int>& integers) {
    npy_intp size = integers.size();
    PyObject* array = PyArray_SimpleNew(1, &size, NPY_INT32);
    if (array != NULL && size > 0)
        memcpy(PyArray_DATA((PyArrayObject*) array), integers.data(), sizeof(npy_int32)*size);
    return array;
}
}

%typemap(in, fragment="HelfrichIntegers,HelfrichNumbers") const std::vector<int>& species (std::vector<int> species) {
    if (!objectToIntegers(describeCaller("$symname").c_str(), "$1_name", $input, species))
        SWIG_fail;
    $1 = &species;
}
%typemap(out, fragment="HelfrichIntegers") const std::vector<int>& getVertexSpecies {
    $result = integersToArray(*$1);
}
%typemap(in, numinputs=0) std::vector<int>& species (std::vector<int> found) {
    $1 = &found;
}
%typemap(argout, fragment="HelfrichIntegers") std::vector<int>& species {
    Py_XDECREF($result);
    $result = integersToArray(*$1);
}
%typemap(argout) const std::vector<int>& species {
}

// Numbers that come back through references make a list, as in OpenMM.
%apply int& OUTPUT { int& particle1, int& particle2, int& particle3, int& exponent, int& exclusionLevel };
%apply double& OUTPUT { double& modulus, double& minLength, double& maxLength, double& onset, double& bendingModulus,
                        double& spontaneousCurvature, double& gaussianModulus };

namespace HelfrichPlugin {
struct HelfrichEnergyTerms;
}
%typemap(out) HelfrichPlugin::HelfrichEnergyTerms {
    const HelfrichPlugin::HelfrichEnergyTerms& terms = $1;
    $result = PyDict_New();
    for (int i = 0; i < HelfrichPlugin::NUM_TERMS; i++) {
        PyObject* energy = PyFloat_FromDouble(terms[HelfrichPlugin::Term(i)]);
        PyDict_SetItemString($result, HelfrichPlugin::TERM_NAMES[i], energy);
        Py_DECREF(energy);
    }
}

%typemap(out) std::vector<std::string> {
    const std::vector<std::string>& strings = $1;
    $result = PyTuple_New(strings.size());
    for (size_t i = 0; i < strings.size(); i++)
        PyTuple_SET_ITEM($result, i, PyUnicode_FromString(strings[i].c_str()));
}

%fragment("HelfrichVector", "header") {
static PyObject* vectorToArray(const std::vector<double>& values) {
    npy_intp size = values.size();
    PyObject* array = PyArray_SimpleNew(1, &size, NPY_DOUBLE);
    if (array != NULL && size > 0)
        memcpy(PyArray_DATA((PyArrayObject*) array), values.data(), sizeof(double)*size);
    return array;
}
}
%typemap(out, fragment="HelfrichVector") HelfrichPlugin::HelfrichGeometry {
    const HelfrichPlugin::HelfrichGeometry& geometry = $1;
    PyObject* surfaces = PyTuple_New(geometry.surfaces.size());
    for (size_t i = 0; i < geometry.surfaces.size(); i++) {
        const HelfrichPlugin::HelfrichSurfaceGeometry& surface = geometry.surfaces[i];
        PyTuple_SET_ITEM(surfaces, i, Py_BuildValue("(d,d,d,d)", surface.area, surface.volume, surface.areaDifference,
                                                    surface.integratedMeanCurvature));
    }
    $result = Py_BuildValue("(d,d,d,d,N,N,N)", geometry.area, geometry.volume, geometry.areaDifference,
            geometry.integratedMeanCurvature, vectorToArray(geometry.vertexAreas),
            vectorToArray(geometry.vertexMeanCurvatures), surfaces);
}

// Numbers that come in: a Quantity must have the dimension of its argument, which follows from the argument's name.
%fragment("HelfrichNumbers", "header") {
/**
 * Get what users call a method, or a class, by what the wrapper calls it: "Class_method", or "new_Class".
 */
static std::string describeCaller(std::string name) {
    if (name.compare(0, 4, "new_") == 0)
        return name.substr(4);
    size_t end = name.find('_');
    return end == std::string::npos ? name : name.replace(end, 1, ".");
}

/**
 * Convert a number, or a Quantity of the dimension of an argument.  If that is not possible, a Python error is set.
 */
static bool objectToNumber(const char* caller, const char* argument, PyObject* object, double& number) {
    if (PyFloat_Check(object) || PyLong_CheckExact(object)) {
        number = PyFloat_AsDouble(object);
        return !PyErr_Occurred();
    }
    PyObject* module = PyImport_ImportModule("openmmhelfrich.helfrich");
    PyObject* result = NULL;
    if (module != NULL)
        result = PyObject_CallMethod(module, "_toNumber", "ssO", describeCaller(caller).c_str(), argument, object);
    if (result != NULL)
        number = PyFloat_AsDouble(result);
    Py_XDECREF(result);
    Py_XDECREF(module);
    return !PyErr_Occurred();
}

/**
 * Report that an argument is no whole number that fits into an int.
 */
static void rejectInteger(const char* caller, const char* argument, PyObject* object) {
    PyErr_Clear();
    PyErr_Format(PyLong_Check(object) ? PyExc_ValueError : PyExc_TypeError,
                 "%s: %s is %R; it must be a whole number, of less than 2147483648 in size",
                 describeCaller(caller).c_str(), argument, object);
}

/**
 * Convert a string.  If that is not possible, a Python error is set.
 */
static bool objectToText(const char* caller, const char* argument, PyObject* object, std::string& text) {
    Py_ssize_t size = 0;
    const char* characters = PyUnicode_Check(object) ? PyUnicode_AsUTF8AndSize(object, &size) : NULL;
    if (characters != NULL)
        text.assign(characters, size);
    else if (!PyErr_Occurred())
        PyErr_Format(PyExc_TypeError, "%s: %s is %R; it must be a string", describeCaller(caller).c_str(), argument,
                     object);
    return characters != NULL;
}
}
%typemap(in, fragment="HelfrichNumbers") const std::string& (std::string text) {
    if (!objectToText("$symname", "$1_name", $input, text))
        SWIG_fail;
    $1 = &text;
}
%typemap(freearg) const std::string& {
}
%typemap(in, fragment="HelfrichNumbers") double {
    if (!objectToNumber("$symname", "$1_name", $input, $1))
        SWIG_fail;
}
%typemap(typecheck, precedence=SWIG_TYPECHECK_DOUBLE) double {
    $1 = 1;
}
%typemap(typecheck, precedence=SWIG_TYPECHECK_INTEGER) int {
    $1 = 1;
}
%typemap(in, fragment="HelfrichNumbers,SWIG_AsVal_int") int {
    if (!SWIG_IsOK(SWIG_AsVal_int($input, &$1))) {
        rejectInteger("$symname", "$1_name", $input);
        SWIG_fail;
    }
}
