# Where things are installed: beside OpenMM's own in the folder of Python packages, where "import openmm" finds plugins,
# and what an uninstallation of the Python package removes.  A plain CMake build installs to the interpreter's own
# folder, over what pip put there.

set(HELFRICH_LIBRARY_DIR OpenMM.libs/lib)
set(HELFRICH_PLUGIN_DIR OpenMM.libs/lib/plugins)
set(HELFRICH_INCLUDE_DIR OpenMM.libs/include/openmmhelfrich)
set(HELFRICH_PYTHON_DIR openmmhelfrich)
if(CMAKE_INSTALL_PREFIX_INITIALIZED_TO_DEFAULT)
    set(CMAKE_INSTALL_PREFIX "${Python_SITEARCH}" CACHE PATH "Folder of Python packages to install to" FORCE)
endif()

if(APPLE)
    set(HELFRICH_ORIGIN "@loader_path")
else()
    set(HELFRICH_ORIGIN "$ORIGIN")
endif()

# Installs a target to a folder, with the run paths that follow.
function(helfrich_install target folder)
    set_target_properties(${target} PROPERTIES INSTALL_RPATH "${ARGN}")
    install(TARGETS ${target} LIBRARY DESTINATION ${folder})
endfunction()
