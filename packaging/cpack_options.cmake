# What differs between the generators of CPack; read by cpack itself.
if(CPACK_GENERATOR STREQUAL "DEB")
    set(CPACK_PACKAGING_INSTALL_PREFIX /usr)
    set(CPACK_COMPONENTS_ALL ${CPACK_TVSGS_PACKAGES} libtvsgs-dev)
elseif(CPACK_GENERATOR STREQUAL "TGZ")
    # One archive that needs nothing but the libraries of C and C++: every command, and the libraries of them all.
    set(CPACK_COMPONENTS_ALL ${CPACK_TVSGS_PACKAGES} bundled)
    if(CPACK_TVSGS_TESTS)
        list(APPEND CPACK_COMPONENTS_ALL tests)
    endif()
    set(CPACK_ARCHIVE_COMPONENT_INSTALL ON)
    set(CPACK_COMPONENTS_GROUPING ALL_COMPONENTS_IN_ONE)
    set(CPACK_COMPONENT_INCLUDE_TOPLEVEL_DIRECTORY ON)
    set(CPACK_PACKAGE_FILE_NAME
        "tvsgs-${CPACK_PACKAGE_VERSION}-${CPACK_TVSGS_DEVICE}-linux-${CPACK_TVSGS_PROCESSOR}")
endif()
