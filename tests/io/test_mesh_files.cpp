// Tests meshes as GLB, OBJ and PLY: content of the files by an independent parser, equal results of
// all three readers, and meshes that the writers refuse.
#include <sys/resource.h>

#include <cmath>
#include <csignal>
#include <cstring>
#include <limits>
#include <nlohmann/json.hpp>
#include <sstream>

#include "io/io_test.h"
#include "io/mesh/mesh_files.h"

namespace tvsgs {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

class MeshFiles : public IoTest {
protected:
    std::string at(const std::string& name) const { return (folder / name).string(); }
    int count() const {
        return static_cast<int>(std::distance(fs::directory_iterator(folder), {}));
    }
};

/// Two triangles that share an edge but not their texture coordinates, an unused vertex, and a
/// vertex at the position of another.
TriangleMesh two_triangles() {
    TriangleMesh mesh;
    mesh.vertices = {{0, 0, 0}, {1.1f, 0, 0}, {0, 1.7f, 0.3f}, {1, 1, -2}, {7, 8, 9}, {0, 0, 0}};
    mesh.colors = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}, {0.5f, 0.5f, 0.5f}, {1, 1, 1}, {0, 0, 0}};
    mesh.faces = {{0, 1, 2}, {2, 1, 3}, {5, 1, 3}};
    return mesh;
}
MeshTexture texture_of(const TriangleMesh&) {
    MeshTexture texture;
    texture.image = ImageU8(32, 16, 3, 90);
    for (int x = 0; x < 32; ++x) texture.image.at(x, 3, 1) = static_cast<std::uint8_t>(8 * x);
    texture.places = {{0.1f, 0.2f}, {0.3f, 0.2f}, {0.1f, 0.4f},  {0.6f, 0.4f}, {0.8f, 0.2f},
                      {0.8f, 0.4f}, {0.5f, 0.5f}, {0.55f, 0.5f}, {0.5f, 0.75f}};
    texture.faces = {{0, 1, 2}, {3, 4, 5}, {6, 7, 8}};
    return texture;
}

/// Rotation by 30 degrees about z, then about x.
Mat3<double> some_turn() {
    const double c = std::cos(M_PI / 6), s = 0.5;
    const Mat3<double> z{{{c, -s, 0}, {s, c, 0}, {0, 0, 1}}}, x{{{1, 0, 0}, {0, c, -s}, {0, s, c}}};
    return x * z;
}

// A parser of GLB that shares no code with the program's.
struct Glb {
    json doc;
    std::string binary;

    explicit Glb(const std::string& bytes) {
        const auto u32 = [&](std::size_t at) {
            std::uint32_t value = 0;
            for (std::size_t i = 4; i-- > 0;)
                value = value << 8 | static_cast<unsigned char>(bytes.at(at + i));
            return value;
        };
        EXPECT_EQ(bytes.substr(0, 4), "glTF");
        EXPECT_EQ(u32(4), 2u);
        EXPECT_EQ(u32(8), bytes.size());
        EXPECT_EQ(bytes.size() % 4, 0u);
        const std::size_t length = u32(12);
        EXPECT_EQ(bytes.substr(16, 4), "JSON");
        EXPECT_EQ(length % 4, 0u);
        doc = json::parse(bytes.substr(20, length));
        if (20 + length == bytes.size()) return;
        const std::size_t bin = 20 + length;
        EXPECT_EQ(bytes.substr(bin + 4, 4), std::string("BIN\0", 4));
        EXPECT_EQ(u32(bin) % 4, 0u);
        binary = bytes.substr(bin + 8);
        EXPECT_EQ(binary.size(), u32(bin));
        EXPECT_EQ(doc["buffers"][0]["byteLength"], binary.size());
        for (const json& view : doc["bufferViews"]) {
            EXPECT_EQ(view["byteOffset"].get<std::size_t>() % 4, 0u);
            EXPECT_LE(view["byteOffset"].get<std::size_t>() + view["byteLength"].get<std::size_t>(),
                      binary.size());
        }
    }
    std::string view(int i) const {
        const json& v = doc["bufferViews"][static_cast<std::size_t>(i)];
        return binary.substr(v["byteOffset"], v["byteLength"]);
    }
    template <class T>
    std::vector<T> numbers(const json& accessor_index, int component) const {
        const json& accessor = doc["accessors"][accessor_index.get<std::size_t>()];
        EXPECT_EQ(accessor["componentType"], component);
        const std::string bytes =
            view(accessor["bufferView"]).substr(accessor.value("byteOffset", std::size_t{0}));
        const std::size_t width = accessor["type"] == "SCALAR" ? 1
                                  : accessor["type"] == "VEC2" ? 2
                                  : accessor["type"] == "VEC3" ? 3
                                                               : 4;
        const json& of = doc["bufferViews"][accessor["bufferView"].get<std::size_t>()];
        EXPECT_EQ(of.value("byteStride", width * sizeof(T)), width * sizeof(T));
        std::vector<T> out(accessor["count"].get<std::size_t>() * width);
        EXPECT_LE(out.size() * sizeof(T), bytes.size());
        std::memcpy(out.data(), bytes.data(), std::min(bytes.size(), out.size() * sizeof(T)));
        return out;
    }
    const json& primitive() const { return doc["meshes"][0]["primitives"][0]; }
};

TEST_F(MeshFiles, WhatIsInATexturedGlb) {
    const TriangleMesh mesh = two_triangles();
    const MeshTexture texture = texture_of(mesh);
    const Mat3<double> R = some_turn();
    write_mesh(at("a.glb"), mesh, texture,
               {.origin = {5e5, 4e6, 7},
                .projection = "EPSG:32632",
                .normals = true,
                .upright_from_scene = R});
    const Glb glb(read_bytes(at("a.glb")));
    EXPECT_EQ(glb.doc["asset"]["version"], "2.0");
    EXPECT_TRUE(glb.doc["asset"]["generator"].get<std::string>().starts_with("tvsgs "));
    EXPECT_EQ(glb.doc["asset"]["extras"]["origin"], (json{5e5, 4e6, 7.0}));
    EXPECT_EQ(glb.doc["asset"]["extras"]["projection"], "EPSG:32632");
    EXPECT_EQ(glb.doc["scenes"][0]["nodes"], json::array({0}));
    const json& matrix = glb.doc["nodes"][0]["matrix"];
    ASSERT_EQ(matrix.size(), 16u);
    for (std::size_t row = 0; row < 3; ++row)
        for (std::size_t column = 0; column < 3; ++column)
            EXPECT_EQ(matrix[4 * column + row], R.m[row][column]) << "columns come first";
    for (const std::size_t i : {3u, 7u, 11u, 12u, 13u, 14u}) EXPECT_EQ(matrix[i], 0);
    EXPECT_EQ(matrix[15], 1);

    const json& primitive = glb.primitive();
    EXPECT_EQ(primitive["mode"], 4);
    EXPECT_FALSE(primitive["attributes"].contains("COLOR_0")) << "it would darken the texture";
    const auto positions = glb.numbers<float>(primitive["attributes"]["POSITION"], 5126);
    const auto normals = glb.numbers<float>(primitive["attributes"]["NORMAL"], 5126);
    const auto places = glb.numbers<float>(primitive["attributes"]["TEXCOORD_0"], 5126);
    const auto indices = glb.numbers<std::uint16_t>(primitive["indices"], 5123);
    ASSERT_EQ(positions.size(), 3u * 9) << "a vertex for each place in the texture";
    ASSERT_EQ(normals.size(), positions.size());
    ASSERT_EQ(places.size(), 2u * 9);
    Vec3f lower = mesh.vertices[0], upper = lower;
    for (std::size_t i = 0; i < positions.size(); ++i) {
        const int a = static_cast<int>(i % 3);
        lower[a] = std::min(lower[a], positions[i]), upper[a] = std::max(upper[a], positions[i]);
    }
    const json& accessor =
        glb.doc["accessors"][primitive["attributes"]["POSITION"].get<std::size_t>()];
    EXPECT_EQ(accessor["min"], (json{lower.x, lower.y, lower.z}));
    EXPECT_EQ(accessor["max"], (json{upper.x, upper.y, upper.z}));
    for (std::size_t i = 0; i < normals.size(); i += 3)
        EXPECT_NEAR(std::hypot(normals[i], normals[i + 1], normals[i + 2]), 1, 1e-6);
    const std::vector<Vec3f> expected = vertex_normals(mesh);
    ASSERT_EQ(indices.size(), 9u);
    EXPECT_EQ(normals[std::size_t{3} * indices[5] + 2], expected[3].z);
    for (std::size_t k = 0; k < 9; ++k) {
        const int corner = static_cast<int>(k % 3);
        const Vec3f v = mesh.vertices[mesh.faces[k / 3][corner]];
        const Vec2f place = texture.places[texture.faces[k / 3][corner]];
        const std::size_t i = indices[k];
        for (int a = 0; a < 3; ++a) EXPECT_EQ(positions[3 * i + static_cast<std::size_t>(a)], v[a]);
        EXPECT_EQ(places[2 * i], place.x);
        EXPECT_EQ(places[2 * i + 1], place.y) << "down from the top";
    }
    for (const auto& [name, target] : {std::pair{"POSITION", 34962}, {"TEXCOORD_0", 34962}}) {
        const json& a = glb.doc["accessors"][primitive["attributes"][name].get<std::size_t>()];
        EXPECT_EQ(glb.doc["bufferViews"][a["bufferView"].get<std::size_t>()]["target"], target);
    }
    const json& material = glb.doc["materials"][primitive["material"].get<std::size_t>()];
    EXPECT_TRUE(material["extensions"].contains("KHR_materials_unlit"));
    EXPECT_EQ(glb.doc["extensionsUsed"], json::array({"KHR_materials_unlit"}));
    EXPECT_EQ(material["doubleSided"], true);
    EXPECT_EQ(material["pbrMetallicRoughness"]["metallicFactor"], 0);
    EXPECT_EQ(material["pbrMetallicRoughness"]["baseColorTexture"]["index"], 0);
    EXPECT_EQ(glb.doc["images"][0]["mimeType"], "image/jpeg");
    const ImageU8 picture =
        decode_image("picture", glb.view(glb.doc["images"][0]["bufferView"].get<int>()));
    EXPECT_EQ(picture.width, 32);
    EXPECT_NEAR(picture.at(20, 10, 2), 90, 4);
}

TEST_F(MeshFiles, TexturesAsPngAndWebp) {
    const TriangleMesh mesh = two_triangles();
    const MeshTexture texture = texture_of(mesh);
    write_mesh(at("a.glb"), mesh, texture, {.texture_format = TextureFormat::png});
    const Glb png(read_bytes(at("a.glb")));
    EXPECT_EQ(png.doc["images"][0]["mimeType"], "image/png");
    const int view = png.doc["images"][0]["bufferView"];
    EXPECT_EQ(decode_image("png", png.view(view)).pixels, texture.image.pixels) << "without loss";
    EXPECT_FALSE(png.doc["nodes"][0].contains("matrix")) << "axes are kept unless they are turned";

    const MeshFileOptions webp{.texture_format = TextureFormat::webp};
    expect_error(ExitCode::usage, "b.obj: an OBJ needs a texture in jpg or png",
                 [&] { write_mesh(at("b.obj"), mesh, texture, webp); });
    write_mesh(at("b.glb"), mesh, texture, webp);
    const Glb glb(read_bytes(at("b.glb")));
    EXPECT_EQ(glb.doc["textures"][0]["extensions"]["EXT_texture_webp"]["source"], 0);
    EXPECT_FALSE(glb.doc["textures"][0].contains("source"));
    EXPECT_EQ(glb.doc["extensionsRequired"], json::array({"EXT_texture_webp"}));
    const std::string bytes = glb.view(glb.doc["images"][0]["bufferView"].get<int>());
    EXPECT_EQ(bytes.substr(0, 4) + bytes.substr(8, 4), "RIFFWEBP");
    EXPECT_EQ(read_mesh_geometry(at("b.glb")).faces.size(), 3u);
}

TEST_F(MeshFiles, ColoursOfVerticesAreLinearInAGlb) {
    const TriangleMesh mesh = two_triangles();
    write_mesh(at("a.glb"), mesh);
    const Glb glb(read_bytes(at("a.glb")));
    const json& attributes = glb.primitive()["attributes"];
    EXPECT_FALSE(attributes.contains("TEXCOORD_0"));
    const auto colors = glb.numbers<std::uint16_t>(attributes["COLOR_0"], 5123);
    EXPECT_FALSE(attributes.contains("NORMAL")) << "the material is unlit";
    ASSERT_EQ(colors.size(), 4u * 5) << "a vertex that no face has is not in the file";
    EXPECT_EQ(glb.doc["accessors"][attributes["COLOR_0"].get<std::size_t>()]["normalized"], true);
    EXPECT_EQ(colors[0], 65535);
    EXPECT_EQ(colors[1], 0);
    EXPECT_NEAR(colors[4 * 3], 0.21404 * 65535, 1) << "half of sRGB is a fifth of the light";
    EXPECT_EQ(colors[4 * 3 + 3], 65535) << "opaque";
    const PlyContents back = read_mesh(at("a.glb"));
    ASSERT_EQ(back.points.colors.size(), 4u) << "of two at one place the first";
    for (std::size_t i = 0; i < 4; ++i)
        EXPECT_LT(norm(back.points.colors[i] - mesh.colors[i]), 1e-3);
}

/// All formats give the same mesh, bit by bit: near and far, rotated, with and without texture.
TEST_F(MeshFiles, AllFormatsAreReadAsTheSameMesh) {
    const TriangleMesh mesh = two_triangles();
    for (const Vec3d origin : {Vec3d{}, Vec3d{500000.25, 4e6, -12}})
        for (const bool textured : {false, true}) {
            const MeshTexture texture = textured ? texture_of(mesh) : MeshTexture{};
            const MeshFileOptions options{.origin = origin,
                                          .projection = "+proj=utm +zone=32",
                                          .upright_from_scene = some_turn()};
            const PlyGeometry expected = [&] {
                write_mesh(at("a.ply"), mesh, texture, options);
                EXPECT_NE(read_bytes(at("a.ply")).find("\ncomment projection +proj=utm +zone=32\n"),
                          std::string::npos);
                return read_mesh_geometry(at("a.ply"));
            }();
            for (const char* name : {"a.glb", "a.obj"}) {
                SCOPED_TRACE(str(name, textured ? " textured" : "", " from ", origin.x));
                write_mesh(at(name), mesh, texture, options);
                EXPECT_NE(read_bytes(at(name)).find("+proj=utm +zone=32"), std::string::npos);
                const PlyGeometry found = read_mesh_geometry(at(name));
                // A GLB has only vertices of faces, and each position once.
                ASSERT_EQ(found.positions.size(),
                          mesh_format(name) == MeshFormat::glb ? 4 : mesh.vertices.size());
                const PlyContents local = read_mesh(at(name), origin);
                ASSERT_EQ(found.faces.size(), mesh.faces.size());
                for (std::size_t f = 0; f < mesh.faces.size(); ++f)
                    for (int c = 0; c < 3; ++c) {
                        const Vec3d p = found.positions[found.faces[f][c]],
                                    q = expected.positions[mesh.faces[f][c]];
                        for (int a = 0; a < 3; ++a)
                            // Near 0 an OBJ has the shortest text of the float, not of its double.
                            if (mesh_format(name) == MeshFormat::obj && origin.x == 0)
                                EXPECT_EQ(static_cast<float>(p[a]), static_cast<float>(q[a])) << f;
                            else
                                EXPECT_EQ(p[a], q[a]) << f;
                        EXPECT_LT(norm(local.points.positions[local.faces[f][c]] -
                                       mesh.vertices[mesh.faces[f][c]]),
                                  1e-9);
                    }
            }
        }
}

TEST_F(MeshFiles, ATexturedGlbGivesItsColoursToVertices) {
    TriangleMesh mesh = two_triangles();
    mesh.faces = {{0, 1, 2}};
    MeshTexture texture;
    texture.image = ImageU8(8, 4, 3, 0);
    texture.image.at(5, 3, 0) = 255;
    texture.places = {{5.5f / 8, 3.5f / 4}, {0.1f, 0.1f}, {0.1f, 0.3f}};
    texture.faces = {{0, 1, 2}};
    write_mesh(at("a.glb"), mesh, texture, {.texture_format = TextureFormat::png});
    const PlyContents back = read_mesh(at("a.glb"));
    ASSERT_EQ(back.points.colors.size(), 3u);
    EXPECT_EQ(back.points.colors[0].x, 1);
    EXPECT_EQ(back.points.colors[1].x, 0);
}

TEST_F(MeshFiles, AnObjWithItsMaterialAndPicture) {
    const TriangleMesh mesh = two_triangles();
    const MeshTexture texture = texture_of(mesh);
    for (const auto& [format, picture] :
         {std::pair{TextureFormat::jpeg, "a_texture.jpg"}, {TextureFormat::png, "a_texture.png"}}) {
        write_mesh(at("a.obj"), mesh, texture, {.texture_format = format});
        // The first bytes identify our files, so they may be replaced.
        write_mesh(at("a.obj"), mesh, texture, {.texture_format = format});
        EXPECT_NE(read_bytes(at("a.mtl")).find(str("map_Kd ", picture, "\n")), std::string::npos);
        EXPECT_EQ(read_image(at(picture)).width, 32);
    }
    EXPECT_EQ(read_image(at("a_texture.png")).pixels, texture.image.pixels);
    EXPECT_EQ(count(), 4);
    std::istringstream lines(read_bytes(at("a.obj")));
    std::vector<Vec2f> places;
    std::vector<std::string> faces;
    bool material = false;
    for (std::string line; std::getline(lines, line);) {
        std::istringstream words(line);
        std::string kind;
        words >> kind;
        material = material || line == "mtllib a.mtl";
        if (kind == "vt") {
            Vec2f p;
            words >> p.x >> p.y;
            places.push_back(p);
        } else if (kind == "f") {
            faces.push_back(line);
        }
    }
    EXPECT_TRUE(material);
    ASSERT_EQ(places.size(), texture.places.size());
    EXPECT_NEAR(places[8].x, 0.5f, 1e-7);
    EXPECT_NEAR(places[8].y, 0.25f, 1e-7) << "up from the bottom";
    EXPECT_EQ(faces.at(1), "f 3/4 2/5 4/6");

    // A file of another program stays, and then no file of the mesh is written.
    write("b_texture.jpg", "mine");
    expect_error(ExitCode::usage, "b_texture.jpg", [&] { write_mesh(at("b.obj"), mesh, texture); });
    EXPECT_FALSE(fs::exists(at("b.obj")) || fs::exists(at("b.mtl")));
}

TEST_F(MeshFiles, BadMeshesAreNotWritten) {
    for (const char* name : {"a.glb", "a.obj", "a.ply"}) {
        TriangleMesh mesh = two_triangles();
        mesh.vertices[1].y = std::numeric_limits<float>::quiet_NaN();
        expect_error(ExitCode::numerical, "vertex 1 is (1.1, nan, 0)",
                     [&] { write_mesh(at(name), mesh); });
        mesh = two_triangles();
        mesh.faces[1].z = 6;
        expect_error(ExitCode::internal, "refers to vertex 6 of 6",
                     [&] { write_mesh(at(name), mesh); });
        mesh = two_triangles();
        mesh.colors.pop_back();
        expect_error(ExitCode::internal, "5 colours", [&] { write_mesh(at(name), mesh); });
    }
    const TriangleMesh mesh = two_triangles();
    MeshTexture texture = texture_of(mesh);
    texture.faces[1].x = 0;  // texture coordinate of vertex 0
    expect_error(ExitCode::internal, "two vertices",
                 [&] { write_mesh(at("a.glb"), mesh, texture); });
    texture.faces.pop_back();
    expect_error(ExitCode::internal, "2 textured faces of 3",
                 [&] { write_mesh(at("a.glb"), mesh, texture); });
    EXPECT_EQ(count(), 0);
}

/// A limit on file sizes simulates a full disk.
TEST_F(MeshFiles, NothingIsLeftOfWhatDoesNotFit) {
    const TriangleMesh mesh = two_triangles();
    MeshTexture texture = texture_of(mesh);
    texture.image = ImageU8(64, 64, 3);
    std::signal(SIGXFSZ, SIG_IGN);
    rlimit before{};
    getrlimit(RLIMIT_FSIZE, &before);
    for (const char* name : {"a.glb", "a.obj", "a.ply"}) {
        // Below the largest file of each format; of an OBJ the image fits and the text does not.
        write_mesh(at(name), mesh, texture, {.texture_format = TextureFormat::png});
        const std::size_t size = fs::file_size(at(name));
        if (std::string(name) == "a.obj") {
            EXPECT_LT(fs::file_size(at("a_texture.png")), size);
        }
        for (const auto& entry : fs::directory_iterator(folder)) fs::remove(entry.path());
        rlimit less = before;
        less.rlim_cur = size - 1;
        setrlimit(RLIMIT_FSIZE, &less);
        expect_error(ExitCode::io, name, [&] {
            write_mesh(at(name), mesh, texture, {.texture_format = TextureFormat::png});
        });
        setrlimit(RLIMIT_FSIZE, &before);
        EXPECT_EQ(count(), 0) << name;
    }
    std::signal(SIGXFSZ, SIG_DFL);
    expect_error(ExitCode::io, "/dev/full", [&] { write_mesh("/dev/full", mesh, texture); });
}

/// A strip of adjacent triangles; each `chart` of them has separate texture coordinates.
TEST_F(MeshFiles, LargeMeshesAreInPartsOf16BitIndices) {
    const int vertices = 150000, chart = 1000;
    TriangleMesh mesh;
    MeshTexture texture;
    texture.image = ImageU8(16, 16, 3, 100);
    for (int i = 0; i < vertices; ++i)
        mesh.vertices.push_back({static_cast<float>(i), static_cast<float>(i % 7), 0});
    for (int i = 0; i + 2 < vertices; ++i) {
        mesh.faces.push_back({i, i + 1, i + 2});
        if (i % chart == 0) texture.places.insert(texture.places.end(), 2, {0.1f, 0.2f});
        const float u = static_cast<float>(i % chart) / static_cast<float>(chart);
        texture.places.push_back({u, 0.5f});
        const int last = static_cast<int>(texture.places.size()) - 1;
        texture.faces.push_back({last - 2, last - 1, last});
    }
    for (const bool textured : {false, true}) {
        write_mesh(at("a.glb"), mesh, textured ? texture : MeshTexture{});
        const Glb glb(read_bytes(at("a.glb")));
        const json& primitives = glb.doc["meshes"][0]["primitives"];
        EXPECT_EQ(primitives.size(), 3u);
        std::size_t face = 0, all_vertices = 0;
        for (const json& primitive : primitives) {
            const json& attributes = primitive["attributes"];
            const auto positions = glb.numbers<float>(attributes["POSITION"], 5126);
            const auto indices = glb.numbers<std::uint16_t>(primitive["indices"], 5123);
            const auto places = textured ? glb.numbers<float>(attributes["TEXCOORD_0"], 5126)
                                         : std::vector<float>{};
            EXPECT_LE(positions.size(), 3u * 65535) << "index 65535 begins a new strip";
            all_vertices += positions.size() / 3;
            for (std::size_t k = 0; k < indices.size(); ++k) {
                const int corner = static_cast<int>(k % 3);
                const std::size_t i = indices[k], f = face + k / 3;
                ASSERT_LT(i, positions.size() / 3);
                ASSERT_EQ(positions[3 * i], mesh.vertices[mesh.faces[f][corner]].x) << f;
                if (textured) {
                    ASSERT_EQ(places[2 * i], texture.places[texture.faces[f][corner]].x) << f;
                }
            }
            face += indices.size() / 3;
        }
        EXPECT_EQ(face, mesh.faces.size());
        EXPECT_LE(all_vertices, (textured ? texture.places.size() : mesh.vertices.size()) + 2 * 2);
        const PlyGeometry back = read_mesh_geometry(at("a.glb"));
        ASSERT_EQ(back.positions.size(), mesh.vertices.size());
        for (std::size_t f = 0; f < mesh.faces.size(); ++f)
            for (int c = 0; c < 3; ++c) ASSERT_EQ(back.faces[f][c], mesh.faces[f][c]) << f;
    }
}

TEST_F(MeshFiles, WhatNoGlbHoldsIsRefused) {
    EXPECT_NO_THROW(require_glb_room("a.glb", 100000000, 200000000, true));
    expect_error(ExitCode::input, "a GLB has at most 2^32; write a .ply, or make a coarser mesh",
                 [&] { require_glb_room("a.glb", 160000000, 200000000, true); });
    EXPECT_NO_THROW(require_glb_room("a.glb", 160000000, 200000000, false));
    expect_error(ExitCode::input, "a.glb: not written: 800,000,000 faces",
                 [&] { require_glb_room("a.glb", 1, 800000000, false); });
}

/// Readers of OBJ end names at blanks.
TEST_F(MeshFiles, ObjsWithBlanksInTheirNames) {
    const TriangleMesh mesh = two_triangles();
    write_mesh(at("my #1 mesh.obj"), mesh, texture_of(mesh));
    EXPECT_NE(read_bytes(at("my #1 mesh.obj")).find("\nmtllib my__1_mesh.mtl\n"),
              std::string::npos);
    EXPECT_NE(read_bytes(at("my__1_mesh.mtl")).find("\nmap_Kd my__1_mesh_texture.jpg\n"),
              std::string::npos);
    EXPECT_EQ(read_image(at("my__1_mesh_texture.jpg")).width, 32);
    EXPECT_EQ(read_mesh_geometry(at("my #1 mesh.obj")).faces.size(), 3u);
    EXPECT_EQ(mesh_files(at("my #1 mesh.obj"), false, TextureFormat::jpeg).size(), 1u);
}

TEST_F(MeshFiles, AMeshWithoutFacesIsAnEmptyScene) {
    write_mesh(at("a.glb"), {});
    const Glb glb(read_bytes(at("a.glb")));
    EXPECT_EQ(glb.doc["scenes"].size(), 1u);
    for (const char* key : {"meshes", "accessors", "buffers", "nodes"})
        EXPECT_FALSE(glb.doc.contains(key)) << key;
    expect_error(ExitCode::input, "no triangles", [&] { read_mesh(at("a.glb")); });
}

}  // namespace
}  // namespace tvsgs
