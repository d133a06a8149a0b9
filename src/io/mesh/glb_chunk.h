// Writing of GLB files: JSON, buffer views and accessors, shared by the writers of meshes and
// splats.
#pragma once

#include <bit>
#include <cstdint>
#include <nlohmann/json.hpp>
#include <string>
#include <type_traits>

#include "core/math/vec.h"
#include "io/mesh/glb_format.h"

namespace tvsgs::glb {

static_assert(std::endian::native == std::endian::little, "glTF is little-endian");

/// Appends the bytes of a value.
template <class T>
void put(std::string& out, const T& value) {
    static_assert(std::is_arithmetic_v<T>);
    out.append(reinterpret_cast<const char*>(&value), sizeof value);
}
inline void put(std::string& out, Vec3f v) {
    put(out, v.x), put(out, v.y), put(out, v.z);
}

/// A JSON list of one element. Braces alone could mean the element itself.
nlohmann::json list_of(nlohmann::json element);

/// The binary chunk, with the buffer views and accessors that describe its content.
struct Chunk {
    std::string bytes;
    nlohmann::json views = nlohmann::json::array(), accessors = nlohmann::json::array();

    /// Adds a buffer view of the bytes since `begin`; `target` 0: none. `stride`: bytes from one
    /// element to the next, for views with several accessors.
    int add_view(std::size_t begin, int target, int stride = 0);
    /// `offset`: bytes from the start of the view.
    int add_accessor(int view,
                     ComponentType component,
                     const char* type,
                     std::size_t count,
                     std::size_t offset = 0);
    /// Adds an accessor of float vectors with the bounds that glTF requires for positions.
    int add_positions(int view, std::size_t count, std::size_t offset = 0);
};

/// sRGB to linear light in 16 bits; 8 bits would show bands in dark regions.
/// [docs/method/texture.md#files]
std::uint16_t linear_u16(float srgb);

/// Sets the rotation of a node, unless it is the identity.
void set_turn(nlohmann::json& node, const Mat3<double>& R);

/// Bytes of the file; adds the description of the chunk to `doc`. Throws Error(ExitCode::input)
/// beyond the format's 4 GiB; `instead` is the advice in the message.
std::string file_bytes(const std::string& path,
                       nlohmann::json& doc,
                       Chunk& chunk,
                       const char* instead);

}  // namespace tvsgs::glb
