#include "optim/optimiser/adam.h"

#include "render/tiles/fused_gradients.h"

namespace tvsgs {

void update_parameters(Cpu, int count, const AdamBody& body, const int* halted) {
    // Test once: a test inside the loop makes it three times as slow.
    if (halted == nullptr || *halted == 0) parallel_for(Cpu{}, count, body);
}

namespace {

constexpr int kChunk = 64;  // Gaussians whose gradients stay in the L1 cache

/// One step of coefficient k of Gaussians [begin, end).
void step_run(const ShAdam& sh, int k, int begin, int end, const Vec3f* dL, const ShScale& scale) {
    const std::size_t at = std::size_t(k) * sh.stride + std::size_t(begin);
    auto* const value = reinterpret_cast<float*>(sh.values + at);
    auto *const m = reinterpret_cast<float*>(sh.m + at), *const v =
                                                             reinterpret_cast<float*>(sh.v + at);
    const float step = k == 0 ? scale.step_dc : scale.step_rest, root = scale.root;
    const int count = 3 * (end - begin);
    const auto* const gradient = reinterpret_cast<const float*>(dL);
#pragma omp simd
    for (int j = 0; j < count; ++j)
        value[j] = adam_update(value[j], gradient[j], m[j], v[j], step, root);
}

/// Keeps the SH gradients of a chunk, coefficient major.
struct KeepShGradient {
    static constexpr int kGroup = kMaxShCount;
    const ShAdam& sh;
    int i, lane;
    Vec3f* dL;
    bool given = false;

    void operator()(int /*first: 0*/, const Vec3f (&gradient)[kGroup], Vec3f (&values)[kGroup]) {
        for (int k = 0; k < kGroup; ++k) {
            dL[k * kChunk + lane] = gradient[k];
            values[k] = k < sh.coefficients ? sh.values[std::size_t(k) * sh.stride + std::size_t(i)]
                                            : Vec3f{};
        }
        given = true;
    }
};

/// Prefetches a gradient: they are stored by depth, so the addresses of neighbours are random.
template <class Gradients>
void fetch_gradient(const SplatSums<Gradients>& sums, int i) {
    const std::uint32_t at = sums.places.of(i);
    if (at == kNoPlace || sums.fragment_counts[at] == 0) return;
    __builtin_prefetch(&sums.drawn[sums.first_fragment[at]]);
    __builtin_prefetch(&sums.fragments[sums.first_fragment[at]]);
}

int chunks(int count) {
    return (count + kChunk - 1) / kChunk;
}

}  // namespace

void take_step(Cpu, int count, const FusedGradients& gradients, const AdamStep& step) {
    if (step.halted != nullptr && *step.halted != 0) return;
    gradients.visit([&](const auto& vjp) {
        parallel_for_heavy(Cpu{}, chunks(count), [&](int chunk) {
            const int begin = chunk * kChunk, end = std::min(count, begin + kChunk);
            Vec3f dL[kMaxShCount * kChunk];
            for (int i = begin; i < end; ++i) fetch_gradient(vjp.sums, i);
            for (int i = begin; i < end; ++i) {
                KeepShGradient keep{step.sh, i, i - begin, dL};
                step_splat(vjp, step, i, keep);
                for (int k = 0; !keep.given && k < kMaxShCount; ++k)
                    dL[k * kChunk + i - begin] = {};
            }
            for (int k = 0; k < step.sh.coefficients; ++k)
                step_run(step.sh, k, begin, end, dL + k * kChunk, step.sh_scale);
        });
    });
}

}  // namespace tvsgs
