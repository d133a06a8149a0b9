// Parallel filter, gather and sort of lists on the host, and a loop whose bodies may throw. The
// result equals that of one thread.
#pragma once

#include <algorithm>
#include <array>
#include <exception>
#include <vector>

#include "core/device/parallel.h"

namespace tvsgs {

/// Calls body(i) for i in [0, count); for few and heavy bodies. After all bodies have run, throws
/// the error of the smallest i, if any.
template <class Body>
void parallel_for_throwing(int count, const Body& body) {
    std::vector<std::exception_ptr> errors(static_cast<std::size_t>(count));
    parallel_for_heavy(Cpu{}, count, [&](int i) {
        try {
            body(i);
        } catch (...) {
            errors[i] = std::current_exception();
        }
    });
    for (const std::exception_ptr& error : errors)
        if (error) std::rethrow_exception(error);
}

inline constexpr int kListParts = 64;  // independent of the number of threads

/// Calls action(part, first, last) for each of kListParts parts of [0, count).
template <class Action>
void for_parts(std::size_t count, const Action& action) {
    const std::size_t size = (count + kListParts - 1) / kListParts;
    parallel_for_heavy(Cpu{}, kListParts, [&](int part) {
        const std::size_t first = std::min(count, std::size_t(part) * size);
        action(std::size_t(part), first, std::min(count, first + size));
    });
}

/// The numbers below `count` for which is_in(number) is true, ascending. Calls is_in twice for each
/// number.
template <class IsIn>
std::vector<int> indices_where(std::size_t count, const IsIn& is_in) {
    std::array<std::size_t, kListParts + 1> starts{};
    for_parts(count, [&](std::size_t part, std::size_t first, std::size_t last) {
        std::size_t found = 0;
        for (std::size_t i = first; i < last; ++i) found += is_in(i) ? 1 : 0;
        starts[part + 1] = found;
    });
    for (std::size_t part = 0; part < kListParts; ++part) starts[part + 1] += starts[part];
    std::vector<int> numbers(starts.back());
    for_parts(count, [&](std::size_t part, std::size_t first, std::size_t last) {
        std::size_t at = starts[part];
        for (std::size_t i = first; i < last; ++i)
            if (is_in(i)) numbers[at++] = static_cast<int>(i);
    });
    return numbers;
}

/// Returns from[numbers[0]], from[numbers[1]], ...
template <class T>
std::vector<T> taken(const std::vector<T>& from, const std::vector<int>& numbers) {
    std::vector<T> out(numbers.size());
    parallel_for(Cpu{}, static_cast<int>(numbers.size()),
                 [&](int i) { out[i] = from[std::size_t(numbers[i])]; });
    return out;
}

/// Like std::sort; needs memory for a second list. `before` must be a total order: the order of
/// equal elements is not defined.
template <class T, class Before>
void sort_in_parallel(std::vector<T>& values, const Before& before) {
    const std::size_t size = (values.size() + kListParts - 1) / kListParts;  // as for_parts()
    const auto place = [&](std::size_t part) {
        return static_cast<std::ptrdiff_t>(std::min(values.size(), part * size));
    };
    std::vector<T> merged(values.size());
    for_parts(values.size(), [&](std::size_t part, std::size_t /*first*/, std::size_t /*last*/) {
        std::sort(values.begin() + place(part), values.begin() + place(part + 1), before);
    });
    // Six rounds, so that the last one ends in `values`.
    for (std::size_t run = 1; run < kListParts; run *= 2) {
        parallel_for_heavy(Cpu{}, static_cast<int>(kListParts / (2 * run)), [&](int pair) {
            const std::size_t first = 2 * run * static_cast<std::size_t>(pair);
            const auto from = values.begin();
            std::merge(from + place(first), from + place(first + run), from + place(first + run),
                       from + place(first + 2 * run), merged.begin() + place(first), before);
        });
        values.swap(merged);
    }
}

/// Sets `to` to 1. Several threads may mark the same byte.
inline void mark(char& to) {
    __atomic_store_n(&to, char{1}, __ATOMIC_RELAXED);
}

}  // namespace tvsgs
