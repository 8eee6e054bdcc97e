%module(package="openmmhelfrich", moduleimport="with explained():\n    from . import $module") helfrich

// Without this, numpy's integers would not do where C++ wants an int.
%begin %{
#define SWIG_PYTHON_CAST_MODE
%}

%{
#define SWIG_FILE_WITH_INIT
#include "openmmhelfrich/CustomTrajectoryIntegrator.h"
#include "openmmhelfrich/EdgeFlipIntegrator.h"
#include "openmmhelfrich/HamiltonianTrajectoryIntegrator.h"
#include "openmmhelfrich/HelfrichForce.h"
#include "openmmhelfrich/HybridMonteCarloIntegrator.h"
#include "openmmhelfrich/ShearWaveIntegrator.h"
#include "openmmhelfrich/SpeciesExchangeIntegrator.h"
#include "OpenMM.h"
#include "OpenMMAmoeba.h"
#include "OpenMMDrude.h"
#include "openmm/RPMDIntegrator.h"
#include "openmm/RPMDMonteCarloBarostat.h"
#include <array>
#include <cstring>
#include <exception>
#include <limits>
#include <string>
#include <vector>
#include <numpy/arrayobject.h>
%}

%init %{
import_array();
%}

%include "factory.i"
%include "std_string.i"
%include "typemaps.i"

// OpenMM's own warnings: nested classes, a keyword, and typemaps of classes that this module does not wrap.
#pragma SWIG nowarn=314,325,453
%import(module="openmm") "swig/OpenMMSwigHeaders.i"
%include "swig/typemaps.i"
%include "helfrich_typemaps.i"
%include "helfrich_features.i"
%include "helfrich_python.i"
%include "helfrich_mixture.i"

#define OPENMM_EXPORT_HELFRICH
%include "openmmhelfrich/HelfrichForce.h"
%include "openmmhelfrich/MonteCarloMove.h"
%include "openmmhelfrich/MonteCarloIntegrator.h"
%include "openmmhelfrich/TrajectoryMove.h"
%include "openmmhelfrich/CustomTrajectoryIntegrator.h"
%include "openmmhelfrich/EdgeFlipIntegrator.h"
%include "openmmhelfrich/HamiltonianTrajectoryIntegrator.h"
%include "openmmhelfrich/ShearWaveIntegrator.h"
%include "openmmhelfrich/SpeciesExchangeIntegrator.h"
%include "openmmhelfrich/HybridMonteCarloIntegrator.h"
%include "helfrich_examples.i"
