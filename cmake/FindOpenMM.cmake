# Finds the OpenMM that Python_EXECUTABLE imports, and defines
#   OpenMM::OpenMM  the library, with its headers
#   OpenMM::CPU     the plugin of the CPU platform
#   OpenMM_INCLUDE_DIR
# Its folder is not cached, so that a build folder survives a change of the environment.

execute_process(COMMAND "${Python_EXECUTABLE}" -c
    "import openmm.version as v; print(v.openmm_library_path); print(v.short_version)"
    OUTPUT_VARIABLE openmm_properties OUTPUT_STRIP_TRAILING_WHITESPACE RESULT_VARIABLE openmm_status)
if(openmm_status EQUAL 0)
    string(REPLACE "\n" ";" openmm_properties "${openmm_properties}")
    list(GET openmm_properties 0 OpenMM_LIBRARY_DIR)
    list(GET openmm_properties 1 OpenMM_VERSION)
    cmake_path(SET OpenMM_INCLUDE_DIR NORMALIZE "${OpenMM_LIBRARY_DIR}/../include")
    set(OpenMM_LIBRARY "${OpenMM_LIBRARY_DIR}/${CMAKE_SHARED_LIBRARY_PREFIX}OpenMM${CMAKE_SHARED_LIBRARY_SUFFIX}")
    set(OpenMM_CPU_LIBRARY
        "${OpenMM_LIBRARY_DIR}/plugins/${CMAKE_SHARED_LIBRARY_PREFIX}OpenMMCPU${CMAKE_SHARED_LIBRARY_SUFFIX}")
endif()

include(FindPackageHandleStandardArgs)
find_package_handle_standard_args(OpenMM
    REQUIRED_VARS OpenMM_LIBRARY OpenMM_INCLUDE_DIR VERSION_VAR OpenMM_VERSION HANDLE_VERSION_RANGE
    REASON_FAILURE_MESSAGE "${Python_EXECUTABLE} cannot import openmm: install it with pip")

if(OpenMM_FOUND AND NOT TARGET OpenMM::OpenMM)
    add_library(OpenMM::OpenMM SHARED IMPORTED)
    set_target_properties(OpenMM::OpenMM PROPERTIES
        IMPORTED_LOCATION "${OpenMM_LIBRARY}" INTERFACE_INCLUDE_DIRECTORIES "${OpenMM_INCLUDE_DIR}")
    add_library(OpenMM::CPU SHARED IMPORTED)
    set_target_properties(OpenMM::CPU PROPERTIES
        IMPORTED_LOCATION "${OpenMM_CPU_LIBRARY}" INTERFACE_LINK_LIBRARIES OpenMM::OpenMM
        INTERFACE_INCLUDE_DIRECTORIES "${OpenMM_INCLUDE_DIR}/openmm/reference")
endif()
