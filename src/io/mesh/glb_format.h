// Constants of glTF 2.0 and its binary container.
// https://registry.khronos.org/glTF/specs/2.0/glTF-2.0.html
#pragma once

#include <cstdint>

namespace tvsgs::glb {

inline constexpr std::uint32_t kMagic = 0x46546C67, kVersion = 2, kJson = 0x4E4F534A,
                               kBin = 0x004E4942;
inline constexpr std::uint32_t kHeaderBytes = 12, kChunkBytes = 8;

enum ComponentType { i8 = 5120, u8 = 5121, i16 = 5122, u16 = 5123, u32 = 5125, f32 = 5126 };
inline constexpr int kPoints = 0, kTriangles = 4, kVertexTarget = 34962, kIndexTarget = 34963;
inline constexpr int kLinear = 9729, kLinearMipmapLinear = 9987, kClampToEdge = 33071;

}  // namespace tvsgs::glb
