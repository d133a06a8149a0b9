// Parallel loop on the host whose bodies may throw.
#pragma once

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
            errors[static_cast<std::size_t>(i)] = std::current_exception();
        }
    });
    for (const std::exception_ptr& error : errors)
        if (error) std::rethrow_exception(error);
}

}  // namespace tvsgs
