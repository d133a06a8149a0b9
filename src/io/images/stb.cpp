#include <zlib.h>

#include <climits>
#include <cstdlib>

namespace {

/// Compresses for stb's PNG writer with zlib's fastest level, several times as fast as stb itself.
/// Returns a buffer of std::malloc(); null: no memory.
unsigned char* compress_fast(unsigned char* data, int size, int* compressed_size, int /*quality*/) {
    constexpr int kLevel = 1;
    uLongf bytes = compressBound(static_cast<uLong>(size));
    auto* const out = static_cast<unsigned char*>(std::malloc(bytes));
    if (out == nullptr) return nullptr;
    if (compress2(out, &bytes, data, static_cast<uLong>(size), kLevel) != Z_OK || bytes > INT_MAX) {
        std::free(out);
        return nullptr;
    }
    *compressed_size = static_cast<int>(bytes);
    return out;
}

}  // namespace

#define STBIW_ZLIB_COMPRESS compress_fast
#define STB_IMAGE_IMPLEMENTATION
#define STB_IMAGE_WRITE_IMPLEMENTATION
#include "io/images/stb.h"
