// Where the files of tests/data lie.
#pragma once

#include <cstdlib>
#include <string>

namespace tvsgs {

/// The variable TVSGS_TEST_DATA names them where a tarball is tried on another machine.
inline std::string test_data(const std::string& file) {
    const char* const elsewhere = std::getenv("TVSGS_TEST_DATA");
    return std::string(elsewhere ? elsewhere : TVSGS_TEST_DATA) + "/" + file;
}

}  // namespace tvsgs
