#include "io/mesh/glb_document.h"

#include <algorithm>
#include <cmath>

#include "io/files/number_types.h"

namespace tvsgs {
namespace {

constexpr GlbComponent kComponents[] = {{glb::i8, 1, load_double<std::int8_t>, 127},
                                        {glb::u8, 1, load_double<std::uint8_t>, 255},
                                        {glb::i16, 2, load_double<std::int16_t>, 32767},
                                        {glb::u16, 2, load_double<std::uint16_t>, 65535},
                                        {glb::u32, 4, load_double<std::uint32_t>},
                                        {glb::f32, 4, load_double<float>}};

}  // namespace

double GlbAccessor::value(std::size_t i, int c) const {
    const double v = component->load(bytes.data() + i * stride + c * component->bytes);
    return normalized && component->most > 0 ? std::max(v / component->most, -1.0) : v;
}

GlbDocument::GlbDocument(const std::string& path, std::string_view bytes) : path_(path) {
    split(bytes);
}

void GlbDocument::check_extensions(std::initializer_list<const char*> known) const {
    for (const json& required : list(doc_, "extensionsRequired")) {
        const std::string name = required.is_string() ? required.get<std::string>() : "";
        if (std::ranges::none_of(known, [&](const char* begin) { return name.starts_with(begin); }))
            fail("needs the unknown extension '", shown(name), "'; save it without compression");
    }
}

bool GlbDocument::is_from_tvsgs(const char* key) const {
    const json& asset = member(doc_, "asset");
    const json& extras = member(asset, "extras");
    return text(asset, "generator").starts_with("tvsgs ") && extras.contains("origin") &&
           extras.contains(key) && list(doc_, "nodes").size() == 1;
}

void GlbDocument::split(std::string_view bytes) {
    using glb::kChunkBytes;
    const std::size_t header = glb::kHeaderBytes;
    if (bytes.size() < header + kChunkBytes) fail("cut off in its header");
    if (const auto version = load<std::uint32_t>(bytes.data() + 4); version != glb::kVersion)
        fail("glTF version ", version, "; expected 2");
    const auto claimed = load<std::uint32_t>(bytes.data() + 8);
    if (claimed > bytes.size())
        fail("claims ", claimed, " bytes, the file has ", bytes.size(), "; is it cut off?");
    bytes = bytes.substr(0, claimed);
    std::string_view text;
    for (std::size_t begin = header, chunk = 0; begin < bytes.size(); ++chunk) {
        if (bytes.size() - begin < kChunkBytes) fail("chunk ", chunk, " is cut off");
        const auto length = load<std::uint32_t>(bytes.data() + begin),
                   kind = load<std::uint32_t>(bytes.data() + begin + 4);
        begin += kChunkBytes;
        if (length > bytes.size() - begin)
            fail("chunk ", chunk, " claims ", length, " bytes, ", bytes.size() - begin,
                 " are left");
        if (chunk == 0 && kind != glb::kJson) fail("the first chunk is not JSON");
        if (chunk == 0) text = bytes.substr(begin, length);
        if (chunk == 1 && kind == glb::kBin) binary_ = bytes.substr(begin, length);
        begin += length;
    }
    doc_ = parse_json(text, path_);
    if (!doc_.is_object()) fail("the JSON chunk is damaged");
}

const GlbDocument::json& GlbDocument::member(const json& object, const char* key) {
    static const json none = json::object();
    if (!object.is_object() || !object.contains(key)) return none;
    return object[key];
}

const GlbDocument::json& GlbDocument::list(const json& object, const char* key) const {
    static const json none = json::array();
    const json& found = member(object, key);
    if (found.is_array()) return found;
    if (object.is_object() && object.contains(key)) fail("\"", key, "\" is not a list");
    return none;
}

std::string GlbDocument::text(const json& object, const char* key) {
    const json& found = member(object, key);
    return found.is_string() ? found.get<std::string>() : "";
}

std::uint64_t GlbDocument::whole(const json& object,
                                 const char* key,
                                 std::uint64_t standard) const {
    if (!object.is_object() || !object.contains(key)) return standard;
    if (!object[key].is_number_unsigned()) fail("\"", key, "\" is not a whole number");
    return object[key].get<std::uint64_t>();
}

std::size_t GlbDocument::index(const json& object, const char* key, const json& of) const {
    const std::uint64_t i = whole(object, key, std::uint64_t{1} << 60);
    if (i >= of.size()) fail("\"", key, "\" refers to a missing element");
    return static_cast<std::size_t>(i);
}

std::size_t GlbDocument::index_at(const json& indices, std::size_t at, const json& of) const {
    if (!indices[at].is_number_unsigned() || indices[at].get<std::uint64_t>() >= of.size())
        fail("a node refers to a missing node");
    return indices[at].get<std::size_t>();
}

std::vector<double> GlbDocument::numbers(const json& object,
                                         const char* key,
                                         std::size_t count) const {
    std::vector<double> out;
    for (const json& number : list(object, key))
        out.push_back(number.is_number() ? number.get<double>() : NAN);
    if (out.empty()) return out;
    if (out.size() != count || !std::ranges::all_of(out, [](double v) { return std::isfinite(v); }))
        fail("\"", key, "\": expected ", count, " finite numbers");
    return out;
}

Vec3d GlbDocument::vector3(const json& object, const char* key, Vec3d standard) const {
    const std::vector<double> v = numbers(object, key, 3);
    return v.empty() ? standard : Vec3d{v[0], v[1], v[2]};
}

std::string_view GlbDocument::view_bytes(const json& holder, std::size_t* stride) const {
    const json& views = list(doc_, "bufferViews");
    const json& view = views[index(holder, "bufferView", views)];
    if (whole(view, "buffer", 0) != 0 || member(view, "extensions").size() > 0)
        fail("numbers in another file, or compressed; save it as one plain .glb");
    const std::uint64_t offset = whole(view, "byteOffset", 0),
                        length = whole(view, "byteLength", 0);
    if (offset > binary_.size() || length > binary_.size() - offset)
        fail("a buffer view of ", length, " bytes at ", offset, " exceeds the buffer of ",
             binary_.size());
    if (stride) *stride = static_cast<std::size_t>(whole(view, "byteStride", 0));
    return binary_.substr(offset, length);
}

GlbAccessor GlbDocument::accessor(const json& holder,
                                  const char* key,
                                  const char* type,
                                  int width) const {
    const json& accessors = list(doc_, "accessors");
    const json& found = accessors[index(holder, key, accessors)];
    GlbAccessor out;
    if (text(found, "type") != type) fail(key, ": expected an accessor of type ", type);
    if (found.contains("sparse") || !found.contains("bufferView"))
        fail(key, ": a sparse or empty accessor; save it as plain numbers");
    const std::uint64_t type_number = whole(found, "componentType", 0);
    for (const GlbComponent& component : kComponents)
        if (component.number == type_number) out.component = &component;
    if (!out.component) fail(key, ": unknown componentType ", type_number);
    const std::size_t size = out.component->bytes * width;
    const json& normalized = member(found, "normalized");
    out.normalized = normalized.is_boolean() && normalized.get<bool>();
    out.bytes = view_bytes(found, &out.stride);
    if (out.stride == 0) out.stride = size;
    const std::uint64_t offset = whole(found, "byteOffset", 0), count = whole(found, "count", 0);
    const std::uint64_t room = offset > out.bytes.size() ? 0 : out.bytes.size() - offset;
    if (out.stride < size || out.stride > 65535 || count > room / out.stride + 1 ||
        (count > 0 && (count - 1) * out.stride + size > room))
        fail(key, ": ", count, " elements, ", out.stride,
             " bytes apart, do not fit into their buffer view");
    out.bytes = out.bytes.substr(static_cast<std::size_t>(std::min(offset, offset + room)));
    out.count = static_cast<std::size_t>(count);
    return out;
}

}  // namespace tvsgs
