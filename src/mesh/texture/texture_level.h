// Colour corrections that remove the steps between charts.
#pragma once

#include <vector>

#include "mesh/texture/texture_charts.h"

namespace tvsgs::texture {

/// A correction of one chart: values at every `spacing` pixels of the photograph, linear between
/// them.
struct Correction {
    double left = 0, top = 0, spacing = 1;  // pixels
    int columns = 0, rows = 0;
    std::vector<Vec3f> values;  // [rows columns]

    Vec3f at(double u, double v) const;
};

/// One correction per chart, by least squares of: the steps along all edges between charts, the
/// difference of each face from the mean of all views, and the differences of neighbouring values.
/// [docs/method/texture.md#seams] `compared`: number of sample points on edges.
std::vector<Correction> level_seams(const TriangleMesh& mesh,
                                    const std::vector<PhotoView>& views,
                                    const Candidates& candidates,
                                    const std::vector<Chart>& charts,
                                    const std::vector<SharedEdge>& edges,
                                    int& compared);

}  // namespace tvsgs::texture
