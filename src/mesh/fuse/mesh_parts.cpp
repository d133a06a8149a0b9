#include "mesh/fuse/mesh_parts.h"

#include <algorithm>

#include "core/error.h"

namespace tvsgs {

void PartPlanner::add_around(std::uint64_t key) {
    const Vec3i block = block_of_key(key);
    const auto reachable = [](int c) { return std::clamp(c, -kBlockReach, kBlockReach - 1); };
    for (int z = reachable(block.z - 1); z <= reachable(block.z + 1); ++z)
        for (int y = reachable(block.y - 1); y <= reachable(block.y + 1); ++y) {
            const std::uint64_t last = block_key({reachable(block.x + 1), y, z});
            auto at = std::ranges::lower_bound(keys_, block_key({reachable(block.x - 1), y, z}));
            for (; at != keys_.end() && *at <= last; ++at) {
                const auto place = static_cast<std::size_t>(at - keys_.begin());
                if (!loaded_[place]) loaded_[place] = 1, places_.push_back(place);
            }
        }
}

bool PartPlanner::next(BlockPart& part) {
    if (begin_ == keys_.size()) return false;
    std::size_t end = begin_;
    for (; end < keys_.size(); ++end) {
        const std::size_t before = places_.size();
        add_around(keys_[end]);
        if (places_.size() <= capacity_) continue;
        for (; places_.size() > before; places_.pop_back()) loaded_[places_.back()] = 0;
        break;
    }
    if (end == begin_)
        throw Error(ExitCode::memory, "fusion needs memory for 27 blocks of ", kBlockEdge,
                    "^3 voxels; the limit allows ", capacity_, "; raise --memory");
    std::ranges::sort(places_);
    part.first = static_cast<int>(std::ranges::lower_bound(places_, begin_) - places_.begin());
    part.count = static_cast<int>(end - begin_);
    part.keys.clear();
    for (const std::size_t place : places_) part.keys.push_back(keys_[place]), loaded_[place] = 0;
    places_.clear();
    begin_ = end;
    return true;
}

void MeshJoiner::add(const BlockPart& part, const MeshPart& piece) {
    const std::size_t base = mesh_.vertices.size(), faces = mesh_.faces.size();
    if (base + piece.mesh.vertices.size() >= 1u << 31 ||
        faces + piece.mesh.faces.size() >= 1u << 31)
        throw_mesh_too_large(base + piece.mesh.vertices.size(), faces + piece.mesh.faces.size());
    const auto append = [](auto& to, const auto& from) {
        to.insert(to.end(), from.begin(), from.end());
    };
    append(mesh_.vertices, piece.mesh.vertices);
    append(mesh_.colors, piece.mesh.colors);
    append(mesh_.faces, piece.mesh.faces);
    append(edges_, piece.edges);
    for (const std::uint32_t first : piece.block_vertices)
        block_vertices_.push_back(static_cast<std::uint32_t>(base) + first);
    for (std::size_t f = faces; f < mesh_.faces.size(); ++f)
        for (int k = 0; k < 3; ++k) {
            int& corner = mesh_.faces[f][k];
            if (corner >= 0) {
                corner += static_cast<int>(base);
                continue;
            }
            const std::uint64_t key = part.keys[~corner / kBlockEdges];
            const auto block = std::ranges::lower_bound(keys_, key) - keys_.begin();
            pending_.push_back({3 * f + static_cast<std::size_t>(k),
                                static_cast<std::size_t>(block),
                                static_cast<std::uint16_t>(~corner % kBlockEdges)});
        }
}

TriangleMesh MeshJoiner::finish() {
    block_vertices_.push_back(static_cast<std::uint32_t>(mesh_.vertices.size()));
    for (const Pending& p : pending_) {
        const auto first = edges_.begin() + block_vertices_[p.block],
                   last = edges_.begin() + block_vertices_[p.block + 1];
        const auto found = std::lower_bound(first, last, p.edge);
        if (found == last || *found != p.edge)
            throw Error(ExitCode::internal, "a face of the mesh lacks a vertex");
        mesh_.faces[p.corner / 3][static_cast<int>(p.corner % 3)] =
            static_cast<int>(found - edges_.begin());
    }
    return std::move(mesh_);
}

}  // namespace tvsgs
