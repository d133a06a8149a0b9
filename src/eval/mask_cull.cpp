#include "eval/mask_cull.h"

#include <algorithm>
#include <cmath>

#include "core/device/parallel.h"

namespace tvsgs {

void keep_vertices(PreciseMesh& mesh, const std::vector<char>& keep) {
    std::vector<int> new_index(mesh.vertices.size(), -1);
    int kept = 0;
    for (std::size_t i = 0; i < keep.size(); ++i)
        if (keep[i]) {
            mesh.vertices[static_cast<std::size_t>(kept)] = mesh.vertices[i];
            new_index[i] = kept++;
        }
    mesh.vertices.resize(static_cast<std::size_t>(kept));
    std::erase_if(mesh.faces, [&](Vec3i& face) {
        for (int k = 0; k < 3; ++k) face[k] = new_index[static_cast<std::size_t>(face[k])];
        return face.x < 0 || face.y < 0 || face.z < 0;
    });
}

std::size_t drop_non_finite(PreciseMesh& mesh) {
    std::vector<char> keep(mesh.vertices.size());
    std::size_t bad = 0;
    for (std::size_t i = 0; i < keep.size(); ++i) {
        keep[i] = is_finite(mesh.vertices[i]);
        bad += keep[i] ? 0 : 1;
    }
    if (bad > 0) keep_vertices(mesh, keep);
    return bad;
}

ImageU8 dilated(const ImageU8& mask, int radius) {
    const int width = mask.width, height = mask.height, far = radius + 1;
    // Distance along the row to the nearest set pixel, at most `far`.
    std::vector<int> along(static_cast<std::size_t>(width) * static_cast<std::size_t>(height));
    const auto at = [width](int x, int y) {
        return static_cast<std::size_t>(y) * static_cast<std::size_t>(width) +
               static_cast<std::size_t>(x);
    };
    parallel_for_heavy(Cpu{}, height, [&](int y) {
        for (int x = 0, d = far; x < width; ++x)
            along[at(x, y)] = d = mask.at(x, y) != 0 ? 0 : std::min(d + 1, far);
        for (int x = width - 1, d = far; x >= 0; --x) {
            d = mask.at(x, y) != 0 ? 0 : std::min(d + 1, far);
            along[at(x, y)] = std::min(along[at(x, y)], d);
        }
    });
    ImageU8 out(width, height, 1);
    parallel_for_heavy(Cpu{}, height, [&](int y) {
        const int first = std::max(0, y - radius), last = std::min(height - 1, y + radius);
        for (int row = first; row <= last; ++row) {
            const int left = radius * radius - (row - y) * (row - y);
            const int* const reach = &along[at(0, row)];
            std::uint8_t* const to = &out.pixels[at(0, y)];
            for (int x = 0; x < width; ++x)
                to[x] |= static_cast<std::uint8_t>(reach[x] * reach[x] <= left ? 255 : 0);
        }
    });
    return out;
}

std::vector<std::size_t> cull_by_masks(PreciseMesh& mesh,
                                       const std::vector<MaskView>& views,
                                       int radius) {
    std::vector<char> keep(mesh.vertices.size(), 1), on_mask(mesh.vertices.size());
    std::vector<std::size_t> removed;
    for (const MaskView& view : views) {
        const ImageU8 mask = dilated(view.mask, radius);
        parallel_for(Cpu{}, static_cast<int>(mesh.vertices.size()), [&](int i) {
            const auto v = static_cast<std::size_t>(i);
            const Vec3d p = mesh.vertices[v];
            const double z = dot(view.rows[2], p) + view.last.z;
            const double x = (dot(view.rows[0], p) + view.last.x) / (z + 1e-6),
                         y = (dot(view.rows[1], p) + view.last.y) / (z + 1e-6);
            const bool inside = z > 0 && x > 0 && x < mask.width - 1 && y > 0 &&
                                y < mask.height - 1;  // false behind the camera
            on_mask[v] = !inside || mask.at(static_cast<int>(std::nearbyint(x)),
                                            static_cast<int>(std::nearbyint(y))) != 0;
        });
        removed.push_back(static_cast<std::size_t>(std::count(on_mask.begin(), on_mask.end(), 0)));
        for (std::size_t v = 0; v < keep.size(); ++v) keep[v] &= on_mask[v];
    }
    keep_vertices(mesh, keep);
    return removed;
}

}  // namespace tvsgs
