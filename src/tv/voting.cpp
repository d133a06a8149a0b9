#include "tv/voting.h"

#include "core/log.h"
#include "tv/internal/voting_details.h"
#include "tv/internal/voting_impl.h"

namespace tvsgs {
namespace detail {

void warn_too_few(int usable, int count) {
    spdlog::warn("tensor voting is off: {} of {} splats can take part, and it needs two", usable,
                 count);
}

void warn_noise(double share) {
    spdlog::warn(
        "tensor voting: the regulariser of the whitening is {:.0f} % of the size of the middle "
        "splat, since few very large ones raise it: the small ones vote as if they were rounder; "
        "consider --set tv.whiten_noise_mode=per_splat",
        100 * share);
}

}  // namespace detail

template class TensorVoter<Cpu>;

}  // namespace tvsgs
