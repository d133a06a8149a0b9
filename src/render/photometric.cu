#include "core/parallel.h"
#include "render/photometric.h"

namespace tvsgs {
namespace {

constexpr int kBlock = 16;
constexpr int kHalo = kBlock + 2 * kSsimRadius;

/// Loads the block's pixels with their halo, zero outside of the image; `load(p)` gives the value
/// of pixel index p.
template <class T, class Load>
__device__ void load_halo(T (&tile)[kHalo][kHalo], int width, int height, const Load& load) {
    for (int i = threadIdx.y * kBlock + threadIdx.x; i < kHalo * kHalo; i += kBlock * kBlock) {
        const int x = static_cast<int>(blockIdx.x) * kBlock + i % kHalo - kSsimRadius;
        const int y = static_cast<int>(blockIdx.y) * kBlock + i / kHalo - kSsimRadius;
        const bool inside = x >= 0 && x < width && y >= 0 && y < height;
        tile[i / kHalo][i % kHalo] = inside ? load(y * width + x) : T{};
    }
}

/// Horizontal windows of all halo rows: `sum(row, column)` reads 11 neighbours starting at column.
template <class T, class Sum>
__device__ void horizontal_pass(T (&rows)[kHalo][kBlock], const Sum& sum) {
    for (int i = threadIdx.y * kBlock + threadIdx.x; i < kHalo * kBlock; i += kBlock * kBlock)
        rows[i / kBlock][i % kBlock] = sum(i / kBlock, i % kBlock);
}

__global__ void moments_kernel(Span<const Vec3f> color,
                               const std::uint8_t* photo,
                               int width,
                               int height,
                               PhotometricWeights weights,
                               float per_value,
                               Vec3f* dS_dx,
                               Vec3f* dS_dxx,
                               Vec3f* dS_dxy,
                               float* pixel_loss) {
    __shared__ float tile_x[kHalo][kHalo], tile_y[kHalo][kHalo];
    __shared__ SsimMoments<float> rows[kHalo][kBlock];
    const int x = blockIdx.x * kBlock + threadIdx.x, y = blockIdx.y * kBlock + threadIdx.y;
    const bool inside = x < width && y < height;
    detail::MomentRow moments{};
    for (int c = 0; c < 3; ++c) {
        load_halo(tile_x, width, height, [&](int p) { return color[p][c]; });
        load_halo(tile_y, width, height,
                  [&](int p) { return static_cast<float>(photo[3 * p + c]) / 255; });
        __syncthreads();
        horizontal_pass(rows, [&](int row, int column) {
            SsimMoments<float> m{};
            for (int k = 0; k <= 2 * kSsimRadius; ++k) {
                const float w = ssim_weight<float>(k - kSsimRadius), vx = tile_x[row][column + k],
                            vy = tile_y[row][column + k];
                m.x += w * vx, m.y += w * vy, m.xx += w * vx * vx, m.yy += w * vy * vy,
                    m.xy += w * vx * vy;
            }
            return m;
        });
        __syncthreads();
        for (int k = 0; k <= 2 * kSsimRadius; ++k) {
            const float w = ssim_weight<float>(k - kSsimRadius);
            const SsimMoments<float>& m = rows[threadIdx.y + k][threadIdx.x];
            moments.x[c] += w * m.x, moments.y[c] += w * m.y;
            moments.xx[c] += w * m.xx, moments.yy[c] += w * m.yy, moments.xy[c] += w * m.xy;
        }
    }
    if (!inside) return;
    const int p = y * width + x;
    const auto s =
        detail::pixel_ssim(moments, color[p], detail::photo_pixel(photo, p), weights, per_value);
    pixel_loss[p] = s.loss;
    dS_dx[p] = s.dS_dx, dS_dxx[p] = s.dS_dxx, dS_dxy[p] = s.dS_dxy;
}

__global__ void gradient_kernel(Span<const Vec3f> color,
                                const std::uint8_t* photo,
                                int width,
                                int height,
                                PhotometricWeights weights,
                                float per_value,
                                const Vec3f* dS_dx,
                                const Vec3f* dS_dxx,
                                const Vec3f* dS_dxy,
                                Span<Vec3f> dL_dcolor) {
    __shared__ Vec3f tile[kHalo][kHalo];  // the three derivatives of one channel
    __shared__ Vec3f rows[kHalo][kBlock];
    const int x = blockIdx.x * kBlock + threadIdx.x, y = blockIdx.y * kBlock + threadIdx.y;
    Vec3f sum_x{}, sum_xx{}, sum_xy{};
    for (int c = 0; c < 3; ++c) {
        load_halo(tile, width, height, [&](int p) {
            return Vec3f{dS_dx[p][c], dS_dxx[p][c], dS_dxy[p][c]};
        });
        __syncthreads();
        horizontal_pass(rows, [&](int row, int column) {
            Vec3f s{};
            for (int k = 0; k <= 2 * kSsimRadius; ++k)
                s += ssim_weight<float>(k - kSsimRadius) * tile[row][column + k];
            return s;
        });
        __syncthreads();
        Vec3f s{};
        for (int k = 0; k <= 2 * kSsimRadius; ++k)
            s += ssim_weight<float>(k - kSsimRadius) * rows[threadIdx.y + k][threadIdx.x];
        sum_x[c] = s.x, sum_xx[c] = s.y, sum_xy[c] = s.z;
    }
    if (x >= width || y >= height) return;
    const int p = y * width + x;
    dL_dcolor[p] += detail::photometric_gradient(color[p], detail::photo_pixel(photo, p), sum_x,
                                                 sum_xx, sum_xy, weights, per_value);
}

}  // namespace

void photometric_loss(Span<const Vec3f> color,
                      Span<const std::uint8_t> photo,
                      int width,
                      int height,
                      PhotometricWeights weights,
                      PhotometricScratch<Cuda>& scratch,
                      Span<Vec3f> dL_dcolor,
                      Span<float> pixel_loss,
                      Cuda) {
    const float per_value = 1.0f / (3.0f * static_cast<float>(width) * static_cast<float>(height));
    scratch.dS_dx.resize(color.count), scratch.dS_dxx.resize(color.count),
        scratch.dS_dxy.resize(color.count);
    const dim3 blocks((width + kBlock - 1) / kBlock, (height + kBlock - 1) / kBlock),
        threads(kBlock, kBlock);
    moments_kernel<<<blocks, threads>>>(color, photo.data, width, height, weights, per_value,
                                        scratch.dS_dx.data(), scratch.dS_dxx.data(),
                                        scratch.dS_dxy.data(), pixel_loss.data);
    gradient_kernel<<<blocks, threads>>>(color, photo.data, width, height, weights, per_value,
                                         scratch.dS_dx.data(), scratch.dS_dxx.data(),
                                         scratch.dS_dxy.data(), dL_dcolor);
    check_launch();
}

}  // namespace tvsgs
