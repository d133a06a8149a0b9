// libFuzzer's entry points; TVSGS_FUZZ_TARGET=NAME chooses the reader.  scripts/fuzz.sh
#include <cstdlib>

#include "fuzz_targets.h"

namespace {
const tvsgs::fuzz::Target& chosen() {
    static const tvsgs::fuzz::Target& target = []() -> const tvsgs::fuzz::Target& {
        const char* name = std::getenv("TVSGS_FUZZ_TARGET");
        return tvsgs::fuzz::find_target(name == nullptr ? "" : name);
    }();
    return target;
}
}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    tvsgs::fuzz::run(chosen(), {reinterpret_cast<const char*>(data), size});
    return 0;
}
