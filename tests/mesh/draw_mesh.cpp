// draw_mesh OUT.jpg WIDTH SCENE PHOTOGRAPH {MESH.obj PANEL...}...: draws panels of WIDTH pixels
// side by side for scripts/photographs_page.sh and scripts/readme_picture.sh. PANEL: photo, texture
// or plain (the mesh from the place of the photograph), or texture:45, plain:-45 (from so many
// degrees to the right around the surface).
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <sstream>

#include "core/error.h"
#include "io/images/image_file.h"
#include "io/scene/scene_reader.h"
#include "mesh/draw/mesh_render.h"

namespace tvsgs::test {
namespace {

struct TexturedMesh {
    TriangleMesh mesh;
    MeshTexture texture;
};

/// Reads an OBJ of tvsgs-extract-mesh with its texture into the frame of a scene.
TexturedMesh read_obj(const std::string& path, Vec3d origin) {
    const auto open = [](const std::string& name) {
        std::ifstream file(name);
        if (!file) throw Error(ExitCode::io, name, ": cannot be read");
        return file;
    };
    const std::string folder = path.substr(0, path.find_last_of('/') + 1);
    TexturedMesh out;
    std::ifstream file = open(path);
    for (std::string line, word; std::getline(file, line);) {
        std::istringstream words(line);
        if (!(words >> word)) continue;
        if (word == "v") {
            Vec3d p;
            words >> p.x >> p.y >> p.z;
            out.mesh.vertices.push_back(vec_cast<float>(p - origin));
        } else if (word == "vt") {
            Vec2f p;
            words >> p.x >> p.y;
            out.texture.places.push_back({p.x, 1 - p.y});
        } else if (word == "f") {
            Vec3i corner, place;
            for (int k = 0; k < 3; ++k) {
                words >> word;
                if (std::sscanf(word.c_str(), "%d/%d", &corner[k], &place[k]) < 2)
                    throw Error(ExitCode::input, path, ": no texture: ", line);
                --corner[k], --place[k];
            }
            out.mesh.faces.push_back(corner), out.texture.faces.push_back(place);
        } else if (word == "mtllib") {
            words >> word;
            std::ifstream material = open(folder + word);
            while (std::getline(material, line))
                if (line.starts_with("map_Kd "))
                    out.texture.image = read_image(folder + line.substr(7), 3);
        }
    }
    if (out.texture.empty()) throw Error(ExitCode::input, path, ": no texture");
    return out;
}

/// The camera, turned around the surface in the middle of its picture, about the upright axis.
Camera turned(Camera camera, const TriangleMesh& mesh, double degrees, Vec3d up) {
    if (degrees == 0) return camera;
    const ImageF depth = render_depth(mesh, camera);
    std::vector<float> middle;
    for (int y = depth.height / 3; y < 2 * depth.height / 3; ++y)
        for (int x = depth.width / 3; x < 2 * depth.width / 3; ++x)
            if (depth.at(x, y) > 0) middle.push_back(depth.at(x, y));
    if (middle.empty()) throw Error(ExitCode::input, "no surface in the middle of the photograph");
    std::ranges::nth_element(middle, middle.begin() + std::ptrdiff_t(middle.size() / 2));
    const Vec3d pivot{0, 0, double(middle[middle.size() / 2])};
    const Vec3d axis = normalize(mat_cast<double>(camera.camera_from_world.R) * up);
    const double half = degrees * std::acos(-1.0) / 360, s = std::sin(half);
    const Mat3<double> turn =
        rotation(Quat<double>{std::cos(half), s * axis.x, s * axis.y, s * axis.z});
    const Rigid3f& from = camera.camera_from_world;
    camera.camera_from_world = {mat_cast<float>(turn * mat_cast<double>(from.R)),
                                vec_cast<float>(turn * (vec_cast<double>(from.t) - pivot) + pivot)};
    return camera;
}

void draw(int argc, char** argv) {
    if (argc < 7) throw Error(ExitCode::usage, "draw_mesh: see the first lines of its source");
    SceneOptions options;
    options.path = argv[3];
    options.need_points = false;
    if (!std::filesystem::is_directory(options.path + "/images"))
        options.images = "image";  // of DTU
    const Scene scene = read_scene(options);
    const View* view = nullptr;
    for (const View& each : scene.train)
        if (each.name == argv[4]) view = &each;
    if (view == nullptr) throw Error(ExitCode::input, argv[4], ": not in ", argv[3]);
    const Mat3<double> upright = upright_from_scene(upright_cameras(scene.train));
    const Vec3d up{upright[1][0], upright[1][1], upright[1][2]};
    const Camera whole = turned_camera(view->camera, view->upright_turns);
    const ImageU8 photo = turned_clockwise(view->photo, view->upright_turns);
    const int width = std::stoi(argv[2]),
              height = (width * whole.height_px + whole.width_px / 2) / whole.width_px;
    const Camera camera = scaled_camera(whole, width, height);
    std::vector<ImageU8> panels;
    TexturedMesh found;
    for (int k = 5; k < argc; ++k) {
        const std::string panel = argv[k];
        if (panel.ends_with(".obj")) {
            found = read_obj(panel, scene.origin);
            continue;
        }
        const auto colon = panel.find(':');
        const std::string kind = panel.substr(0, colon);
        const double degrees = colon == std::string::npos ? 0 : std::stod(panel.substr(colon + 1));
        if (kind == "photo")
            panels.push_back(resize_bicubic(photo, width, height));
        else if (kind == "texture" || kind == "plain")
            panels.push_back(preview_mesh(found.mesh, turned(camera, found.mesh, degrees, up),
                                          kind == "plain" ? MeshTexture{} : found.texture));
        else
            throw Error(ExitCode::usage, panel, ": expected photo, texture or plain");
    }
    constexpr int kGap = 4;
    ImageU8 strip(static_cast<int>(panels.size()) * (width + kGap) - kGap, height, 3, 255);
    for (std::size_t k = 0; k < panels.size(); ++k)
        for (int y = 0; y < height; ++y)
            for (int x = 0; x < width; ++x)
                for (int c = 0; c < 3; ++c)
                    strip.at(static_cast<int>(k) * (width + kGap) + x, y, c) =
                        panels[k].at(x, y, c);
    std::ofstream(argv[1], std::ios::binary) << jpeg_bytes(strip, 75);
}

}  // namespace
}  // namespace tvsgs::test

int main(int argc, char** argv) {
    try {
        tvsgs::test::draw(argc, argv);
    } catch (const tvsgs::Error& error) {
        std::fprintf(stderr, "%s\n", error.what());
        return static_cast<int>(error.code());
    }
}
