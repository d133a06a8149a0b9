// OpenCV functions of tvsgs-prepare. Without OpenCV they report which package to install.
#pragma once

#include <string>
#include <vector>

#include "core/math/vec.h"

namespace tvsgs::prepare {

bool has_opencv();

/// Size of an image that OpenCV reads, such as TIFF. Throws Error(ExitCode::input).
void read_size(const std::string& file, int& width, int& height);

/// Converts 8 or 16 bits, with alpha; ignores EXIF orientation. Throws Error(ExitCode::input) and
/// Error(ExitCode::io).
void convert_to_png(const std::string& file, const std::string& png);

/// Extracts at most `most` sharp frames of a video to JPEG files in `folder`. Takes the next frame
/// when a fifth of the image has moved by about 4 % of the width. Returns the number of frames.
/// Throws Error(ExitCode::input).
int extract_frames(const std::string& video, const std::string& folder, int most);

/// A COLMAP lens from an OpenCV calibration file (YAML, XML or JSON).
struct Calibration {
    std::string model;
    std::vector<double> params;
    int width = 0, height = 0;
};
Calibration read_calibration(const std::string& file);

/// A square marker in a photograph: its corners, clockwise from the printed upper left, in pixels
/// from the corner of the first pixel.
struct Marker {
    int id = 0;
    Vec2<double> corners[4];
};

/// Names for find_markers(): DICT_4X4_50, DICT_APRILTAG_36h11, ...
std::vector<std::string> marker_dictionaries();

/// Finds ArUco or AprilTag markers of a dictionary. Throws Error(ExitCode::input).
std::vector<Marker> find_markers(const std::string& photo, const std::string& dictionary);

}  // namespace tvsgs::prepare
