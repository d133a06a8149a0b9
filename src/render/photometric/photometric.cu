// CUDA version: window sums along rows, then along columns, on tiles with a margin in shared
// memory. The reads of shared memory limit the speed, so each thread computes several neighbouring
// sums of one row or column from values that it reads once.
#include "core/device/parallel.h"
#include "render/photometric/photometric.h"

namespace tvsgs {
namespace {

constexpr int kThreads = 128, kBlocks = 8;  // at least, per multiprocessor
constexpr int kTaps = 2 * kSsimRadius + 1;
constexpr int kWidth = 32, kHeight = 16;  // px of a block
constexpr int kAcross = 4, kDown = 4;     // sums per thread
constexpr int kMarginWidth = kWidth + kTaps - 1, kMarginHeight = kHeight + kTaps - 1;
constexpr int kLoads = (kMarginWidth * kMarginHeight + kThreads - 1) / kThreads;  // per thread
static_assert(kWidth * kHeight == kThreads * kDown);

/// Values of the block's pixels and their margin, kIn per pixel. The odd pitch spreads the reads of
/// a warp over all banks.
template <int kIn>
using Tile = float[kIn][kMarginHeight][kMarginWidth + 1];

/// Sums along rows of kMaps maps.
template <int kMaps>
using Rows = float[kMaps][kMarginHeight][kWidth + 1];

/// Loads the block's tile, zero outside the image; load(pixel, values) reads one pixel.
template <int kIn, class Load>
__device__ void fill(Tile<kIn>& tile, int width, int height, const Load& load) {
#pragma unroll 3
    for (int i = 0; i < kLoads; ++i) {
        const int at = int(threadIdx.x) + i * kThreads;
        if (at >= kMarginWidth * kMarginHeight) break;
        const int column = at % kMarginWidth, row = at / kMarginWidth;
        const int x = int(blockIdx.x) * kWidth + column - kSsimRadius;
        const int y = int(blockIdx.y) * kHeight + row - kSsimRadius;
        float values[kIn] = {};
        if (x >= 0 && x < width && y >= 0 && y < height) load(y * width + x, values);
        for (int k = 0; k < kIn; ++k) tile[k][row][column] = values[k];
    }
}

/// Computes all sums along rows; maps(values, m) computes the maps of a pixel from its values.
template <int kIn, int kMaps, class Maps>
__device__ void sum_rows(const Tile<kIn>& tile, Rows<kMaps>& rows, const Maps& maps) {
    constexpr int kGroups = kWidth / kAcross;
#pragma unroll 1
    for (int task = int(threadIdx.x); task < kMarginHeight * kGroups; task += kThreads) {
        const int row = task / kGroups, first = task % kGroups * kAcross;
        float sums[kAcross][kMaps] = {};
#pragma unroll
        for (int k = 0; k < kAcross + kTaps - 1; ++k) {
            float values[kIn], m[kMaps];
#pragma unroll
            for (int i = 0; i < kIn; ++i) values[i] = tile[i][row][first + k];
            maps(values, m);
#pragma unroll
            for (int j = 0; j < kAcross; ++j)
                if (k - j >= 0 && k - j < kTaps)
#pragma unroll
                    for (int i = 0; i < kMaps; ++i)
                        sums[j][i] += ssim_weight<float>(k - j - kSsimRadius) * m[i];
        }
#pragma unroll
        for (int j = 0; j < kAcross; ++j)
#pragma unroll
            for (int i = 0; i < kMaps; ++i) rows[i][row][first + j] = sums[j][i];
    }
}

/// The thread's pixels, one below the other.
struct Column {
    int x, first;  // in the block
    __device__ Column() : x(int(threadIdx.x) % kWidth), first(int(threadIdx.x) / kWidth * kDown) {}
    /// Index of pixel j in the image, or -1.
    __device__ int pixel(int j, int width, int height) const {
        const int px = int(blockIdx.x) * kWidth + x, py = int(blockIdx.y) * kHeight + first + j;
        return px < width && py < height ? py * width + px : -1;
    }
};

/// The windows of the thread's pixels.
template <int kMaps>
__device__ void sum_columns(const Rows<kMaps>& rows,
                            const Column& column,
                            float (&sums)[kDown][kMaps]) {
#pragma unroll
    for (int j = 0; j < kDown; ++j)
        for (int i = 0; i < kMaps; ++i) sums[j][i] = 0;
#pragma unroll
    for (int k = 0; k < kDown + kTaps - 1; ++k) {
        float m[kMaps];
#pragma unroll
        for (int i = 0; i < kMaps; ++i) m[i] = rows[i][column.first + k][column.x];
#pragma unroll
        for (int j = 0; j < kDown; ++j)
            if (k - j >= 0 && k - j < kTaps)
#pragma unroll
                for (int i = 0; i < kMaps; ++i)
                    sums[j][i] += ssim_weight<float>(k - j - kSsimRadius) * m[i];
    }
}

/// A value of the photograph from 0 to 1.
__device__ float photo_value(const std::uint8_t* photo, int pixel, int channel) {
    return float(photo[3 * pixel + channel]) / 255;
}

/// Derivatives of one channel, as planes.
struct DerivativePlanes {
    float *dx, *dxx, *dxy;
};

/// Writes the shares of the loss, and the derivatives of channel c at c * pixels.
__global__ void __launch_bounds__(kThreads, kBlocks)
    moments_kernel(PhotometricImages in, float per_value, DerivativePlanes out) {
    __shared__ Tile<2> tile;
    __shared__ Rows<5> rows;
    const Column column;
    float loss[kDown] = {};
#pragma unroll 1
    for (int c = 0; c < 3; ++c) {
        fill<2>(tile, in.width, in.height, [&](int p, float(&values)[2]) {
            values[0] = in.color[p][c], values[1] = photo_value(in.photo.data, p, c);
        });
        __syncthreads();
        sum_rows<2, 5>(tile, rows, [](const float(&v)[2], float(&m)[5]) {
            m[0] = v[0], m[1] = v[1], m[2] = v[0] * v[0], m[3] = v[1] * v[1], m[4] = v[0] * v[1];
        });
        float centre[kDown][2];
        for (int j = 0; j < kDown; ++j)
            for (int i = 0; i < 2; ++i)
                centre[j][i] = tile[i][column.first + j + kSsimRadius][column.x + kSsimRadius];
        __syncthreads();
        float sums[kDown][5];
        sum_columns(rows, column, sums);
#pragma unroll
        for (int j = 0; j < kDown; ++j) {
            const int p = column.pixel(j, in.width, in.height);
            const float(&m)[5] = sums[j];
            const auto t = ssim_terms<float>({m[0], m[1], m[2], m[3], m[4]});
            loss[j] +=
                detail::loss_share(centre[j][0], centre[j][1], t.ssim, in.weights, per_value);
            if (p < 0) continue;
            const std::size_t at = std::size_t(c) * in.color.count + p;
            out.dx[at] = t.dS_dx, out.dxx[at] = t.dS_dxx, out.dxy[at] = t.dS_dxy;
        }
    }
    for (int j = 0; j < kDown; ++j)
        if (const int p = column.pixel(j, in.width, in.height); p >= 0) in.pixel_loss[p] = loss[j];
}

__global__ void __launch_bounds__(kThreads, kBlocks)
    gradient_kernel(PhotometricImages in, float per_value, DerivativePlanes by) {
    __shared__ Tile<3> tile;
    __shared__ Rows<3> rows;
    const Column column;
#pragma unroll 1
    for (int c = 0; c < 3; ++c) {
        const std::size_t plane = std::size_t(c) * in.color.count;
        fill<3>(tile, in.width, in.height, [&](int p, float(&values)[3]) {
            values[0] = by.dx[plane + p], values[1] = by.dxx[plane + p],
            values[2] = by.dxy[plane + p];
        });
        __syncthreads();
        sum_rows<3, 3>(tile, rows, [](const float(&v)[3], float(&m)[3]) {
            m[0] = v[0], m[1] = v[1], m[2] = v[2];
        });
        __syncthreads();
        float sums[kDown][3];
        sum_columns(rows, column, sums);
#pragma unroll
        for (int j = 0; j < kDown; ++j) {
            const int p = column.pixel(j, in.width, in.height);
            if (p >= 0)
                in.dL_dcolor[p][c] += detail::loss_derivative(
                    in.color[p][c], photo_value(in.photo.data, p, c), sums[j][0], sums[j][1],
                    sums[j][2], in.weights, per_value);
        }
    }
}

}  // namespace

void photometric_loss(const PhotometricImages& in, PhotometricScratch<Cuda>& scratch) {
    scratch.resize(in.color.count);
    const DerivativePlanes planes{&scratch.dS_dx.data()->x, &scratch.dS_dxx.data()->x,
                                  &scratch.dS_dxy.data()->x};
    const dim3 blocks((in.width + kWidth - 1) / kWidth, (in.height + kHeight - 1) / kHeight);
    moments_kernel<<<blocks, kThreads>>>(in, in.per_value(), planes);
    gradient_kernel<<<blocks, kThreads>>>(in, in.per_value(), planes);
    check_launch();
}

}  // namespace tvsgs
