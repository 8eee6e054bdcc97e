# Adds a C++ test, made of one source of the same name in the current folder and linked to the given libraries.
function(helfrich_add_test name)
    if(NOT BUILD_TESTING)
        return()
    endif()
    add_executable(${name} tests/${name}.cpp)
    target_include_directories(${name} PRIVATE "${PROJECT_SOURCE_DIR}/tests")
    target_link_libraries(${name} PRIVATE OpenMMHelfrich ${ARGN})
    add_test(NAME ${name} COMMAND ${name})
    # Threads that spin while they wait would take the processors from those that work, where a test has more of them
    # than there are processors.
    set_tests_properties(${name} PROPERTIES ENVIRONMENT OMP_WAIT_POLICY=passive)
endfunction()
