#include "io/scene/georeference.h"

#include <algorithm>
#include <filesystem>

#include "io/files/atomic_file.h"
#include "io/files/read_file.h"

namespace tvsgs {
namespace {

std::string file_in(const std::string& folder) {
    return (std::filesystem::path(folder) / "georeference.json").string();
}

}  // namespace

Vec3d vector_of(const JsonValue& list) {
    Vec3d out{NAN, NAN, NAN};
    for (int c = 0; list.items.size() == 3 && c < 3; ++c) out[c] = list.items[c].number_or(NAN);
    return out;
}

bool is_one_line(std::string_view text) {
    return std::ranges::all_of(text, [](unsigned char c) { return c >= 32 && c != 127; });
}

std::optional<Georeference> read_georeference(const std::string& folder) {
    const std::string path = file_in(folder);
    std::error_code code;
    if (!std::filesystem::exists(path, code)) return std::nullopt;
    const JsonValue json = parse_json_value(read_text(path, kMaxTextBytes), path);
    const Georeference out{json["projection"].text_or(""), vector_of(json["origin"])};
    if (out.projection.empty() || !is_one_line(out.projection) || !is_finite(out.origin))
        throw input_error(path,
                          ": expected {\"projection\": \"EPSG:32632\", \"origin\": [x, y, z]}");
    return out;
}

void write_georeference(const std::string& folder, const Georeference& g) {
    write_text_file(file_in(folder),
                    json_text(JsonValue()
                                  .add("projection", g.projection)
                                  .add("origin", std::vector{g.origin.x, g.origin.y, g.origin.z})) +
                        "\n");
}

}  // namespace tvsgs
