#include "io/files/atomic_file.h"
#include "io/files/npz.h"

namespace tvsgs {

void write_npy(const std::string& path,
               const std::vector<std::int64_t>& shape,
               const float* numbers) {
    std::string dimensions;
    std::size_t count = 1;
    for (const std::int64_t n : shape) {
        dimensions += std::to_string(n) + ",";
        count *= static_cast<std::size_t>(n);
    }
    std::string header =
        "{'descr': '<f4', 'fortran_order': False, 'shape': (" + dimensions + "), }";
    // Magic, version and length take 10 bytes; the data must begin at a multiple of 64.
    header += std::string(63 - (10 + header.size()) % 64, ' ') + "\n";
    AtomicFile file(path);
    file.write(std::string_view("\x93NUMPY\x01\x00", 8));
    const char length[2] = {static_cast<char>(header.size() & 255),
                            static_cast<char>(header.size() >> 8)};
    file.write(length, 2);
    file.write(header);
    file.write(numbers, count * sizeof(float));
    file.commit();
}

}  // namespace tvsgs
