#include "optim/photo/photo_background.h"

#include <charconv>

#include "core/error.h"

namespace tvsgs {

PhotoBackground parse_background(const std::string& text) {
    using enum PhotoBackground::Kind;
    if (text == "none") return {};
    if (text == "black") return {constant, {0, 0, 0}};
    if (text == "white") return {constant, {255, 255, 255}};
    if (text == "random") return {random, {0, 0, 0}};
    if (text == "sky") return {sky, {0, 0, 0}};
    PhotoBackground given{constant, {0, 0, 0}};
    const char *at = text.data(), *const end = at + text.size();
    for (int c = 0; c < 3; ++c) {
        const auto [next, error] = std::from_chars(at, end, given.color[c]);
        const bool last = c == 2, good = error == std::errc{} &&
                                         (last ? next == end : next != end && *next == ',');
        if (!good)
            throw Error(ExitCode::usage,
                        str("loss.photometric.background: '", text,
                            "'; expected none, black, white, random, sky, or R,G,B from 0 to 255"));
        at = next + (last ? 0 : 1);
    }
    return given;
}

}  // namespace tvsgs
