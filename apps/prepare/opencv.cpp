// OpenCV functions of tvsgs-prepare: other image formats, calibration files and markers.
#include "apps/prepare/opencv.h"

#include <algorithm>
#include <opencv2/aruco.hpp>
#include <opencv2/calib3d.hpp>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>

#include "io/files/read_file.h"
#include "io/images/image_file.h"

namespace tvsgs::prepare {
namespace {

constexpr int kAsStored = cv::IMREAD_UNCHANGED | cv::IMREAD_IGNORE_ORIENTATION;

/// Converts OpenCV's exceptions to Error.
template <class Action>
auto translated(const std::string& what, const Action& action) {
    try {
        return action();
    } catch (const cv::Exception& error) {
        throw input_error(what, ": ", error.err);
    }
}

cv::Mat read_as_stored(const std::string& file) {
    return translated(file, [&] {
        cv::Mat image = cv::imread(file, kAsStored);
        if (image.empty() || (image.depth() != CV_8U && image.depth() != CV_16U))
            throw input_error(
                "E_IMAGE_READ: ", file,
                ": OpenCV cannot read it as an image of 8 or 16 bits; export it as JPEG or PNG");
        return image;
    });
}

/// In the order of cv::aruco::PREDEFINED_DICTIONARY_NAME.
const std::vector<std::string> kDictionaries{
    "DICT_4X4_50",         "DICT_4X4_100",       "DICT_4X4_250",       "DICT_4X4_1000",
    "DICT_5X5_50",         "DICT_5X5_100",       "DICT_5X5_250",       "DICT_5X5_1000",
    "DICT_6X6_50",         "DICT_6X6_100",       "DICT_6X6_250",       "DICT_6X6_1000",
    "DICT_7X7_50",         "DICT_7X7_100",       "DICT_7X7_250",       "DICT_7X7_1000",
    "DICT_ARUCO_ORIGINAL", "DICT_APRILTAG_16h5", "DICT_APRILTAG_25h9", "DICT_APRILTAG_36h10",
    "DICT_APRILTAG_36h11"};
static_assert(cv::aruco::DICT_4X4_50 == 0 && cv::aruco::DICT_APRILTAG_36h11 == 20);

/// The numbers of a matrix of any shape and type.
std::vector<double> numbers_of(const cv::FileNode& node) {
    cv::Mat matrix;
    node >> matrix;
    if (matrix.empty()) return {};
    matrix.convertTo(matrix, CV_64F);
    matrix = matrix.reshape(1, 1);
    return {matrix.begin<double>(), matrix.end<double>()};
}

}  // namespace

bool has_opencv() {
    return true;
}

void read_size(const std::string& file, int& width, int& height) {
    const cv::Mat image = read_as_stored(file);
    width = image.cols, height = image.rows;
}

void convert_to_png(const std::string& file, const std::string& png) {
    const cv::Mat image = read_as_stored(file);
    translated(png, [&] {
        if (!cv::imwrite(png, image)) throw Error(ExitCode::io, png + ": cannot write it");
        return 0;
    });
}

Calibration read_calibration(const std::string& file) {
    read_text(file);  // reports errors of the file itself
    return translated(file, [&] {
        const cv::FileStorage in(file, cv::FileStorage::READ);
        const auto first = [&](std::initializer_list<const char*> names) {
            for (const char* name : names)
                if (!in[name].empty()) return in[name];
            return cv::FileNode();
        };
        const std::vector<double> K = numbers_of(first({"camera_matrix", "cameraMatrix"}));
        std::vector<double> d =
            numbers_of(first({"distortion_coefficients", "dist_coeffs", "distCoeffs"}));
        const cv::FileNode width = first({"image_width", "imageWidth"}),
                           height = first({"image_height", "imageHeight"});
        if (K.size() != 9 || d.empty() || width.empty() || height.empty())
            throw input_error(file,
                              ": expected camera_matrix (3x3), distortion_coefficients, "
                              "image_width and image_height, from a calibration by OpenCV");
        Calibration out;
        out.width = static_cast<int>(width), out.height = static_cast<int>(height);
        // OpenCV counts from the centre of the first pixel, COLMAP from its corner.
        out.params = {K[0], K[4], K[2] + 0.5, K[5] + 0.5};
        const bool fisheye =
            !in["fisheye_model"].empty() && static_cast<int>(in["fisheye_model"]) != 0;
        if (d.size() > 8 && std::any_of(d.begin() + 8, d.end(), [](double k) { return k != 0; }))
            throw input_error(file,
                              ": has thin prism or tilt coefficients, unknown to the models of "
                              "COLMAP; calibrate without them");
        out.model = fisheye ? "OPENCV_FISHEYE" : d.size() > 4 ? "FULL_OPENCV" : "OPENCV";
        d.resize(out.model == "FULL_OPENCV" ? 8 : 4);
        out.params.insert(out.params.end(), d.begin(), d.end());
        return out;
    });
}

std::vector<std::string> marker_dictionaries() {
    return kDictionaries;
}

std::vector<Marker> find_markers(const std::string& photo, const std::string& dictionary) {
    const auto known = std::ranges::find(kDictionaries, dictionary);
    if (known == kDictionaries.end())
        throw Error(ExitCode::usage, "--marker-dictionary " + dictionary + ": unknown; see --help");
    // Uses our reader, so that the pixels are those of training and COLMAP.
    ImageU8 image = read_image(photo, 1);
    return translated(photo, [&] {
        const cv::Mat grey(image.height, image.width, CV_8UC1, image.pixels.data());
        const auto parameters = cv::aruco::DetectorParameters::create();
        parameters->cornerRefinementMethod = cv::aruco::CORNER_REFINE_SUBPIX;
        std::vector<std::vector<cv::Point2f>> corners;
        std::vector<int> ids;
        cv::aruco::detectMarkers(
            grey,
            cv::aruco::getPredefinedDictionary(static_cast<int>(known - kDictionaries.begin())),
            corners, ids, parameters);
        std::vector<Marker> markers(ids.size());
        for (std::size_t i = 0; i < ids.size(); ++i) {
            markers[i].id = ids[i];
            for (std::size_t c = 0; c < 4; ++c)
                markers[i].corners[c] = {static_cast<double>(corners[i][c].x) + 0.5,
                                         static_cast<double>(corners[i][c].y) + 0.5};
        }
        return markers;
    });
}

}  // namespace tvsgs::prepare
