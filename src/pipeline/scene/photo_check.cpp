#include "pipeline/scene/photo_check.h"

#include <algorithm>
#include <map>
#include <string>
#include <utility>

#include "core/error.h"
#include "core/log.h"

namespace tvsgs {
namespace {

constexpr int kLeastSide = 8;    // px; patches are seven wide
constexpr int kBlankLevels = 2;  // range of the levels of a blank photograph

constexpr int kRows = 64;  // of a photograph that are read at most

/// The bytes of evenly spaced rows.
std::string sample_of(const ImageU8& photo) {
    const std::size_t row = static_cast<std::size_t>(photo.width) * photo.channels;
    std::string sample;
    for (int y = 0; y < photo.height; y += 1 + photo.height / kRows) {
        const std::uint8_t* const from = std::as_const(photo.pixels).data() + y * row;
        sample.append(reinterpret_cast<const char*>(from), row);
    }
    return sample;
}

bool is_blank(const std::string& sample) {
    const auto level = [](char byte) { return static_cast<unsigned char>(byte); };
    const auto [low, high] = std::ranges::minmax_element(sample, {}, level);
    return level(*high) - level(*low) <= kBlankLevels;
}

}  // namespace

void check_photographs(const std::vector<View>& train) {
    std::vector<std::string> blank, repeated;
    std::map<std::string, std::string> first;  // the first photograph with a sample
    for (const View& view : train) {
        const ImageU8& photo = view.photo;
        if (photo.empty()) return;  // read without pixels
        if (std::min(photo.width, photo.height) < kLeastSide)
            throw Error(ExitCode::input,
                        str(view.name, ": ", photo.width, "x", photo.height,
                            " pixels; expected at least ", kLeastSide,
                            " on each side; give larger photographs, or a larger size with -r"));
        std::string sample = sample_of(photo);
        if (is_blank(sample)) {
            blank.push_back(view.name);
        } else if (const auto [at, is_new] = first.emplace(std::move(sample), view.name); !is_new) {
            repeated.push_back(str(view.name, " repeats ", at->second));
        }
    }
    if (!train.empty() && blank.size() == train.size())
        throw Error(ExitCode::input,
                    str("all ", blank.size(), " training photographs are blank, such as ",
                        blank.front(), "; give photographs that show the scene"));
    if (train.size() > 1 && blank.empty() && repeated.size() == train.size() - 1)
        throw Error(ExitCode::input,
                    str("all ", train.size(), " training photographs have the same pixels (",
                        repeated.front(), "); give photographs from different places"));
    if (!blank.empty())
        spdlog::warn("{} of {} training photographs are blank, such as {}; remove them",
                     blank.size(), train.size(), blank.front());
    if (!repeated.empty())
        spdlog::warn("{} of {} training photographs repeat others at another pose: {}; remove them",
                     repeated.size(), train.size(), repeated.front());
}

}  // namespace tvsgs
