// Compensates exposure and drops occluded views before faces get their colours.
#pragma once

#include "mesh/texture/texture_views.h"

namespace tvsgs::texture {

/// Sets the views' gains from the colours of common faces and multiplies the candidates' colours by
/// them. Least squares of the median log ratio of each pair of views, per channel, with a mean gain
/// of 1.
void level_exposures(Candidates& candidates, std::vector<PhotoView>& views);

/// Drops a view of a face, of at least four, if its colour differs from the others': an object that
/// is not in the mesh occludes the face.
void drop_outliers(Candidates& candidates);

}  // namespace tvsgs::texture
