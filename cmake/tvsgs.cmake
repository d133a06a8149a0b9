# Flags and helpers shared by all targets of the project.

add_library(tvsgs_flags INTERFACE)
# "core/version.h" is made from project(VERSION) and lies in the build tree.
configure_file(${PROJECT_SOURCE_DIR}/src/core/version.h.in ${PROJECT_BINARY_DIR}/generated/core/version.h @ONLY)
target_include_directories(tvsgs_flags INTERFACE
    $<BUILD_INTERFACE:${PROJECT_SOURCE_DIR}/src> $<BUILD_INTERFACE:${PROJECT_BINARY_DIR}/generated>
    $<INSTALL_INTERFACE:${CMAKE_INSTALL_INCLUDEDIR}/tvsgs>)
target_compile_features(tvsgs_flags INTERFACE cxx_std_20)
# -Wno-restrict: GCC 12 sees overlaps in std::string that are not there (GCC bug 105651).
# No fast-math anywhere: the guards rely on NaN comparing false. The two flags below only drop errno
# and trap bookkeeping, which is what lets loops with exp() and sqrt() vectorise.
# Warnings are GCC's: clang, which fuzzing needs, has others.
if(CMAKE_CXX_COMPILER_ID STREQUAL "GNU")
    set(TVSGS_WARNINGS -Wall -Wextra -Wshadow -Wconversion -Wno-restrict)
    if(TVSGS_WERROR)
        list(APPEND TVSGS_WARNINGS -Werror)
    endif()
endif()
if(TVSGS_WERROR)
    set(TVSGS_CUDA_WERROR -Werror=all-warnings)
endif()
# Those who link the installed libraries have warnings of their own.
target_compile_options(tvsgs_flags INTERFACE
    "$<BUILD_INTERFACE:$<$<COMPILE_LANGUAGE:CXX>:${TVSGS_WARNINGS};-fno-math-errno;-fno-trapping-math;-fopenmp-simd>>"
    $<$<COMPILE_LANGUAGE:CUDA>:--expt-relaxed-constexpr>
    "$<BUILD_INTERFACE:$<$<COMPILE_LANGUAGE:CUDA>:-Xcompiler=-Wall,-fopenmp-simd;${TVSGS_CUDA_WERROR}>>"
    $<BUILD_INTERFACE:$<$<COMPILE_LANGUAGE:CUDA>:-diag-suppress=20012>>)
target_link_libraries(tvsgs_flags INTERFACE Threads::Threads)
if(TVSGS_CUDA)
    target_compile_definitions(tvsgs_flags INTERFACE TVSGS_WITH_CUDA=1)
    # System headers for the C++ files: CUDA's own do not pass our warnings.
    target_include_directories(tvsgs_flags SYSTEM INTERFACE "$<BUILD_INTERFACE:${CUDAToolkit_INCLUDE_DIRS}>")
endif()
if(TVSGS_NATIVE)
    target_compile_options(tvsgs_flags INTERFACE $<$<COMPILE_LANGUAGE:CXX>:-march=native>)
endif()
if(TVSGS_ASAN OR TVSGS_FUZZ)
    # What they find ends the program. With sanitizers GCC 12 sees uninitialised values in std::regex
    # (GCC bug 105562).
    set(TVSGS_SANITIZE -fsanitize=address,undefined -fno-sanitize-recover=all)
    set(TVSGS_SANITIZE_COMPILE -Wno-maybe-uninitialized)
elseif(TVSGS_TSAN)
    set(TVSGS_SANITIZE -fsanitize=thread)
endif()
if(TVSGS_FUZZ)
    set(TVSGS_SANITIZE_COMPILE -fsanitize=fuzzer-no-link)
endif()
if(TVSGS_SANITIZE)
    target_compile_definitions(tvsgs_flags INTERFACE _GLIBCXX_ASSERTIONS)
    target_compile_options(tvsgs_flags INTERFACE
        $<$<COMPILE_LANGUAGE:CXX>:${TVSGS_SANITIZE} ${TVSGS_SANITIZE_COMPILE} -fno-omit-frame-pointer>)
    target_link_options(tvsgs_flags INTERFACE ${TVSGS_SANITIZE})
endif()

# tvsgs_library(NAME SOURCES a.cpp ... CUDA_SOURCES a.cu ... LINK lib ...)
# SHAREABLE: a shared library may contain it.
function(tvsgs_library name)
    cmake_parse_arguments(ARG "SHAREABLE" "" "SOURCES;CUDA_SOURCES;LINK;PRIVATE_LINK" ${ARGN})
    if(TVSGS_CUDA)
        list(APPEND ARG_SOURCES ${ARG_CUDA_SOURCES})
    endif()
    add_library(${name} STATIC ${ARG_SOURCES})
    if(ARG_SHAREABLE)  # hidden symbols are called without the tables of a shared library
        set_target_properties(${name} PROPERTIES POSITION_INDEPENDENT_CODE ON
            CXX_VISIBILITY_PRESET hidden CUDA_VISIBILITY_PRESET hidden)
    endif()
    target_link_libraries(${name} PUBLIC tvsgs_flags ${ARG_LINK} PRIVATE ${ARG_PRIVATE_LINK})
    if(TVSGS_CUDA)
        target_link_libraries(${name} PUBLIC CUDA::cudart_static)
    endif()
endfunction()

# tvsgs_test(NAME LABELS formula|twin|golden|smoke ... SOURCES ... LINK ...)
function(tvsgs_test name)
    cmake_parse_arguments(ARG "" "" "SOURCES;LINK;LABELS" ${ARGN})
    add_executable(${name} ${ARG_SOURCES})
    target_link_libraries(${name} PRIVATE ${ARG_LINK} GTest::gtest_main)
    target_include_directories(${name} PRIVATE ${PROJECT_SOURCE_DIR}/tests)
    # Development scenes, which a clone does not hold: tests that need them skip there, and say so.
    target_compile_definitions(${name} PRIVATE
        TVSGS_SHARED_DIR="${PROJECT_SOURCE_DIR}/../shared"
        TVSGS_SOURCE_DIR="${PROJECT_SOURCE_DIR}"
        TVSGS_TEST_DATA="${PROJECT_SOURCE_DIR}/tests/data"
        TVSGS_BIN_DIR="${CMAKE_RUNTIME_OUTPUT_DIRECTORY}")
    add_test(NAME ${name} COMMAND ${name})
    install(TARGETS ${name} RUNTIME DESTINATION ${CMAKE_INSTALL_BINDIR} COMPONENT tests EXCLUDE_FROM_ALL)
    set(seconds 900)
    if(TVSGS_SANITIZE)
        set(seconds 3600)  # tests that make scenes take most of it
    endif()
    set_tests_properties(${name} PROPERTIES LABELS "${ARG_LABELS}" TIMEOUT ${seconds})
    if(name IN_LIST TVSGS_LONG_TESTS)
        set_tests_properties(${name} PROPERTIES COST 10)
    endif()
endfunction()
