#include "render/backbones_list.h"

namespace tvsgs {
template std::unique_ptr<Backbone<Cpu>> make_backbone<Cpu>(const std::string&,
                                                           const BackboneOptions&);
}  // namespace tvsgs
