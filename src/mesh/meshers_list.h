// The list of meshers. To add one, write its file with its options and add a line here.
#pragma once

#include <functional>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "core/error.h"
#include "core/nearest_name.h"
#include "mesh/closed/mesher_watertight.h"
#include "mesh/fuse/mesher_tsdf.h"
#include "mesh/tetrahedra/mesher_tetrahedra.h"

namespace tvsgs {

struct MesherOptions {
    TsdfMesherOptions tsdf;
    TetrahedraMesherOptions tetrahedra;

    /// The keys of a mesher form a group of its name. Only tsdf's keys have no group, as they are
    /// older than the list.
    template <class Visitor>
    void fields(Visitor& field) {
        tsdf.fields(field);
        field.group("tetrahedra", tetrahedra, "options of the mesher tetrahedra");
    }
};

template <class Device>
using MakeMesher = std::function<std::unique_ptr<Mesher<Device>>()>;
template <class Device>
using NamedMeshers = std::vector<std::pair<std::string, MakeMesher<Device>>>;

template <class Device>
NamedMeshers<Device>& added_meshers() {
    static NamedMeshers<Device> added;
    return added;
}

/// Adds a mesher of a program that links this library; make_mesher() then knows its name.
template <class Device>
void add_mesher(const std::string& name, MakeMesher<Device> make) {
    added_meshers<Device>().emplace_back(name, std::move(make));
}

/// All meshers; the options must outlive the result.
template <class Device>
NamedMeshers<Device> all_meshers(const MesherOptions& o) {
    NamedMeshers<Device> all = {
        {"tsdf", [&] { return std::make_unique<TsdfMesher<Device>>(o.tsdf); }},
        {"tetrahedra", [&] { return std::make_unique<TetrahedraMesher<Device>>(o.tetrahedra); }},
        {"watertight", [&] {
             return std::make_unique<WatertightMesher<Device>>(o.tsdf.voxel_size,
                                                               o.tsdf.resolution);
         }}};
    all.insert(all.end(), added_meshers<Device>().begin(), added_meshers<Device>().end());
    return all;
}

/// Throws Error(ExitCode::usage) with the known names unless `name` is one of them.
template <class Device>
std::unique_ptr<Mesher<Device>> make_mesher(const std::string& name, const MesherOptions& options) {
    std::vector<std::string> known;
    std::string names;
    for (const auto& [known_name, make] : all_meshers<Device>(options)) {
        if (known_name == name) return make();
        known.push_back(known_name), names += (names.empty() ? "" : ", ") + known_name;
    }
    const std::string near = nearest_name(name, known);
    throw Error(ExitCode::usage, "mesh.method = '", name, "': expected one of ", names,
                near.empty() ? "" : str("; did you mean '", near, "'?"));
}

}  // namespace tvsgs
