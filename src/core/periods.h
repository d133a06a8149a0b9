// Events of a training whose steps are several iterations apart.
#pragma once

namespace tvsgs {

/// Whether a multiple of `period`, 0 left out, lies among the `batch` iterations that end at
/// `step`, which is 0 or more.
constexpr bool passes_multiple(int step, int batch, int period) {
    return step >= period && step % period < batch;
}

}  // namespace tvsgs
