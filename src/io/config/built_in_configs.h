// The configurations of configs/ as text within the program.
#pragma once

#include <string>
#include <string_view>
#include <vector>

namespace tvsgs {

/// Names of the configurations that the program itself uses.
inline constexpr const char *kAutoConfig = "auto", *kSparseConfig = "pgsr_sparse",
                            *kDenseConfig = "pgsr_dense";

/// Sorted names of all built-in configurations.
std::vector<std::string> built_in_configs();

/// Text of configs/NAME.json. Throws Error(ExitCode::usage) that suggests the nearest name.
const char* built_in_config(std::string_view name);

}  // namespace tvsgs
