// Tests reading of GLB and OBJ files of other programs, and of hostile ones.
#include <nlohmann/json.hpp>

#include "io/io_test.h"
#include "io/mesh/mesh_files.h"

namespace tvsgs {
namespace {

using nlohmann::json;
using MeshFilesOfOthers = IoTest;

std::string glb_of(const json& doc, std::string binary) {
    std::string text = doc.dump();
    text.resize((text.size() + 3) / 4 * 4, ' ');
    binary.resize((binary.size() + 3) / 4 * 4, '\0');
    const auto u32 = [](std::size_t v) {
        const auto n = static_cast<std::uint32_t>(v);
        return std::string(reinterpret_cast<const char*>(&n), 4);
    };
    return "glTF" + u32(2) + u32(28 + text.size() + binary.size()) + u32(text.size()) + "JSON" +
           text + u32(binary.size()) + std::string("BIN\0", 4) + binary;
}
template <class T>
std::string raw(std::initializer_list<T> values) {
    return {reinterpret_cast<const char*>(values.begin()), values.size() * sizeof(T)};
}

/// A triangle in the plane z = 0, indices in bytes.
struct OneTriangle {
    std::string binary = raw<float>({0, 0, 0, 1, 0, 0, 0, 1, 0}) + raw<std::uint8_t>({0, 1, 2, 0});
    json doc = json::parse(R"({"asset": {"version": "2.0"}, "scene": 0,
        "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "buffers": [{"byteLength": 40}],
        "bufferViews": [{"buffer": 0, "byteLength": 36},
                        {"buffer": 0, "byteOffset": 36, "byteLength": 3}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "type": "VEC3", "count": 3},
                      {"bufferView": 1, "componentType": 5121, "type": "SCALAR", "count": 3}]})");
    std::string bytes() const { return glb_of(doc, binary); }
};

TEST_F(MeshFilesOfOthers, NodesPlaceTheMeshesOfOthers) {
    OneTriangle file;
    file.doc["nodes"] = json::parse(R"([
        {"children": [1, 2], "translation": [10, 0, 0], "scale": [2, 2, 2]},
        {"mesh": 0, "rotation": [0, 0, 0.7071067811865476, 0.7071067811865476]},
        {"mesh": 0, "matrix": [1,0,0,0, 0,1,0,0, 0,0,1,0, 0,0,5,1]}])");
    const PlyGeometry found = read_mesh_geometry(write("a.glb", file.bytes()));
    ASSERT_EQ(found.positions.size(), 6u);
    ASSERT_EQ(found.faces.size(), 2u);
    EXPECT_EQ(found.faces[1].x, 3);
    // (1, 0, 0) rotated by 90 degrees about z, doubled, moved.
    EXPECT_LT(norm(found.positions[1] - Vec3d{10, 2, 0}), 1e-12);
    EXPECT_LT(norm(found.positions[4] - Vec3d{12, 0, 10}), 1e-12);
    // Our file without its node's rotation: an editor applied it, so the file no longer counts as
    // ours.
    file.doc["asset"] = json::parse(
        R"({"version": "2.0", "generator": "editor", "extras": {"origin": [9, 9, 9], "vertices": 3}})");
    EXPECT_LT(norm(read_mesh_geometry(write("b.glb", file.bytes())).positions[1] - Vec3d{10, 2, 0}),
              1e-12);
}

TEST_F(MeshFilesOfOthers, QuantisedAndInterleavedNumbers) {
    OneTriangle file;  // shorts of 1 / 32767, eight bytes apart, scaled by the node
    file.binary = raw<std::int16_t>({0, 0, 0, 0, 32767, 0, 0, 0, 0, -32768, 0, 0}) +
                  raw<std::uint16_t>({0, 1, 2});
    file.doc["bufferViews"] = json::parse(R"([{"buffer": 0, "byteLength": 24, "byteStride": 8},
        {"buffer": 0, "byteOffset": 24, "byteLength": 6}])");
    file.doc["accessors"][0]["componentType"] = 5122, file.doc["accessors"][0]["normalized"] = true;
    file.doc["accessors"][1]["componentType"] = 5123;
    file.doc["nodes"][0]["scale"] = {3, 4, 5};
    file.doc["extensionsRequired"] = json::array({"KHR_mesh_quantization"});
    const PlyGeometry found = read_mesh_geometry(write("a.glb", file.bytes()));
    EXPECT_EQ(found.positions.at(1).x, 3);
    EXPECT_EQ(found.positions.at(2).y, -4) << "-32768 is -1 as well";
}

TEST_F(MeshFilesOfOthers, HostileGlbs) {
    const auto refused = [&](const std::string& bytes, const std::string& says) {
        const std::string path = write("bad.glb", bytes);
        expect_error(ExitCode::input, says, [&] { read_mesh(path); });
        expect_error(ExitCode::input, says, [&] { read_mesh_geometry(path); });
    };
    const std::string good = OneTriangle().bytes();
    ASSERT_NO_THROW(read_mesh_geometry(write("good.glb", good)));
    for (std::size_t n = 0; n + 1 < good.size(); n += 5) refused(good.substr(0, n), "bad.glb");
    refused("solid of something else, longer than a header", "not a binary glTF");
    refused(good.substr(0, 4) + raw<std::uint32_t>({1}) + good.substr(8), "version 1; expected 2");
    refused(std::string(good).replace(12, 4, raw<std::uint32_t>({0xfffffff0u})), "chunk 0 claims");

    struct Damage {
        const char* pointer;
        json value;
        const char* says;
    };
    for (const Damage& d : {
             Damage{"/nodes/0/children", json::array({0}), "two parents, or is its own"},
             Damage{"/nodes/0/children", json::array({7}), "refers to a missing node"},
             Damage{"/nodes/0/children", json::array({-1}), "refers to a missing node"},
             Damage{"/nodes/0/mesh", 3, "\"mesh\" refers to a missing element"},
             Damage{"/nodes/0/scale", json::array({1, 2}), "expected 3 finite numbers"},
             Damage{"/nodes/0/matrix", json::array({"x"}), "expected 16 finite numbers"},
             Damage{"/scenes", 5, "is not a list"},
             Damage{"/scenes/0/nodes", json::array(), "no triangles"},
             Damage{"/scene", 1, "\"scene\" refers to a missing element"},
             Damage{"/scene", -1, "\"scene\" is not a whole number"},
             Damage{"/accessors/0/count", 4, "do not fit into their buffer view"},
             Damage{"/accessors/0/count", 0xffffffffffffffffull, "do not fit"},
             Damage{"/accessors/0/count", 1.5, "is not a whole number"},
             Damage{"/accessors/0/count", 2, "refers to vertex 2 of 2"},
             Damage{"/accessors/0/byteOffset", 0xfffffffffffffff0ull, "do not fit"},
             Damage{"/accessors/0/type", "VEC4", "expected an accessor of type VEC3"},
             Damage{"/accessors/0/componentType", 5130, "unknown componentType 5130"},
             Damage{"/accessors/0/sparse", json::object(), "a sparse or empty accessor"},
             Damage{"/accessors/1/componentType", 5120, "expected an unsigned componentType"},
             Damage{"/accessors/1/count", 2, "not a multiple of 3"},
             Damage{"/accessors/1/bufferView", 2, "refers to a missing element"},
             Damage{"/bufferViews/0/byteOffset", 0xfffffffffffffff0ull, "exceeds the buffer"},
             Damage{"/bufferViews/0/byteLength", 100, "exceeds the buffer"},
             Damage{"/bufferViews/0/byteStride", 4, "do not fit"},
             Damage{"/bufferViews/0/byteStride", 0xffffffffffffffffull, "do not fit"},
             Damage{"/bufferViews/0/buffer", 1, "in another file, or compressed"},
             Damage{"/bufferViews/0/extensions", json{{"EXT_meshopt_compression", 1}},
                    "compressed"},
             Damage{"/meshes/0/primitives/0/mode", 1, "expected triangles"},
             Damage{"/extensionsRequired", json::array({"KHR_draco_mesh_compression"}),
                    "needs the unknown extension 'KHR_draco_mesh_compression'"},
         }) {
        SCOPED_TRACE(str(d.pointer, " = ", d.value.dump()));
        OneTriangle file;
        file.doc[json::json_pointer(d.pointer)] = d.value;
        refused(file.bytes(), d.says);
    }
    // Copies of one array: 3000 of 30,000 corners.
    OneTriangle copies;
    copies.binary += std::string(26000, '\0');
    copies.doc["buffers"][0]["byteLength"] = copies.binary.size();
    copies.doc["bufferViews"][1]["byteLength"] = 26003;
    copies.doc["accessors"][1]["count"] = 26001;
    const json primitive = copies.doc["meshes"][0]["primitives"][0];
    for (int i = 0; i < 3000; ++i) copies.doc["meshes"][0]["primitives"].push_back(primitive);
    refused(copies.bytes(), "than a file of this size can hold");
    // A long chain of nodes must not exhaust the stack.
    OneTriangle deep;
    deep.doc["nodes"] = json::array();
    for (int i = 0; i < 20000; ++i)
        deep.doc["nodes"].push_back({{"children", json::array({i + 1})}});
    deep.doc["nodes"].push_back({{"mesh", 0}});
    refused(deep.bytes(), "64");
}

/// Vertices at one position merge in our files, and only there.
TEST_F(MeshFilesOfOthers, CopiesAreJoinedInOurs) {
    OneTriangle file;
    file.binary = raw<float>({0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 1, 0, 1, 0, 0, 2, 0, 0}) +
                  raw<std::uint8_t>({0, 1, 2, 3, 4, 5, 0, 0});
    file.doc["buffers"][0]["byteLength"] = file.binary.size();
    file.doc["bufferViews"] = json::parse(R"([{"buffer": 0, "byteLength": 72},
        {"buffer": 0, "byteOffset": 72, "byteLength": 6}])");
    file.doc["accessors"][0]["count"] = file.doc["accessors"][1]["count"] = 6;
    EXPECT_EQ(read_mesh_geometry(write("a.glb", file.bytes())).positions.size(), 6u);
    file.doc["asset"] = json::parse(
        R"({"version": "2.0", "generator": "tvsgs 9", "extras": {"origin": [0, 0, 0], "vertices": 4}})");
    const PlyGeometry joined = read_mesh_geometry(write("a.glb", file.bytes()));
    ASSERT_EQ(joined.positions.size(), 4u);
    EXPECT_EQ(joined.positions[3].x, 2);
    const Vec3i second = joined.faces.at(1);
    EXPECT_TRUE(second.x == 2 && second.y == 1 && second.z == 3);
}

/// An unreadable image loses the colours but not the surface.
TEST_F(MeshFilesOfOthers, DamagedPicturesAreLeftOut) {
    OneTriangle file;
    file.doc["images"] = json::parse(R"([{"bufferView": 0, "mimeType": "image/png"}])");
    file.doc["textures"] = json::parse(R"([{"source": 0}])");
    file.doc["materials"] =
        json::parse(R"([{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}])");
    json& primitive = file.doc["meshes"][0]["primitives"][0];
    primitive["material"] = 0;
    json places = file.doc["accessors"][0];
    places["type"] = "VEC2";
    file.doc["accessors"].push_back(places);
    primitive["attributes"]["TEXCOORD_0"] = file.doc["accessors"].size() - 1;
    const PlyContents found = read_mesh(write("a.glb", file.bytes()));
    EXPECT_EQ(found.faces.size(), 1u);
    EXPECT_TRUE(found.points.colors.empty());
}

TEST_F(MeshFilesOfOthers, ObjsOfOthersWithCommentsAndLongLines) {
    const PlyContents found = read_mesh(
        write("A.OBJ", "v 0 0 0 # a\nv 1 0 \\\r\n 0\nv 1 1 0\nf 1 2 \\\n3 # c\n#f 9 9 9\n"));
    ASSERT_EQ(found.points.positions.size(), 3u);
    EXPECT_EQ(found.points.positions[1].x, 1);
    ASSERT_EQ(found.faces.size(), 1u);
    EXPECT_EQ(found.faces[0].z, 2);
}

TEST_F(MeshFilesOfOthers, ObjsOfOthers) {
    const PlyContents found =
        read_mesh(write("a.obj",
                        "# made by hand\r\no thing\nv 0 0 0 1 0 0\nv 1 0 0 0 1 "
                        "0\n v 1 1 0 0 0 1\nv 0 1 0 1 1 1\nvn 0 0 1\n"
                        "f 1//1 2//1 3//1 4//1\nf -1 -2/7/1 -3\ns off\n"));
    ASSERT_EQ(found.points.positions.size(), 4u);
    ASSERT_EQ(found.faces.size(), 3u);
    EXPECT_EQ(found.faces[1].y, 2);
    EXPECT_EQ(found.faces[2].x, 3);
    EXPECT_EQ(found.faces[2].z, 1);
    EXPECT_EQ(found.points.colors.at(1).y, 1);
    const auto refused = [&](const char* text, const char* says) {
        const std::string path = write("bad.obj", text);
        expect_error(ExitCode::input, says, [&] { read_mesh(path); });
    };
    refused("", "no vertices");
    refused("v 1 2\n", "line 1: '' is not a number");
    refused("v 1 2 x\n", "line 1: 'x' is not a number");
    refused("v 1 2 3\n\nf 1 1 2\n", "line 3: a face refers to vertex 2; expected 1 to 1");
    refused("v 1 2 3\nf 1 1 0\n", "refers to vertex 0");
    refused("v 1 2 3\nf 1 1 -2\n", "refers to vertex -2");
    refused("v 1 2 3\nf 1 1\n", "a face of 2 corners");
    refused("v 1 2 3\nf 1 99999999999999999999 1\n", "is not a corner of a face");
}

}  // namespace
}  // namespace tvsgs
