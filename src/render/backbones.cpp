#include "render/backbones_list.h"

namespace tvsgs {

std::string backbones_of(bool flat) {
    std::string names;
    for (const auto& entry : kBackbones<Cpu>)
        if (entry.make({})->traits.flat == flat)
            names += str(names.empty() ? "" : ", ", entry.name);
    return names;
}

template void write_statistics(Cpu, const FusedGradients&);
template void add_backbone<Cpu>(const std::string&, MakeBackbone<Cpu>);
template std::unique_ptr<Backbone<Cpu>> make_backbone<Cpu>(const std::string&,
                                                           const BackboneOptions&);
}  // namespace tvsgs
