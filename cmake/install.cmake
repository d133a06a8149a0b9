# Commands, libraries and packages:  docs/guide/install.md
# What `--version` says, the lists of commands, `cmake --install`, find_package(tvsgs), and CPack.

# 1. What the program says of itself.
set(TVSGS_BUILD
    "${CMAKE_BUILD_TYPE}, ${CMAKE_CXX_COMPILER_ID} ${CMAKE_CXX_COMPILER_VERSION}, ${CMAKE_SYSTEM_PROCESSOR}")
foreach(option NATIVE ASAN TSAN)
    if(TVSGS_${option})
        string(APPEND TVSGS_BUILD ", TVSGS_${option}")
    endif()
endforeach()
set(TVSGS_DEVICE_CODE "CPU")
set(TVSGS_LIBRARIES "CLI11 ${CLI11_VERSION}, Eigen ${Eigen3_VERSION}, nanoflann ${nanoflann_VERSION}, "
    "nlohmann-json ${nlohmann_json_VERSION}, spdlog ${spdlog_VERSION}, "
    "libzip ${LIBZIP_VERSION}, zlib ${ZLIB_VERSION_STRING}")
if(TVSGS_CUDA)
    list(JOIN CMAKE_CUDA_ARCHITECTURES " " architectures)
    string(APPEND TVSGS_DEVICE_CODE ", CUDA architectures ${architectures}")
    list(APPEND TVSGS_LIBRARIES ", CUDA runtime ${CUDAToolkit_VERSION}")
endif()
string(CONCAT TVSGS_LIBRARIES ${TVSGS_LIBRARIES})
get_property(commands GLOBAL PROPERTY TVSGS_COMMANDS)
foreach(command ${commands})
    get_property(summary GLOBAL PROPERTY TVSGS_SUMMARY_${command})
    get_property(package GLOBAL PROPERTY TVSGS_PACKAGE_${command})
    list(APPEND packages ${package})
    if(NOT command STREQUAL tvsgs)
        string(APPEND TVSGS_COMMAND_ENTRIES "        {\"${command}\", \"${summary}\", \"${package}\"},\n")
    endif()
endforeach()
list(REMOVE_DUPLICATES packages)
configure_file(packaging/build_info.cpp.in generated/apps/build_info.cpp @ONLY)

# 2. Commands with manuals and completion; each package is a component.
set(manuals ${PROJECT_BINARY_DIR}/manuals)
set(completions ${PROJECT_BINARY_DIR}/completions)
file(MAKE_DIRECTORY ${manuals} ${completions})
foreach(command ${commands})
    get_property(package GLOBAL PROPERTY TVSGS_PACKAGE_${command})
    install(TARGETS ${command} RUNTIME_DEPENDENCY_SET tvsgs_runtime
        RUNTIME DESTINATION ${CMAKE_INSTALL_BINDIR} COMPONENT ${package})
    set(manual ${manuals}/${command}.1)
    add_custom_command(OUTPUT ${manual}.gz
        COMMAND ${command} --help-man > ${manual}
        COMMAND gzip -9nf ${manual}
        DEPENDS ${command} VERBATIM)
    list(APPEND manual_files ${manual}.gz)
    install(FILES ${manual}.gz DESTINATION ${CMAKE_INSTALL_MANDIR}/man1 COMPONENT ${package})
    # The shell looks for a file of the command's name.
    if(command STREQUAL tvsgs)
        install(FILES packaging/tvsgs.bash DESTINATION ${CMAKE_INSTALL_DATADIR}/bash-completion/completions
            RENAME tvsgs COMPONENT ${package})
    else()
        file(CREATE_LINK tvsgs ${completions}/${command} SYMBOLIC)
        install(FILES ${completions}/${command} DESTINATION ${CMAKE_INSTALL_DATADIR}/bash-completion/completions
            COMPONENT ${package})
    endif()
endforeach()
add_custom_target(tvsgs-manuals ALL DEPENDS ${manual_files})
install(DIRECTORY configs matrices python DESTINATION ${CMAKE_INSTALL_DATADIR}/tvsgs COMPONENT tvsgs
    PATTERN __pycache__ EXCLUDE)
install(FILES README.md CHANGELOG.md DESTINATION ${CMAKE_INSTALL_DOCDIR} COMPONENT tvsgs)
foreach(package ${packages} libtvsgs-dev)
    install(FILES packaging/copyright DESTINATION ${CMAKE_INSTALL_DATADIR}/doc/${package} COMPONENT ${package})
endforeach()

# 3. Libraries and headers.
set(libraries tvsgs_flags tvsgs_mat tvsgs_dtu)
foreach(module ${TVSGS_MODULES})
    list(APPEND libraries tvsgs_${module})
endforeach()
foreach(library ${libraries})
    string(REPLACE "tvsgs_" "" name ${library})
    set_target_properties(${library} PROPERTIES EXPORT_NAME ${name})
endforeach()
set(package_dir ${CMAKE_INSTALL_LIBDIR}/cmake/tvsgs)
install(TARGETS ${libraries} EXPORT tvsgs_targets
    ARCHIVE DESTINATION ${CMAKE_INSTALL_LIBDIR} COMPONENT libtvsgs-dev)
install(EXPORT tvsgs_targets FILE tvsgs-targets.cmake NAMESPACE tvsgs:: DESTINATION ${package_dir}
    COMPONENT libtvsgs-dev)
install(DIRECTORY src/ ${PROJECT_BINARY_DIR}/generated/ DESTINATION ${CMAKE_INSTALL_INCLUDEDIR}/tvsgs
    COMPONENT libtvsgs-dev FILES_MATCHING PATTERN "*.h" PATTERN apps EXCLUDE)
include(CMakePackageConfigHelpers)
configure_package_config_file(packaging/tvsgs-config.cmake.in generated/cmake/tvsgs-config.cmake
    INSTALL_DESTINATION ${package_dir} NO_SET_AND_CHECK_MACRO)
write_basic_package_version_file(${PROJECT_BINARY_DIR}/generated/cmake/tvsgs-config-version.cmake
    COMPATIBILITY SameMinorVersion)
install(FILES ${PROJECT_BINARY_DIR}/generated/cmake/tvsgs-config.cmake
        ${PROJECT_BINARY_DIR}/generated/cmake/tvsgs-config-version.cmake
    DESTINATION ${package_dir} COMPONENT libtvsgs-dev)

install(TARGETS tvsgs_votes RUNTIME_DEPENDENCY_SET tvsgs_runtime
    LIBRARY DESTINATION ${CMAKE_INSTALL_LIBDIR} COMPONENT tvsgs NAMELINK_COMPONENT libtvsgs-dev)
install(FILES include/tvsgs_votes.h DESTINATION ${CMAKE_INSTALL_INCLUDEDIR} COMPONENT libtvsgs-dev)

# 4. For the tarball alone: the shared libraries of the commands with their licences, but for the libraries of C and
# C++, which must be the machine's own. Debian's C++ library needs a newer C library than the commands do.
install(RUNTIME_DEPENDENCY_SET tvsgs_runtime
    PRE_EXCLUDE_REGEXES
        "^(ld-linux|libc|libm|libmvec|libdl|librt|libpthread|libresolv|libutil|libanl|libgcc_s)[-.].*so" "^libstdc\\+\\+"
    LIBRARY DESTINATION ${CMAKE_INSTALL_LIBDIR}/tvsgs COMPONENT bundled EXCLUDE_FROM_ALL)
install(CODE "set(TVSGS_LIBRARY_DIR \"${CMAKE_INSTALL_LIBDIR}/tvsgs\")
set(TVSGS_LICENCE_DIR \"${CMAKE_INSTALL_DATADIR}/doc/tvsgs/licences\")
include(\"${PROJECT_SOURCE_DIR}/packaging/bundled_licences.cmake\")" COMPONENT bundled EXCLUDE_FROM_ALL)

# 5. Packages: cpack -G DEB, cpack -G TGZ. With -D CPACK_TVSGS_TESTS=ON the tarball has the test programs and their
# data.
set(CPACK_PACKAGE_CONTACT "The tvsgs contributors <contributors@tvsgs.invalid>" CACHE STRING
    "Name <address> of who makes the packages")
set(CPACK_PACKAGE_VENDOR "tvsgs")
set(CPACK_RESOURCE_FILE_LICENSE ${PROJECT_SOURCE_DIR}/LICENSE)
set(CPACK_PACKAGE_DIRECTORY ${PROJECT_BINARY_DIR}/packages)
set(CPACK_STRIP_FILES ON)
set(CPACK_VERBATIM_VARIABLES ON)
set(CPACK_COMPONENTS_ALL ${packages} libtvsgs-dev bundled tests)
set(CPACK_PROJECT_CONFIG_FILE ${PROJECT_SOURCE_DIR}/packaging/cpack_options.cmake)
set(CPACK_TVSGS_PACKAGES ${packages})
set(CPACK_TVSGS_DEVICE cpu)
set(CPACK_TVSGS_PROCESSOR ${CMAKE_SYSTEM_PROCESSOR})
set(CPACK_TVSGS_SUFFIX "")
if(TVSGS_CUDA)
    set(CPACK_TVSGS_DEVICE cuda)
    set(CPACK_TVSGS_SUFFIX -cuda)
endif()
set(CPACK_DEBIAN_FILE_NAME DEB-DEFAULT)
set(CPACK_DEBIAN_COMPRESSION_TYPE xz)
set(CPACK_DEBIAN_PACKAGE_SECTION science)
set(CPACK_DEBIAN_PACKAGE_SHLIBDEPS ON)
set(CPACK_DEB_COMPONENT_INSTALL ON)
foreach(package ${packages} libtvsgs-dev)
    # A build with CUDA is a package of its own that takes the place of the one without.
    string(TOUPPER ${package} upper)
    set(CPACK_DEBIAN_${upper}_PACKAGE_NAME ${package}${CPACK_TVSGS_SUFFIX})
    if(TVSGS_CUDA)
        foreach(relation PROVIDES CONFLICTS REPLACES)
            set(CPACK_DEBIAN_${upper}_PACKAGE_${relation} ${package})
        endforeach()
    endif()
    if(NOT package STREQUAL tvsgs)
        set(CPACK_DEBIAN_${upper}_PACKAGE_DEPENDS "tvsgs${CPACK_TVSGS_SUFFIX}")
    endif()
endforeach()
set(CPACK_COMPONENT_TVSGS_DESCRIPTION "Trains splats on photographs with cameras, extracts textured meshes.")
set(CPACK_COMPONENT_TVSGS-EVAL_DESCRIPTION "tvsgs-eval: measures meshes, clouds and test views.")
set(CPACK_COMPONENT_TVSGS-PREPARE_DESCRIPTION "tvsgs-prepare: photographs or a video to a scene, by COLMAP.")
set(CPACK_COMPONENT_LIBTVSGS-DEV_DESCRIPTION "Static libraries, headers and find_package(tvsgs).")
set(CPACK_DEBIAN_TVSGS-PREPARE_PACKAGE_DEPENDS "tvsgs${CPACK_TVSGS_SUFFIX}, colmap")
set(suggested ${packages})
list(REMOVE_ITEM suggested tvsgs)
if(suggested)
    list(TRANSFORM suggested APPEND "${CPACK_TVSGS_SUFFIX}")
endif()
list(JOIN suggested ", " CPACK_DEBIAN_TVSGS_PACKAGE_SUGGESTS)
set(CPACK_DEBIAN_LIBTVSGS-DEV_PACKAGE_DEPENDS
    "tvsgs${CPACK_TVSGS_SUFFIX}, libeigen3-dev, libnanoflann-dev, libspdlog-dev, libwebp-dev, libzip-dev, libzstd-dev"
    "nlohmann-json3-dev, pkg-config, zlib1g-dev")
list(JOIN CPACK_DEBIAN_LIBTVSGS-DEV_PACKAGE_DEPENDS ", " CPACK_DEBIAN_LIBTVSGS-DEV_PACKAGE_DEPENDS)
set(CPACK_DEBIAN_LIBTVSGS-DEV_PACKAGE_SHLIBDEPS OFF)
set(CPACK_DEBIAN_LIBTVSGS-DEV_PACKAGE_SECTION libdevel)
include(CPack)
