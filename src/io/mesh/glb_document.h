// Parser of GLB files: JSON members with checks, and accessors within the bytes of the file. For
// sources of readers only.
#pragma once

#include <initializer_list>
#include <string>
#include <string_view>
#include <vector>

#include "core/math/vec.h"
#include "io/files/json_file.h"
#include "io/mesh/glb_chunk.h"

namespace tvsgs {

/// A type of numbers. `most`: divisor of normalised numbers; 0: they are not normalised.
struct GlbComponent {
    std::uint64_t number;  // componentType in glTF
    std::size_t bytes;
    double (*load)(const char*);
    double most = 0;
};

/// Numbers of one accessor. All lie within the file.
struct GlbAccessor {
    std::string_view bytes;  // from the first element on
    std::size_t count = 0, stride = 0;
    const GlbComponent* component = nullptr;
    bool normalized = false;

    double value(std::size_t i, int c) const;
};

/// Base class of the readers of meshes and of splats. All functions throw Error(ExitCode::input).
class GlbDocument {
protected:
    using json = nlohmann::json;

    /// Both arguments must outlive the object.
    GlbDocument(const std::string& path, std::string_view bytes);

    template <class... Parts>
    [[noreturn]] void fail(const Parts&... what) const {
        throw input_error("E_GLB: ", path_, ": ", what...);
    }

    /// Throws if a required extension begins with none of `known`.
    void check_extensions(std::initializer_list<const char*> known) const;
    /// True if tvsgs wrote the file and nobody changed it: one node, and asset.extras has `key` and
    /// an origin.
    bool is_from_tvsgs(const char* key) const;

    /// The member; empty JSON if there is none.
    static const json& member(const json& object, const char* key);
    const json& list(const json& object, const char* key) const;
    static std::string text(const json& object, const char* key);
    std::uint64_t whole(const json& object, const char* key, std::uint64_t standard) const;
    std::size_t index(const json& object, const char* key, const json& of) const;
    std::size_t index_at(const json& indices, std::size_t at, const json& of) const;
    /// The `count` finite numbers of the member; empty if there is no member.
    std::vector<double> numbers(const json& object, const char* key, std::size_t count) const;
    Vec3d vector3(const json& object, const char* key, Vec3d standard) const;

    std::string_view view_bytes(const json& holder, std::size_t* stride) const;
    GlbAccessor accessor(const json& holder, const char* key, const char* type, int width) const;

    const std::string& path_;
    json doc_;

private:
    void split(std::string_view bytes);

    std::string_view binary_;
};

}  // namespace tvsgs
