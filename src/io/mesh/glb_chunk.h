// A GLB in the making, for the sources of its writers: of meshes and of splats.
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

template <class T>
void put(std::string& out, const T& value) {
    static_assert(std::is_arithmetic_v<T>);
    out.append(reinterpret_cast<const char*>(&value), sizeof value);
}
inline void put(std::string& out, Vec3f v) {
    put(out, v.x), put(out, v.y), put(out, v.z);
}

/// A list of one; braces alone could mean the element itself.
nlohmann::json list_of(nlohmann::json element);

/// The binary chunk, with the views and accessors that say what is in it.
struct Chunk {
    std::string bytes;
    nlohmann::json views = nlohmann::json::array(), accessors = nlohmann::json::array();

    /// A view of what has been put since `begin`; `target` 0: none. `stride`: bytes from one
    /// element to the next, for views of several accessors.
    int add_view(std::size_t begin, int target, int stride = 0);
    /// `offset`: bytes from the beginning of the view.
    int add_accessor(int view,
                     ComponentType component,
                     const char* type,
                     std::size_t count,
                     std::size_t offset = 0);
    /// Of vectors of floats, with the bounds that glTF wants of positions.
    int add_positions(int view, std::size_t count, std::size_t offset = 0);
};

/// sRGB to linear light in 16 bits, as 8 would show bands in the dark.
/// [docs/method/texture.md#files]
std::uint16_t linear_u16(float srgb);

/// Gives a node this turn, unless it is none.
void set_turn(nlohmann::json& node, const Mat3<double>& R);

/// The file of a document, to which it adds what is said of the chunk. Throws
/// Error(ExitCode::input) beyond the format's 4 GiB; `instead` says what to do then.
std::string file_bytes(const std::string& path,
                       nlohmann::json& doc,
                       Chunk& chunk,
                       const char* instead);

}  // namespace tvsgs::glb
