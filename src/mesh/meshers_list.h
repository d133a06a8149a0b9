// The list of meshers. To add one, write its file with its options and add a line here.
#pragma once

#include <functional>
#include <map>
#include <memory>
#include <string>
#include <type_traits>
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

/// visit(type, name, arguments of its constructor) for each mesher.
template <class Device, class Visit>
void visit_meshers(const MesherOptions& o, const Visit& visit) {
    using std::type_identity;
    visit(type_identity<TsdfMesher<Device>>{}, "tsdf", o.tsdf);
    visit(type_identity<TetrahedraMesher<Device>>{}, "tetrahedra", o.tetrahedra);
    visit(type_identity<WatertightMesher<Device>>{}, "watertight", o.tsdf.voxel_size,
          o.tsdf.resolution);
}

template <class Device>
using MakeMesher = std::function<std::unique_ptr<Mesher<Device>>()>;

template <class Device>
auto& added_meshers() {
    static std::map<std::string, MakeMesher<Device>> added;
    return added;
}

/// Adds a mesher of a program that links this library; make_mesher() then knows its name.
template <class Device>
void add_mesher(const std::string& name, MakeMesher<Device> make) {
    added_meshers<Device>()[name] = std::move(make);
}

/// Throws Error(ExitCode::usage) with the known names unless `name` is one of them.
template <class Device>
void require_mesher(const std::string& name) {
    std::vector<std::string> known;
    visit_meshers<Device>({},
                          [&](auto, const char* ours, const auto&...) { known.push_back(ours); });
    for (const auto& [added, make] : added_meshers<Device>()) known.push_back(added);
    std::string all;
    for (const std::string& one : known) {
        if (one == name) return;
        all += (all.empty() ? "" : ", ") + one;
    }
    const std::string near = nearest_name(name, known);
    throw Error(ExitCode::usage, str("mesh.method = '", name, "': expected one of ", all,
                                     near.empty() ? "" : str("; did you mean '", near, "'?")));
}

/// Throws what require_mesher() throws.
template <class Device>
std::unique_ptr<Mesher<Device>> make_mesher(const std::string& name, const MesherOptions& options) {
    require_mesher<Device>(name);
    if (const auto added = added_meshers<Device>().find(name);
        added != added_meshers<Device>().end())
        return added->second();
    std::unique_ptr<Mesher<Device>> made;
    visit_meshers<Device>(
        options, [&]<class Kind>(std::type_identity<Kind>, const char* ours, const auto&... of) {
            if (ours == name) made = std::make_unique<Kind>(of...);
        });
    return made;
}

}  // namespace tvsgs
