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
    // Plane by plane, each from all to rank 0.
    const auto planes = static_cast<std::size_t>(array.planes),
               ranks = static_cast<std::size_t>(peers->size());
    const std::size_t part = array.bytes.size() / planes;
    Buffer<std::byte, Cpu> sent(part), came;
    std::vector<std::size_t> begins(ranks + 1, part);
    begins[0] = 0;
    for (std::size_t p = 0; p < planes; ++p) {
        if (part > 0) std::memcpy(sent.data(), array.bytes.data() + p * part, part);
        peers->all_to_all_v("state", sent, begins, came);
        if (peers->rank() == 0) write(came.data(), came.size());
    }
}

State whole_state(Communicator* peers, const State& part) {
    State whole;
    for (const StateArray& array : part.arrays) {
        const std::size_t count = array.planes == 0 || peers == nullptr ? array.count() : array.all;
        std::byte* to = nullptr;
        if (rank_of(peers) == 0)
            to = whole.add(array.name, array.element_bytes, count, array.real).bytes.data();
        for_whole_array(peers, array, [&](const std::byte* bytes, std::size_t size) {
            if (size > 0) std::memcpy(to, bytes, size);
            to += size;
        });
    }
    return whole;
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
