// What photographs say of a face although they agree: exposure, and what stands before it.
#pragma once

#include "mesh/texture/texture_views.h"

namespace tvsgs::texture {

/// Sets the views' gains by what they say of common faces, and multiplies the candidates' colours
/// by them. Per channel, the least squares of the medians of logarithms over each pair of views,
/// with a mean of 1.
void level_exposures(Candidates& candidates, std::vector<PhotoView>& views);

/// Drops views that show another colour of a face than the others do, of four at least: something
/// that is not in the mesh stands before it.
void drop_outliers(Candidates& candidates);

}  // namespace tvsgs::texture
