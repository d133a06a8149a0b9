// Replaces opencv.cpp and opencv_video.cpp in a build without OpenCV.
#include "apps/prepare/opencv.h"
#include "core/error.h"

namespace tvsgs::prepare {
namespace {

[[noreturn]] void missing(const std::string& what) {
    throw Error(ExitCode::usage, what +
                                     ": this tvsgs-prepare has no OpenCV; build it with "
                                     "libopencv-contrib-dev, or give JPEG or PNG photographs only");
}

}  // namespace

bool has_opencv() {
    return false;
}

void read_size(const std::string& file, int&, int&) {
    missing(file + ": TIFF");
}

void convert_to_png(const std::string& file, const std::string&) {
    missing(file + ": TIFF");
}

int extract_frames(const std::string& video, const std::string&, int) {
    missing(video + ": frames of a video");
}

Calibration read_calibration(const std::string&) {
    missing("--calibration");
}

std::vector<std::string> marker_dictionaries() {
    return {};
}

std::vector<Marker> find_markers(const std::string&, const std::string&) {
    missing("--marker-size");
}

}  // namespace tvsgs::prepare
