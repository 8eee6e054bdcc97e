# Finds Eigen's headers: those of the Python package cmeel-eigen, if it is there, and otherwise any.

execute_process(COMMAND "${Python_EXECUTABLE}" -c
    "from importlib.metadata import distribution; print(distribution('cmeel-eigen').locate_file('cmeel.prefix'))"
    OUTPUT_VARIABLE cmeel_prefix OUTPUT_STRIP_TRAILING_WHITESPACE ERROR_QUIET)
# A folder that an earlier configuration found may be that of a build environment that is gone.
unset(Eigen3_DIR CACHE)
find_package(Eigen3 3.4 REQUIRED NO_MODULE HINTS "${cmeel_prefix}")
