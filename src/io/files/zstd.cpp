#include "io/files/zstd.h"

#include <zstd.h>

#include <memory>
#include <new>

#include "core/error.h"
#include "io/files/read_file.h"

namespace tvsgs {

std::vector<std::uint8_t> zstd_frame(std::span<const std::uint8_t> bytes) {
    const std::unique_ptr<ZSTD_CCtx, decltype(&ZSTD_freeCCtx)> context(ZSTD_createCCtx(),
                                                                       ZSTD_freeCCtx);
    if (!context) throw std::bad_alloc();
    constexpr int kLevel = 12;  // of 1 to 22; higher levels take much longer and gain little
    ZSTD_CCtx_setParameter(context.get(), ZSTD_c_compressionLevel, kLevel);
    ZSTD_CCtx_setParameter(context.get(), ZSTD_c_checksumFlag, 1);
    std::vector<std::uint8_t> frame(ZSTD_compressBound(bytes.size()));
    const std::size_t size =
        ZSTD_compress2(context.get(), frame.data(), frame.size(), bytes.data(), bytes.size());
    if (ZSTD_isError(size))
        throw Error(ExitCode::memory, str("zstd: packing failed: ", ZSTD_getErrorName(size)));
    frame.resize(size);
    return frame;
}

void read_zstd_frame(std::span<const std::uint8_t> frame,
                     std::span<std::uint8_t> out,
                     const std::string& where) {
    const std::size_t size = ZSTD_decompress(out.data(), out.size(), frame.data(), frame.size());
    if (ZSTD_isError(size)) throw input_error(where, ": damaged: zstd: ", ZSTD_getErrorName(size));
    if (size != out.size())
        throw input_error(where, ": holds ", size, " bytes; expected ", out.size());
}

}  // namespace tvsgs
