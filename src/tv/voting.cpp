#include "tv/voting.h"

#include "core/log.h"
#include "tv/voting_impl.h"

namespace tvsgs {
namespace detail {

void warn_too_few(int usable, int count) {
    spdlog::warn("tensor voting is off: {} of {} splats can take part, and it needs two", usable,
                 count);
}

void warn_giant(double ratio) {
    spdlog::warn(
        "tensor voting: one splat is {:.0f} times larger than the middle one, which spoils the "
        "whitening of all "
        "others; consider --set tv.whiten_noise_mode=per_splat",
        ratio);
}

}  // namespace detail

template class TensorVoter<Cpu>;

}  // namespace tvsgs
