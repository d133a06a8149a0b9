#include "core/scene/pixel_file.h"

#include <sys/mman.h>
#include <unistd.h>

#include <algorithm>
#include <mutex>

#include "core/error.h"
#include "core/grouped.h"
#include "core/scratch_file.h"

namespace tvsgs {
namespace {

// Maps the file in large pieces, because the number of mappings per process is limited.
constexpr std::size_t kPiece = std::size_t{1} << 30, kAlignment = 4096;

/// Read-only, so that its pages count as file cache and not as memory of the program.
struct Piece {
    std::uint8_t* bytes;
    std::size_t size;

    Piece(const ScratchFile& file, std::size_t offset, std::size_t count) : size(count) {
        void* const at = mmap(nullptr, count, PROT_READ, MAP_SHARED, file.descriptor(),
                              static_cast<off_t>(offset));
        if (at == MAP_FAILED) file.fail("cannot map a temporary file");
        bytes = static_cast<std::uint8_t*>(at);
    }
    Piece(const Piece&) = delete;
    Piece& operator=(const Piece&) = delete;
    ~Piece() { munmap(bytes, size); }
};

}  // namespace

struct PixelFile::State {
    ScratchFile file;
    std::mutex mutex{};
    std::shared_ptr<const Piece> piece{};
    std::size_t piece_begin = 0, used = 0, end = 0;  // used: bytes of the piece; end: of the file
};

PixelFile::PixelFile(const std::string& folder)
    : state_(new State{{folder,
                        "photographs that exceed the memory need room in this folder "
                        "(scene.photos, scene.photo_folder)"}}) {}

PixelFile::~PixelFile() = default;

void PixelFile::keep(ImageU8& image) {
    State& s = *state_;
    const PixelBytes& from = image.pixels;
    const std::size_t count = from.size();
    if (count == 0 || from.in_file()) return;
    std::shared_ptr<const Piece> piece;
    std::size_t at = 0, begin = 0;
    {
        const std::lock_guard lock(s.mutex);
        if (!s.piece || s.used + count > s.piece->size) {
            const std::size_t size =
                std::max(kPiece, (count + kAlignment - 1) / kAlignment * kAlignment);
            if (ftruncate(s.file.descriptor(), static_cast<off_t>(s.end + size)) != 0)
                s.file.fail(
                    str("cannot make a temporary file of ", grouped(s.end + size), " bytes"));
            s.piece = std::make_shared<const Piece>(s.file, s.end, size);
            s.piece_begin = s.end, s.end += size, s.used = 0;
        }
        piece = s.piece, begin = s.piece_begin, at = s.used;
        s.used += (count + kAlignment - 1) / kAlignment * kAlignment;
    }
    s.file.write(static_cast<std::int64_t>(begin + at), from.data(), count);
    image.pixels = PixelBytes(std::shared_ptr<const std::uint8_t>(piece, piece->bytes + at), count);
}

}  // namespace tvsgs
