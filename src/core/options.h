// Convention for options structs. A struct lists its fields once; JSON, --set, --help, range checks
// and the resolved configuration use this list. A struct offers
//
//     template <class Visitor> void fields(Visitor& field) {
//         field("k", k, {4, 256}, "splats each splat votes for");       int, float, std::int64_t
//         field("whiten", whiten, "votes in whitened space");           bool, std::string
//         field.choice("vote_map", vote_map, {"covariant", "unit"},
//                      "how votes are mapped");                         enum class, in its order
//         field.group("photometric", photometric, "its loss");          another options struct
//     }
//
// The visitors live in io/config.*.
#pragma once

namespace tvsgs {

/// Closed interval of allowed values.
struct Range {
    double min, max;
};

}  // namespace tvsgs
