// The texts of configs/auto.json, pgsr_sparse.json and pgsr_dense.json, so that a program that
// stands alone has its defaults with it.
#pragma once

namespace tvsgs {

extern const char* const kAutoConfig;
extern const char* const kSparseConfig;
extern const char* const kDenseConfig;

}  // namespace tvsgs
