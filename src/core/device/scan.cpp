#include "core/device/scan.h"

namespace tvsgs {

int exclusive_scan(const Buffer<int, Cpu>& in, Buffer<int, Cpu>& out) {
    out.resize(in.size());
    int total = 0;
    for (std::size_t i = 0; i < in.size(); ++i) {
        out[i] = total;
        total += in[i];
    }
    return total;
}

void exclusive_scan(const Buffer<int, Cpu>& in,
                    Buffer<int, Cpu>& out,
                    Buffer<std::uint8_t, Cpu>& /*scratch*/) {
    exclusive_scan(in, out);
}

}  // namespace tvsgs
