# What tvsgs-priors needs beyond the other commands: OpenCV's DNN module, and SHA-256 of libmd. Sets TVSGS_PRIORS
# to OFF where one is missing. Debian has OpenCVConfig.cmake only in a package of all modules and 600 MB, so the two
# libraries are looked for by themselves.
find_path(OPENCV_INCLUDE_DIR opencv2/dnn.hpp PATH_SUFFIXES opencv4)
find_library(OPENCV_CORE_LIBRARY opencv_core)
find_library(OPENCV_DNN_LIBRARY opencv_dnn)
pkg_check_modules(LIBMD QUIET IMPORTED_TARGET libmd)
mark_as_advanced(OPENCV_INCLUDE_DIR OPENCV_CORE_LIBRARY OPENCV_DNN_LIBRARY)
if(OPENCV_INCLUDE_DIR AND OPENCV_CORE_LIBRARY AND OPENCV_DNN_LIBRARY AND LIBMD_FOUND)
    add_library(tvsgs_opencv_dnn INTERFACE)
    target_include_directories(tvsgs_opencv_dnn SYSTEM INTERFACE ${OPENCV_INCLUDE_DIR})
    target_link_libraries(tvsgs_opencv_dnn INTERFACE ${OPENCV_DNN_LIBRARY} ${OPENCV_CORE_LIBRARY})
else()
    message(STATUS "OpenCV's DNN module or libmd not found: building without tvsgs-priors "
                   "(Debian: libopencv-dnn-dev libmd-dev)")
    set(TVSGS_PRIORS OFF)
endif()
