#include "render/backbones_list.h"

namespace tvsgs {
template std::unique_ptr<Backbone<Cuda>> make_backbone<Cuda>(const std::string&,
                                                             const BackboneOptions&);
}  // namespace tvsgs
