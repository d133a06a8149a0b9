// What tvsgs-prepare has OpenCV do; without it these functions say which package to install.
#pragma once

#include <string>
#include <vector>

#include "core/math/vec.h"

namespace tvsgs::prepare {

bool has_opencv();

/// Of an image that OpenCV reads, as TIFF. Throws Error(ExitCode::input).
void read_size(const std::string& file, int& width, int& height);

/// Of 8 or 16 bits, with its alpha channel; EXIF orientation is ignored. Throws
/// Error(ExitCode::input) and Error(ExitCode::io).
void convert_to_png(const std::string& file, const std::string& png);

/// Sharp frames of a video, each taken when a fifth of what the one before shows has moved by about
/// 4 % of the width; at most `most`, as JPEG in `folder`. Returns how many. Throws
/// Error(ExitCode::input).
int extract_frames(const std::string& video, const std::string& folder, int most);

/// A lens as COLMAP has it, from a file of OpenCV's calibration (YAML, XML or JSON).
struct Calibration {
    std::string model;
    std::vector<double> params;
    int width = 0, height = 0;
};
Calibration read_calibration(const std::string& file);

/// A square marker in a photograph: its corners, clockwise from the upper left as it is printed, in
/// pixels that count from the corner of the first one.
struct Marker {
    int id = 0;
    Vec2<double> corners[4];
};

/// Names that find_markers() takes: DICT_4X4_50, DICT_APRILTAG_36h11, ...
std::vector<std::string> marker_dictionaries();

/// ArUco or AprilTag markers of that dictionary. Throws Error(ExitCode::input).
std::vector<Marker> find_markers(const std::string& photo, const std::string& dictionary);

}  // namespace tvsgs::prepare
