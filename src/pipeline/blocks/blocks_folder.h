// The folder BLOCKS/, written by tvsgs-blocks split and read by its other commands.
// docs/guide/blocks.md
//
//     BLOCKS/manifest.json    the scene, the frame, the cells, checksums; written last
//     BLOCKS/config.json      settings of the whole scene, also those of the merged run
//     BLOCKS/commands.txt     line n trains block n
//     BLOCKS/coarse.ply       splats of the coarse run
//     BLOCKS/block_001/       block.json views.txt points.ply fixed.ply config.json
//     BLOCKS/block_001/run/   the run of tvsgs-train
//     BLOCKS/block_001/done.json   its results with checksums; written last
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "core/parse_numbers.h"
#include "core/scene/gaussians.h"
#include "io/scene/scene_options.h"
#include "pipeline/blocks/blocks_geometry.h"

namespace tvsgs {

inline constexpr int kBlocksVersion = 2;

/// Size and checksum of a file when it was written; its name is relative to its folder.
struct FileRecord {
    std::string name;
    std::uint64_t bytes = 0;
    std::uint32_t crc = 0;  // CRC-32
};

/// Throws Error(ExitCode::input) where the file cannot be read.
FileRecord record_of(const std::string& folder, const std::string& name);

/// Describes the damage, as in "is missing"; empty for an intact file.
std::optional<std::string> fault_of(const std::string& folder, const FileRecord& record);

/// manifest.json.
struct BlocksManifest {
    std::string folder;           // folder of the manifest; not stored in it
    std::uint32_t split = 0;      // checksum that identifies the split, see split_of()
    std::string scene;            // folder of the scene
    std::uint32_t scene_crc = 0;  // scene_identity()
    std::int64_t seed = 0;
    int iterations = 0;
    Vec3d origin;  // Scene::origin; all coordinates below are relative to it, in world axes
    GroundFrame frame;
    double voxel_size = 0;  // of the common grid of the mesh, which starts at `origin`
    Box3d near;             // in the axes of `frame`; splats outside are taken from the coarse run
    double margin = 0;      // of the cells, world units
    std::vector<GroundCell> cells;
    std::vector<FileRecord> files;  // config.json, coarse.ply, each block.json

    int count() const { return int(cells.size()); }
    /// "block_007"; blocks count from 1.
    static std::string block_name(int block);
    std::string block_folder(int block) const { return folder + "/" + block_name(block); }
    /// The block that contains a point, 1 .. count(); 0: none, the point is far.
    int block_of(Vec3d world) const;
};

/// block.json.
struct BlockInputs {
    int block = 0;
    std::uint32_t split = 0;
    int views = 0;
    std::int64_t points = 0, expected_splats = 0, fixed_splats = 0;
    std::vector<FileRecord> files;
};

/// done.json.
struct BlockResult {
    int block = 0;
    std::uint32_t split = 0;
    std::string program;  // version of the program
    std::int64_t splats = 0, peak_bytes = 0;
    double seconds = 0;
    std::vector<FileRecord> files;  // the splats first
};

/// Checksum of everything but `files`: blocks store it, and are written before the manifest.
std::uint32_t split_of(const BlocksManifest& manifest);

void write_manifest(const BlocksManifest& manifest);
/// Throws Error(ExitCode::input) unless it is an intact manifest of this version.
BlocksManifest read_manifest(const std::string& folder);

void write_block_inputs(const BlocksManifest& manifest, const BlockInputs& inputs);
/// Throws Error(ExitCode::input) unless all inputs of the block are as split wrote them; the
/// message names block, file, damage and remedy.
BlockInputs read_block_inputs(const BlocksManifest& manifest, int block);

void write_block_result(const BlocksManifest& manifest, const BlockResult& result);
/// Returns nothing where the file does not exist. Throws Error(ExitCode::input), as above, where it
/// is damaged, has another version or split, or lists a file that has changed.
std::optional<BlockResult> read_block_result(const BlocksManifest& manifest, int block);
/// Like read_block_result(), but throws where the block has no result.
BlockResult require_block_result(const BlocksManifest& manifest, int block);

/// CRC-32 of the names and poses of all images of the scene and of their cameras: equal for copies
/// of a scene. Does not read photographs.
std::uint32_t scene_identity(const SceneOptions& options);

/// "3,7-9".
std::string block_list(const std::vector<int>& blocks);

}  // namespace tvsgs
