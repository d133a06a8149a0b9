// BLOCKS/: what tvsgs-blocks split writes and the other commands read.  docs/guide/blocks.md
//
//     BLOCKS/manifest.json    the scene, the frame, the cells, checksums; written last
//     BLOCKS/config.json      settings of the whole, which the merged run keeps
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

/// A file as it was written; its name is relative to its folder.
struct FileRecord {
    std::string name;
    std::uint64_t bytes = 0;
    std::uint32_t crc = 0;  // CRC-32
};

/// Throws Error(ExitCode::input) where the file cannot be read.
FileRecord record_of(const std::string& folder, const std::string& name);

/// What is wrong with it, as in "is missing"; nothing where it is as written.
std::optional<std::string> fault_of(const std::string& folder, const FileRecord& record);

/// manifest.json.
struct BlocksManifest {
    std::string folder;       // where it lies, not part of it
    std::uint32_t split = 0;  // of the text below the key, so that results of another split show
    std::string scene;        // folder of the scene
    std::uint32_t scene_crc = 0;  // scene_identity()
    std::int64_t seed = 0;
    int iterations = 0;
    Vec3d origin;  // Scene::origin, to which all below are relative, in world axes
    GroundFrame frame;
    double voxel_size = 0;  // of the one grid of the mesh, whose origin is `origin`
    Box3d near;             // in the axes of `frame`: splats outside are the coarse run's
    double margin = 0;      // of the cells, world units
    std::vector<GroundCell> cells;
    std::vector<FileRecord> files;  // config.json, coarse.ply, each block.json

    int count() const { return static_cast<int>(cells.size()); }
    /// "block_007"; blocks count from 1.
    static std::string block_name(int block);
    std::string block_folder(int block) const { return folder + "/" + block_name(block); }
    /// The block that a place is of, 1 .. count(); 0: none, it is far.
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
    std::string program;  // its version
    std::int64_t splats = 0, peak_bytes = 0;
    double seconds = 0;
    std::vector<FileRecord> files;  // first the splats
};

/// The checksum of all but `files`: blocks name it, and are written before the manifest.
std::uint32_t split_of(const BlocksManifest& manifest);

void write_manifest(const BlocksManifest& manifest);
/// Throws Error(ExitCode::input) for what is no manifest, a damaged one, or one of another version.
BlocksManifest read_manifest(const std::string& folder);

void write_block_inputs(const BlocksManifest& manifest, const BlockInputs& inputs);
/// Throws Error(ExitCode::input), naming block, file, what was found and what to do, unless all
/// inputs of the block are as split wrote them.
BlockInputs read_block_inputs(const BlocksManifest& manifest, int block);

void write_block_result(const BlocksManifest& manifest, const BlockResult& result);
/// Nothing where there is no such file. Throws Error(ExitCode::input), as above, where it is
/// damaged, of another version or split, or a file of it is not as it was.
std::optional<BlockResult> read_block_result(const BlocksManifest& manifest, int block);
/// The same, where a block without a result is an error, too.
BlockResult require_block_result(const BlocksManifest& manifest, int block);

/// CRC-32 of the names and poses of all images of the scene and their cameras: the same for copies
/// of a scene. Reads no photograph.
std::uint32_t scene_identity(const SceneOptions& options);

/// "3,7-9".
std::string block_list(const std::vector<int>& blocks);

}  // namespace tvsgs
