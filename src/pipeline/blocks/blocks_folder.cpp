#include "pipeline/blocks/blocks_folder.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstdio>
#include <filesystem>

#include "core/grouped.h"
#include "core/log.h"
#include "io/files/atomic_file.h"
#include "io/files/checkpoint.h"
#include "io/files/json_value.h"
#include "io/files/read_file.h"
#include "io/scene/scene_layout.h"

namespace tvsgs {
namespace {

namespace fs = std::filesystem;

std::uint32_t crc_of(std::string_view bytes, std::uint32_t so_far = 0) {
    return checksum(bytes.data(), bytes.size(), so_far);
}

std::string hex(std::uint32_t crc) {
    return fmt::format("{:08x}", crc);
}

JsonValue files_json(const std::vector<FileRecord>& files) {
    JsonValue list = JsonValue::list();
    for (const FileRecord& file : files)
        list.items.push_back(JsonValue()
                                 .add("name", file.name)
                                 .add("bytes", file.bytes)
                                 .add("crc32", hex(file.crc)));
    return list;
}

/// Reads the values of one of our files; its errors name the file and the remedy.
class Reader {
public:
    Reader(std::string path, std::string remedy)
        : path_(std::move(path)), remedy_(std::move(remedy)) {
        try {
            root_ = parse_json_value(read_bytes(path_), path_);
        } catch (const Error& error) {
            throw input_error(error.what(), "; ", remedy_);
        }
        const double version = root_["version"].number_or(-1);
        if (version != kBlocksVersion)
            throw wrong(version < 0 ? std::string("has no version")
                                    : str("has version ", version, ", expected ", kBlocksVersion));
    }

    Error wrong(const std::string& what) const {
        return input_error(path_, ": ", what, "; ", remedy_);
    }
    const JsonValue& at(const JsonValue& object, const char* key, JsonValue::Kind kind) const {
        const JsonValue& value = object[key];
        if (!value.is(kind)) throw wrong(str("'", key, "' is missing or of a wrong type"));
        return value;
    }
    const JsonValue& list(const char* key) const { return at(root_, key, JsonValue::Kind::list); }
    double number(const char* key) const { return at(root_, key, JsonValue::Kind::number).number; }
    std::int64_t count(const char* key) const {
        const double value = number(key);
        if (!(value >= 0 && value < 9e15 && value == std::floor(value)))
            throw wrong(str("'", key, "' is ", value, "; expected a whole number, 0 or more"));
        return std::int64_t(value);
    }
    std::string text(const char* key) const { return at(root_, key, JsonValue::Kind::text).text; }
    std::uint32_t crc(const char* key) const { return crc(root_, key); }
    std::uint32_t crc(const JsonValue& object, const char* key) const {
        std::uint32_t crc = 0;
        const std::string& t = at(object, key, JsonValue::Kind::text).text;
        const auto end = t.data() + t.size();
        if (t.size() != 8 || std::from_chars(t.data(), end, crc, 16).ptr != end)
            throw wrong(str("'", shown(t), "' is not a CRC-32"));
        return crc;
    }
    std::vector<double> numbers(const JsonValue& list, std::size_t count, const char* what) const {
        std::vector<double> out;
        for (const JsonValue& item : list.items)
            out.push_back(item.is(JsonValue::Kind::number) ? item.number : NAN);
        if (out.size() != count)
            throw wrong(str("'", what, "' has ", out.size(), " numbers, expected ", count));
        return out;
    }
    Vec3d vec(const JsonValue& list, const char* what) const {
        const std::vector<double> v = numbers(list, 3, what);
        if (!std::isfinite(v[0] + v[1] + v[2])) throw wrong(str("'", what, "' is not finite"));
        return {v[0], v[1], v[2]};
    }
    std::vector<FileRecord> files() const {
        std::vector<FileRecord> out;
        for (const JsonValue& entry : list("files").items) {
            FileRecord file;
            file.name = at(entry, "name", JsonValue::Kind::text).text;
            file.bytes =
                std::uint64_t(std::max(0.0, at(entry, "bytes", JsonValue::Kind::number).number));
            file.crc = crc(entry, "crc32");
            if (fs::path(file.name).is_absolute() || file.name.find("..") != std::string::npos)
                throw wrong(str("file '", shown(file.name), "' lies outside its folder"));
            out.push_back(std::move(file));
        }
        return out;
    }

private:
    std::string path_, remedy_;
    JsonValue root_;
};

const char* const kSplitAgain = "run tvsgs-blocks split again, into another folder";

std::string run_again(const BlocksManifest& manifest, int block) {
    return str("train it again: tvsgs-blocks run ", manifest.folder, " --block ", block,
               " --again");
}

std::string result_file(const BlocksManifest& manifest, int block) {
    return manifest.block_folder(block) + "/done.json";
}

JsonValue list_of(Vec3d v) {
    return JsonValue(std::vector<double>{v.x, v.y, v.z});
}

JsonValue manifest_json(const BlocksManifest& m) {
    JsonValue frame = JsonValue::list(), near = JsonValue::list(), cells = JsonValue::list();
    for (int r = 0; r < 3; ++r) {
        const double* row = m.frame.ground_from_world[r];
        frame.items.push_back(list_of({row[0], row[1], row[2]}));
    }
    near.items = {list_of(m.near.low), list_of(m.near.high)};
    for (const GroundCell& cell : m.cells)  // [x0, x1, y0, y1]; null: infinite
        cells.items.push_back(std::vector{cell.low[0], cell.high[0], cell.low[1], cell.high[1]});
    JsonValue root;
    root.add("version", kBlocksVersion)
        .add("scene", m.scene)
        .add("scene_crc32", hex(m.scene_crc))
        .add("seed", m.seed)
        .add("iterations", m.iterations)
        .add("origin", list_of(m.origin));
    root.add("ground_from_world", frame).add("voxel_size", m.voxel_size).add("near", near);
    return root.add("margin", m.margin).add("cells", cells);
}

/// The beginning of block.json and done.json.
template <class Record>
JsonValue record_json(const Record& record) {
    return JsonValue()
        .add("version", kBlocksVersion)
        .add("block", record.block)
        .add("split", hex(record.split));
}

/// Reads that, and the list of files. Throws for a record of another block or split.
template <class Record>
void read_record(const Reader& in, const BlocksManifest& manifest, int block, Record& record) {
    record.block = int(in.count("block")), record.split = in.crc("split");
    if (record.block != block || record.split != manifest.split)
        throw in.wrong(str("for block ", record.block, " of split ", hex(record.split),
                           ", expected block ", block, " of split ", hex(manifest.split)));
    record.files = in.files();
}

/// Throws for the first damaged file.
void require_files(const std::string& folder,
                   const std::vector<FileRecord>& files,
                   const std::string& whose,
                   const std::string& remedy) {
    for (const FileRecord& file : files)
        if (const auto fault = fault_of(folder, file))
            throw input_error(whose, ": ", folder, "/", file.name, " ", *fault, "; ", remedy);
}

}  // namespace

FileRecord record_of(const std::string& folder, const std::string& name) {
    const std::string path = folder + "/" + name;
    FileRecord record{name, 0, 0};
    const OpenFile file = open_file(path);
    std::vector<char> bytes(1 << 20);
    for (std::size_t n; (n = std::fread(bytes.data(), 1, bytes.size(), file.get())) > 0;)
        record.crc = crc_of({bytes.data(), n}, record.crc), record.bytes += n;
    check_read(file, path);
    return record;
}

std::optional<std::string> fault_of(const std::string& folder, const FileRecord& record) {
    const fs::path path = fs::path(folder) / record.name;
    std::error_code code;
    if (!fs::is_regular_file(path, code)) return "is missing";
    const std::uintmax_t bytes = fs::file_size(path, code);
    if (code) return "cannot be read: " + code.message();
    if (bytes != record.bytes)
        return str("is damaged: ", grouped(bytes), " bytes, expected ", grouped(record.bytes));
    const FileRecord now = record_of(folder, record.name);
    if (now.crc != record.crc)
        return str("is damaged: CRC-32 ", hex(now.crc), ", expected ", hex(record.crc));
    return std::nullopt;
}

std::string BlocksManifest::block_name(int block) {
    return fmt::format("block_{:03d}", block);
}

int BlocksManifest::block_of(Vec3d world) const {
    const Vec3d p = frame.ground_from_world * world;
    for (int axis = 0; axis < 3; ++axis)
        if (!(p[axis] >= near.low[axis] && p[axis] < near.high[axis])) return 0;
    return cell_of(cells, {p.x, p.y}) + 1;
}

std::uint32_t split_of(const BlocksManifest& manifest) {
    return crc_of(json_text(manifest_json(manifest)));
}

void write_manifest(const BlocksManifest& manifest) {
    const JsonValue root = manifest_json(manifest)
                               .add("split", hex(manifest.split))
                               .add("files", files_json(manifest.files));
    write_text_file(manifest.folder + "/manifest.json", json_text(root) + "\n");
}

BlocksManifest read_manifest(const std::string& folder) {
    const std::string path = folder + "/manifest.json";
    if (std::error_code code; !fs::exists(path, code))
        throw input_error(
            folder, ": no manifest.json; expected a folder that tvsgs-blocks split has finished");
    const Reader in(path, kSplitAgain);
    BlocksManifest m;
    m.folder = folder;
    m.scene = in.text("scene");
    m.scene_crc = in.crc("scene_crc32");
    m.seed = std::int64_t(in.number("seed"));
    m.iterations = int(std::min<std::int64_t>(in.count("iterations"), 1000000000));
    m.origin = in.vec(in.list("origin"), "origin");
    const JsonValue& frame = in.list("ground_from_world");
    const JsonValue& near = in.list("near");
    if (frame.items.size() != 3 || near.items.size() != 2)
        throw in.wrong("'ground_from_world' or 'near' has a wrong size");
    for (int r = 0; r < 3; ++r) {
        const Vec3d row = in.vec(frame.items[r], "ground_from_world");
        for (int c = 0; c < 3; ++c) m.frame.ground_from_world[r][c] = row[c];
    }
    m.near = {in.vec(near.items[0], "near"), in.vec(near.items[1], "near")};
    m.voxel_size = in.number("voxel_size"), m.margin = in.number("margin");
    for (const JsonValue& item : in.list("cells").items) {
        const std::vector<double> v = in.numbers(item, 4, "cells");
        const auto or_infinite = [](double x, double sign) {
            return std::isnan(x) ? sign * GroundCell::kInfinite : x;
        };
        GroundCell cell;
        cell.low[0] = or_infinite(v[0], -1), cell.high[0] = or_infinite(v[1], 1);
        cell.low[1] = or_infinite(v[2], -1), cell.high[1] = or_infinite(v[3], 1);
        m.cells.push_back(cell);
    }
    if (m.cells.empty() || m.cells.size() > 99999) throw in.wrong("no blocks, or too many");
    m.files = in.files();
    m.split = in.crc("split");
    if (m.split != split_of(m)) throw in.wrong("damaged: the checksum differs");
    return m;
}

void write_block_inputs(const BlocksManifest& manifest, const BlockInputs& inputs) {
    JsonValue root = record_json(inputs);
    root.add("views", inputs.views)
        .add("points", inputs.points)
        .add("expected_splats", inputs.expected_splats)
        .add("fixed_splats", inputs.fixed_splats)
        .add("files", files_json(inputs.files));
    write_text_file(manifest.block_folder(inputs.block) + "/block.json", json_text(root) + "\n");
}

BlockInputs read_block_inputs(const BlocksManifest& manifest, int block) {
    const std::string folder = manifest.block_folder(block), name = manifest.block_name(block);
    const std::string whose = str("block ", block);
    const auto record = std::ranges::find(manifest.files, name + "/block.json", &FileRecord::name);
    if (record == manifest.files.end())
        throw input_error(whose, ": ", manifest.folder, "/manifest.json lists no ", name,
                          "/block.json; ", kSplitAgain);
    require_files(manifest.folder, {*record}, whose, kSplitAgain);
    const Reader in(folder + "/block.json", kSplitAgain);
    BlockInputs inputs;
    read_record(in, manifest, block, inputs);
    inputs.views = int(in.count("views"));
    inputs.points = in.count("points"), inputs.expected_splats = in.count("expected_splats");
    inputs.fixed_splats = in.count("fixed_splats");
    require_files(folder, inputs.files, whose, kSplitAgain);
    return inputs;
}

void write_block_result(const BlocksManifest& manifest, const BlockResult& result) {
    JsonValue root = record_json(result);
    root.add("program", result.program)
        .add("splats", result.splats)
        .add("seconds", result.seconds)
        .add("peak_bytes", result.peak_bytes)
        .add("files", files_json(result.files));
    write_text_file(result_file(manifest, result.block), json_text(root) + "\n");
}

std::optional<BlockResult> read_block_result(const BlocksManifest& manifest, int block) {
    const std::string folder = manifest.block_folder(block), path = result_file(manifest, block);
    std::error_code code;
    if (!fs::exists(path, code)) return std::nullopt;
    const Reader in(path, run_again(manifest, block));
    BlockResult result;
    read_record(in, manifest, block, result);
    result.program = in.text("program");
    result.splats = in.count("splats"), result.peak_bytes = in.count("peak_bytes");
    result.seconds = in.number("seconds");
    if (result.files.empty()) throw in.wrong("no splats are listed");
    require_files(folder, result.files, str("block ", block), run_again(manifest, block));
    return result;
}

BlockResult require_block_result(const BlocksManifest& manifest, int block) {
    auto result = read_block_result(manifest, block);
    if (!result)
        throw input_error(
            "block ", block, " is not trained to its end (no ", result_file(manifest, block),
            "); train it with tvsgs-blocks run ", manifest.folder, " --block ", block,
            ", list all such blocks with tvsgs-blocks status ", manifest.folder, " --missing");
    return std::move(*result);
}

std::uint32_t scene_identity(const SceneOptions& options) {
    const SceneLayout layout = read_layout(options);
    std::uint32_t crc = 0;
    const auto add = [&crc](const auto& value) {
        crc = crc_of({reinterpret_cast<const char*>(&value), sizeof value}, crc);
    };
    for (const ColmapImage& image : layout.model.images) {
        crc = crc_of(image.name, crc);
        for (int r = 0; r < 3; ++r) {
            for (int c = 0; c < 3; ++c) add(image.camera_from_world.R[r][c]);
            add(image.camera_from_world.t[r]);
        }
        const Intrinsics& camera = layout.model.cameras.at(image.camera_id);
        add(camera.fx_px), add(camera.fy_px), add(camera.cx_px), add(camera.cy_px);
        add(camera.width_px), add(camera.height_px);
    }
    return crc;
}

std::string block_list(const std::vector<int>& blocks) {
    std::string text;
    for (std::size_t i = 0; i < blocks.size();) {
        std::size_t end = i;
        while (end + 1 < blocks.size() && blocks[end + 1] == blocks[end] + 1) ++end;
        text += str(text.empty() ? "" : ",", blocks[i]);
        if (end > i) text += str("-", blocks[end]);
        i = end + 1;
    }
    return text;
}

}  // namespace tvsgs
