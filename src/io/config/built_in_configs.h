// The configurations of configs/, which a program that stands alone has with it.
#pragma once

#include <string>
#include <string_view>
#include <vector>

namespace tvsgs {

/// Names of those that the program itself reads.
inline constexpr const char *kAutoConfig = "auto", *kSparseConfig = "pgsr_sparse",
                            *kDenseConfig = "pgsr_dense";

/// The names of all, sorted.
std::vector<std::string> built_in_configs();

/// The text of configs/NAME.json. Throws Error(ExitCode::usage) naming the nearest one.
const char* built_in_config(std::string_view name);

}  // namespace tvsgs
