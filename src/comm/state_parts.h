// The state of a training that several processes hold in parts.
#pragma once

#include "comm/communicator.h"
#include "core/state.h"

namespace tvsgs {

/// Of this process.
StateParts state_parts(Communicator* peers);

/// write(bytes, count) on rank 0, with one array of `state` as one process would have it, in
/// pieces. All processes call it with their part; by itself, where `peers` is null, a process
/// holds all. Elsewhere nothing is called.
void for_whole_array(Communicator* peers,
                     const StateArray& array,
                     const std::function<void(const std::byte*, std::size_t)>& write);

/// Elements of the array in the whole.
inline std::size_t whole_count(const StateArray& array) {
    return array.planes > 0 ? array.all : array.count();
}
/// Arrays as those of the whole, not filled in.
State room_for_whole(const State& part);
/// Fills them on rank 0; the others have no room, null. All call it.
void gather_state(Communicator* peers, const State& part, State* whole);

/// find_not_finite() of the whole, on all processes alike; elements count in the whole.
std::optional<NotFinite> find_not_finite(Communicator* peers, const State& part);

}  // namespace tvsgs
