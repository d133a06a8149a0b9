// The smallest mesher, from public headers alone: the depth map of each view becomes a grid of
// triangles.  [docs/develop/add-a-mesher.md]
#pragma once

#include "mesh/mesher.h"

namespace tvsgs::examples {

class GridMesher final : public Mesher<Cpu> {
public:
    ExtractedMesh extract(const MesherInputs<Cpu>& in) override {
        ExtractedMesh found;
        for (int i = 0; i < in.depth.size(); ++i) add_grid(in.depth.view(i), found.mesh);
        found.why_empty = in.depth.why_none_passed();
        if (found.why_empty.empty() && found.mesh.faces.empty())
            found.why_empty = "no pixel has neighbours";
        return found;
    }

private:
    static void add_grid(const DepthView<Cpu>& view, TriangleMesh& mesh) {
        const int width = view.camera.width_px, height = view.camera.height_px;
        std::vector<int> vertices(static_cast<std::size_t>(width * height), -1);  // by pixel
        for (int p = 0; p < width * height; ++p) {
            if (!(view.depth[p] > 0)) continue;
            vertices[static_cast<std::size_t>(p)] = static_cast<int>(mesh.vertices.size());
            mesh.vertices.push_back(unproject(view.camera, p % width, p / width, view.depth[p]));
            mesh.colors.push_back(view.color[p]);
        }
        const auto add_face = [&](int a, int b, int c) {
            const auto vertex = [&](int p) { return vertices[static_cast<std::size_t>(p)]; };
            const Vec3i face{vertex(a), vertex(b), vertex(c)};
            if (face.x >= 0 && face.y >= 0 && face.z >= 0) mesh.faces.push_back(face);
        };
        for (int y = 0; y + 1 < height; ++y)
            for (int x = 0; x + 1 < width; ++x) {
                const int p = y * width + x;  // counter-clockwise as the view sees them
                add_face(p, p + width, p + 1);
                add_face(p + 1, p + width, p + width + 1);
            }
    }
};

}  // namespace tvsgs::examples
