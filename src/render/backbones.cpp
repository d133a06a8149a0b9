#include "render/backbones_list.h"

namespace tvsgs {
template void add_backbone<Cpu>(const std::string&, MakeBackbone<Cpu>);
template std::unique_ptr<Backbone<Cpu>> make_backbone<Cpu>(const std::string&,
                                                           const BackboneOptions&);
}  // namespace tvsgs
