// Pictures, splats and meshes as data that pages embed.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "core/scene/gaussians.h"
#include "core/scene/mesh.h"
#include "io/files/json_value.h"
#include "io/mesh/mesh_files.h"
#include "pipeline/run/train_evaluation.h"

namespace tvsgs {

std::string base64(const std::string& bytes);

/// {"src": data URI of a JPEG, "width", "height"}; at most `width` wide.
JsonValue picture_json(const ImageU8& image, int width);

/// Difference of two pictures of one size, averaged over the channels; a quarter of the range or
/// more is the brightest shade.
ImageU8 difference_image(const ImageU8& a, const ImageU8& b);

/// Colours from dark (no error) to bright (full error): cividis without its darkest part, for a
/// black background.
struct Rgb {
    std::uint8_t r, g, b;
};
Rgb error_shade(double share);

/// End of the error colour scale: twice the largest threshold; 0: no threshold.
double full_error(const Truth& truth);

struct PackedSplats {
    std::vector<std::uint8_t> bytes;  // SPZ 3 in our frame; may be empty
    Gaussians<Cpu> shown;             // the packed splats, not rounded
    int of = 0, of_degree = 0;        // visible splats before packing, and their SH degree
};

/// Packs at most `max_splats` splats in at most `max_bytes`. Lowers the SH degree as needed; if
/// degree 0 is still too large, keeps only the largest by alpha times the two largest scales. Drops
/// splats with an alpha of at most kMinAlpha, which are invisible.
PackedSplats pack_splats(Gaussians<Cpu> splats, std::size_t max_bytes, int max_splats);

/// Vertices in 16 bits of the mesh's box, places in the texture in 16 bits, colours, errors (a byte
/// each, may be empty), and indices.
struct PackedMesh {
    JsonValue about;   // {"vertices", "faces", "low", "high", "places", "colors", "errors"}
    std::string data;  // deflated
};
/// `places`: one per vertex, or empty.
PackedMesh pack_mesh(const TriangleMesh& mesh,
                     const std::vector<std::uint8_t>& errors,
                     const std::vector<Vec2f>& places = {});

/// Repeats vertices so that each has one place in the texture, and drops their colours.
void split_at_charts(TriangleMesh& mesh, const EncodedTexture& texture);

/// The texture's image as JPEG of at most this size. Throws Error(ExitCode::input).
std::string texture_for_page(const std::string& image, std::size_t max_bytes);

/// Compresses in the format of zlib.
std::string deflated(const std::string& bytes);

inline constexpr int kErrorLevels = 254;       // error_levels() of `full` and more
inline constexpr std::uint8_t kNoError = 255;  // outside of the truth's crop

/// Distances to the truth in steps of full / kErrorLevels.
std::vector<std::uint8_t> error_levels(Span<const Vec3f> points, const Truth& truth, double full);

}  // namespace tvsgs
