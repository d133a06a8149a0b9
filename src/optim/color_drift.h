// How much better a colour matrix explains what two views saw of the same points than a gain does.
#pragma once

#include <utility>
#include <vector>

#include "core/vec.h"

namespace tvsgs {

/// `pairs`: colours of the same points in two photographs, [0, 1]. A gain with an offset, and the
/// same with a matrix beside (exposed() in optim/exposure.h), are fitted to one half of them by
/// least squares and tried on the other, both ways. Returns by how much the matrix lowers the mean
/// error, as a share of the mean colour; not below 0. NaN: fewer than 60 pairs.
double color_drift(const std::vector<std::pair<Vec3d, Vec3d>>& pairs);

}  // namespace tvsgs
