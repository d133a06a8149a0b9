#include "comm/state_parts.h"

#include <cstring>
#include <limits>

namespace tvsgs {

StateParts state_parts(Communicator* peers) {
    if (peers == nullptr) return {};
    return {peers->rank(), peers->size(), [peers](const std::byte* part, std::size_t bytes) {
                std::vector<std::byte> all;
                peers->all_gather_v("state", part, bytes, all);
                return all;
            }};
}

void for_whole_array(Communicator* peers,
                     const StateArray& array,
                     const std::function<void(const std::byte*, std::size_t)>& write) {
    if (peers == nullptr || array.planes == 0) {
        if (rank_of(peers) == 0) write(array.bytes.data(), array.bytes.size());
        return;
    }
    // Plane by plane, each from the others to rank 0, whose own stays where it is.
    const auto planes = static_cast<std::size_t>(array.planes),
               ranks = static_cast<std::size_t>(peers->size());
    const std::size_t part = array.bytes.size() / planes;
    const bool leads = peers->rank() == 0;
    Buffer<std::byte, Cpu> sent(leads ? 0 : part), came;
    std::vector<std::size_t> begins(ranks + 1, sent.size());
    begins[0] = 0;
    for (std::size_t p = 0; p < planes; ++p) {
        const std::byte* const own = array.bytes.data() + p * part;
        if (sent.size() > 0) std::memcpy(sent.data(), own, part);
        peers->all_to_all_v("state", sent, begins, came);
        if (!leads) continue;
        write(own, part);
        write(came.data(), came.size());
    }
}

State room_for_whole(const State& part) {
    State whole;
    for (const StateArray& array : part.arrays)
        whole.add(array.name, array.element_bytes, whole_count(array), array.real);
    return whole;
}

void gather_state(Communicator* peers, const State& part, State* whole) {
    for (std::size_t i = 0; i < part.arrays.size(); ++i) {
        std::byte* to = whole == nullptr ? nullptr : whole->arrays[i].bytes.data();
        for_whole_array(peers, part.arrays[i], [&](const std::byte* bytes, std::size_t size) {
            if (size > 0) std::memcpy(to, bytes, size);
            to += size;
        });
    }
}

std::optional<NotFinite> find_not_finite(Communicator* peers, const State& part) {
    std::optional<NotFinite> found = find_not_finite(part);
    if (peers == nullptr || !part.in_parts) return found;
    constexpr std::int64_t kNone = std::numeric_limits<std::int64_t>::max();
    constexpr int kBits = 44;  // of an element's number
    std::int64_t first = kNone;
    if (found) {
        std::int64_t at = 0;
        while (part.arrays[static_cast<std::size_t>(at)].name != found->array) ++at;
        const StateArray& array = part.arrays[static_cast<std::size_t>(at)];
        if (array.planes > 0) {
            const std::size_t planes = static_cast<std::size_t>(array.planes),
                              all = array.all / planes, own = array.count() / planes,
                              plane = found->element / own;
            const Part here = own_part(peers, static_cast<int>(all));
            found->element =
                plane * all + static_cast<std::size_t>(here.begin) + (found->element - plane * own);
        }
        first = (at << kBits) + static_cast<std::int64_t>(found->element);
    }
    std::vector<std::int64_t> least{first};
    peers->all_reduce("finite", Communicator::Reduce::min, least);
    if (least[0] == kNone) return std::nullopt;
    return NotFinite{part.arrays[static_cast<std::size_t>(least[0] >> kBits)].name,
                     static_cast<std::size_t>(least[0] & ((std::int64_t{1} << kBits) - 1))};
}

}  // namespace tvsgs
