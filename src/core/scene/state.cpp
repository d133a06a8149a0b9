#include "core/scene/state.h"

#include <algorithm>
#include <cstring>

#include "core/device/parallel.h"
#include "core/error.h"

namespace tvsgs {
namespace {

/// True if all exponent bits are set: infinite or NaN.
bool not_finite(const std::byte* at) {
    std::uint32_t bits;
    std::memcpy(&bits, at, sizeof bits);
    return (bits & 0x7f800000u) == 0x7f800000u;
}

bool any_not_finite(const std::byte* begin, std::size_t floats) {
    bool any = false;
    for (std::size_t i = 0; i < floats; ++i) any |= not_finite(begin + 4 * i);
    return any;
}

}  // namespace

const StateArray* State::find(std::string_view name) const {
    const auto at = std::ranges::find(arrays, name, &StateArray::name);
    return at == arrays.end() ? nullptr : &*at;
}

const StateArray& State::get(std::string_view name, std::size_t element_bytes) const {
    const StateArray* const array = find(name);
    if (array == nullptr)
        throw Error(ExitCode::input, "the checkpoint has no array '", name,
                    "'; another program or version wrote it");
    if (array->element_bytes != element_bytes)
        throw Error(ExitCode::input, "checkpoint array '", name, "' has elements of ",
                    array->element_bytes, " bytes, expected ", element_bytes,
                    "; another program or version wrote it");
    return *array;
}

const StateArray& State::get_one(std::string_view name, std::size_t element_bytes) const {
    const StateArray& array = get(name, element_bytes);
    if (array.count() != 1)
        throw Error(ExitCode::input, "checkpoint array '", name, "' has ", array.count(),
                    " elements, expected 1");
    return array;
}

StateArray& State::add(std::string name, std::size_t element_bytes, std::size_t count, bool real) {
    arrays.push_back({std::move(name), static_cast<std::uint32_t>(element_bytes), real,
                      Buffer<std::byte, Cpu>(element_bytes * count)});
    return arrays.back();
}

std::optional<NotFinite> find_not_finite(const State& state) {
    constexpr std::size_t kChunk = 1 << 18;
    for (const StateArray& array : state.arrays) {
        if (!array.real) continue;
        const std::size_t floats = array.bytes.size() / 4;
        const int chunks = static_cast<int>((floats + kChunk - 1) / kChunk);
        std::int64_t first = chunks;
        parallel_for_heavy(Cpu{}, chunks, [&](int chunk) {
            const std::size_t begin = static_cast<std::size_t>(chunk) * kChunk;
            if (any_not_finite(array.bytes.data() + 4 * begin, std::min(kChunk, floats - begin)))
                min_atomically(&first, chunk);
        });
        if (first == chunks) continue;
        std::size_t i = static_cast<std::size_t>(first) * kChunk;
        while (!not_finite(array.bytes.data() + 4 * i)) ++i;
        return NotFinite{array.name, 4 * i / array.element_bytes};
    }
    return std::nullopt;
}

}  // namespace tvsgs
