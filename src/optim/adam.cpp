#include "optim/adam.h"

namespace tvsgs {

void update_parameters(Cpu, int count, const AdamBody& body, const int* halted) {
    // Asked once: a loop that asks every time is three times as slow.
    if (halted == nullptr || *halted == 0) parallel_for(Cpu{}, count, body);
}

namespace {

constexpr int kChunk = 64;  // Gaussians whose gradients stay in the first cache

/// One step of coefficient k of Gaussians [begin, end); dL: null where the gradients are 0.
void step_run(const ShAdam& sh, int k, int begin, int end, const Vec3f* dL, const ShScale& scale) {
    const std::size_t at =
        static_cast<std::size_t>(k) * sh.stride + static_cast<std::size_t>(begin);
    auto* const value = reinterpret_cast<float*>(sh.values + at);
    auto *const m = reinterpret_cast<float*>(sh.m + at), *const v =
                                                             reinterpret_cast<float*>(sh.v + at);
    const float step = k == 0 ? scale.step_dc : scale.step_rest, root = scale.root;
    const int count = 3 * (end - begin);
    if (dL == nullptr) {
#pragma omp simd
        for (int j = 0; j < count; ++j)
            value[j] = adam_update(value[j], 0.0f, m[j], v[j], step, root);
    } else {
        const auto* const gradient = reinterpret_cast<const float*>(dL);
#pragma omp simd
        for (int j = 0; j < count; ++j)
            value[j] = adam_update(value[j], gradient[j], m[j], v[j], step, root);
    }
}

/// Calls run(begin, end, key) for the longest runs of Gaussians of [begin, end) with one key other
/// than kNone.
constexpr int kNone = -1;
template <class Key, class Run>
void for_runs(int begin, int end, const Key& key, const Run& run) {
    for (int i = begin; i < end;) {
        const int of = key(i), from = i;
        while (i < end && key(i) == of) ++i;
        if (of != kNone) run(from, i, of);
    }
}

/// Keeps the gradients of the harmonics of a chunk, coefficient major.
struct KeepShGradient {
    static constexpr int kGroup = kMaxShCount;
    const ShAdam& sh;
    int i, lane;
    Vec3f* dL;
    bool given = false;

    void operator()(int /*first: 0*/, const Vec3f (&gradient)[kGroup], Vec3f (&values)[kGroup]) {
        for (int k = 0; k < kGroup; ++k) {
            dL[k * kChunk + lane] = gradient[k];
            values[k] = k < sh.coefficients ? sh.values[static_cast<std::size_t>(k) * sh.stride +
                                                        static_cast<std::size_t>(i)]
                                            : Vec3f{};
        }
        given = true;
    }
};

/// Ahead of its use: neighbours' gradients lie wherever their depths put them.
void fetch_gradient(const ViewGradients& view, int i) {
    const auto at = static_cast<std::size_t>(i);
    if (view.slot_counts[at] == 0) return;
    __builtin_prefetch(&view.drawn[view.first_slot[at]]);
    __builtin_prefetch(&view.slots[view.first_slot[at]]);
}

int chunks(int count) {
    return (count + kChunk - 1) / kChunk;
}

}  // namespace

void take_step(Cpu, int count, const AdamStep& step) {
    if (step.halted != nullptr && *step.halted != 0) return;
    with_channels(step.view.channels, [&]<Channels kChannels>() {
        parallel_for_heavy(Cpu{}, chunks(count), [&](int chunk) {
            const int begin = chunk * kChunk, end = std::min(count, begin + kChunk);
            Vec3f dL[kMaxShCount * kChunk];
            bool steps[kChunk];
            for (int i = begin; i < end; ++i) fetch_gradient(step.view, i);
            for (int i = begin; i < end; ++i) {
                const int lane = i - begin;
                KeepShGradient keep{step.sh, i, lane, dL};
                bool without = step_splat<kChannels>(step, i, keep);
                // What is in view but drew nothing could wait, too; in one go with its neighbours
                // it costs less.
                if (step.form == AdamForm::lazy && !keep.given &&
                    step.view.slot_counts[static_cast<std::size_t>(i)] != 0 &&
                    step.sh.taken[i] == step.sh.due)
                    without = true, step.sh.taken[i] = static_cast<std::uint8_t>(step.sh.due + 1);
                for (int k = 0; without && k < kMaxShCount; ++k) dL[k * kChunk + lane] = {};
                steps[lane] = keep.given || without;
            }
            for_runs(
                begin, end, [&](int i) { return steps[i - begin] ? 0 : kNone; },
                [&](int from, int to, int) {
                    for (int k = 0; k < step.sh.coefficients; ++k)
                        step_run(step.sh, k, from, to, dL + k * kChunk + from - begin,
                                 step.sh_scale);
                });
        });
    });
}

void catch_up(Cpu, int count, const ShAdam& sh, Span<const float> radii_px) {
    parallel_for_heavy(Cpu{}, chunks(count), [&](int chunk) {
        const auto behind = [&](int i) {
            const auto at = static_cast<std::size_t>(i);
            const bool asked = radii_px.empty() || radii_px[at] > 0;
            return asked && sh.taken[i] < sh.due ? sh.taken[i] : kNone;
        };
        for_runs(chunk * kChunk, std::min(count, (chunk + 1) * kChunk), behind,
                 [&](int from, int to, int taken) {
                     for (int k = 0; k < sh.coefficients; ++k)
                         for (int t = taken; t < sh.due; ++t)
                             step_run(sh, k, from, to, nullptr, sh.scales[t]);
                     std::fill(sh.taken + from, sh.taken + to, static_cast<std::uint8_t>(sh.due));
                 });
    });
}

}  // namespace tvsgs
