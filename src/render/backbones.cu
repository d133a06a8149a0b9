#include "render/backbones_list.h"

namespace tvsgs {
template void write_statistics(Cuda, const FusedGradients&);
template void add_backbone<Cuda>(const std::string&, MakeBackbone<Cuda>);
template std::unique_ptr<Backbone<Cuda>> make_backbone<Cuda>(const std::string&,
                                                             const BackboneOptions&);
}  // namespace tvsgs
