#include "core/pixel_file.h"

#include <fcntl.h>
#include <sys/mman.h>
#include <unistd.h>

#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <mutex>

#include "core/error.h"

namespace tvsgs {
namespace {

// The file is mapped piece by piece: the number of mappings of a process is limited.
constexpr std::size_t kPiece = std::size_t{1} << 30, kAlignment = 4096;

[[noreturn]] void fail(const std::string& folder, const std::string& what) {
    throw Error(ExitCode::io, str(folder, ": ", what, ": ", std::strerror(errno),
                                  "; photographs that are more than memory are kept in this folder "
                                  "for a while (scene.photos, scene.photo_folder)"));
}

/// Read only, so that what it takes is the file's and no memory of the program's.
struct Piece {
    std::uint8_t* bytes;
    std::size_t size;

    Piece(int file, std::size_t offset, std::size_t count, const std::string& folder)
        : size(count) {
        void* const at =
            mmap(nullptr, count, PROT_READ, MAP_SHARED, file, static_cast<off_t>(offset));
        if (at == MAP_FAILED) fail(folder, "a temporary file cannot be mapped");
        bytes = static_cast<std::uint8_t*>(at);
    }
    Piece(const Piece&) = delete;
    Piece& operator=(const Piece&) = delete;
    ~Piece() { munmap(bytes, size); }
};

}  // namespace

struct PixelFile::State {
    std::string folder;
    int file = -1;
    std::mutex mutex;
    std::shared_ptr<const Piece> piece;
    std::size_t piece_begin = 0, used = 0, end = 0;  // used: of the piece; end: of the file
};

PixelFile::PixelFile(const std::string& folder) : state_(std::make_unique<State>()) {
    state_->folder = folder.empty() ? "." : folder;
    std::string name = state_->folder + "/.tvsgs-photos-XXXXXX";
    state_->file = mkostemp(name.data(), O_CLOEXEC);
    if (state_->file < 0) fail(state_->folder, "a temporary file cannot be made");
    unlink(name.c_str());
}

PixelFile::~PixelFile() {
    close(state_->file);
}

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
            if (ftruncate(s.file, static_cast<off_t>(s.end + size)) != 0)
                fail(s.folder, str("a temporary file of ", s.end + size, " bytes cannot be made"));
            s.piece = std::make_shared<const Piece>(s.file, s.end, size, s.folder);
            s.piece_begin = s.end, s.end += size, s.used = 0;
        }
        piece = s.piece, begin = s.piece_begin, at = s.used;
        s.used += (count + kAlignment - 1) / kAlignment * kAlignment;
    }
    for (std::size_t done = 0; done < count;) {
        const ssize_t written =
            pwrite(s.file, from.data() + done, count - done, static_cast<off_t>(begin + at + done));
        if (written < 0 && errno == EINTR) continue;
        if (written <= 0) fail(s.folder, str("writing a photograph of ", count, " bytes failed"));
        done += static_cast<std::size_t>(written);
    }
    image.pixels = PixelBytes(std::shared_ptr<const std::uint8_t>(piece, piece->bytes + at), count);
}

}  // namespace tvsgs
