// Selects sharp frames of a video at regular steps of motion.
#include <algorithm>
#include <filesystem>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <opencv2/video/tracking.hpp>
#include <opencv2/videoio.hpp>

#include "apps/prepare/opencv.h"
#include "core/log.h"
#include "io/files/read_file.h"
#include "pipeline/run/signals.h"

namespace tvsgs::prepare {
namespace {

namespace fs = std::filesystem;

constexpr int kLookWidth = 320;  // motion and sharpness are measured at this width
// Of the width, by the parts that move most: about 10 degrees of an orbit.
constexpr double kStep = 0.04;
constexpr double kLookFrom = 0.6;  // of a step: a frame may be taken from here on
constexpr double kStepEnd = 1.4;   // of a step: a frame must be taken here

cv::Mat small_grey(const cv::Mat& frame) {
    cv::Mat grey, small;
    cv::cvtColor(frame, grey, cv::COLOR_BGR2GRAY);
    const double scale = static_cast<double>(kLookWidth) / grey.cols;
    cv::resize(grey, small, {}, scale, scale, cv::INTER_AREA);
    return small;
}

/// Variance of the Laplacian: small for blurred edges.
double sharpness(const cv::Mat& grey) {
    cv::Mat edges;
    cv::Laplacian(grey, edges, CV_32F);
    cv::Scalar mean, deviation;
    cv::meanStdDev(edges, mean, deviation);
    return deviation[0] * deviation[0];
}

/// Tracks corners from frame to frame and measures their motion since a frame, in image widths. A
/// fifth of them moves more than the result: around an object, its centre does not move.
class Motion {
public:
    void start(const cv::Mat& grey) {
        cv::goodFeaturesToTrack(grey, began_, 300, 0.01, 7);
        now_ = began_, last_ = grey, count_ = began_.size();
    }
    double follow(const cv::Mat& grey) {
        if (began_.empty()) return start(grey), kStep;
        std::vector<cv::Point2f> next;
        std::vector<unsigned char> found;
        std::vector<float> error;
        cv::calcOpticalFlowPyrLK(last_, grey, now_, next, found, error);
        std::vector<cv::Point2f> began, now;
        std::vector<double> moved;
        const cv::Rect2f inside(0, 0, static_cast<float>(grey.cols), static_cast<float>(grey.rows));
        for (std::size_t i = 0; i < next.size(); ++i) {
            if (!found[i] || !inside.contains(next[i])) continue;
            began.push_back(began_[i]), now.push_back(next[i]);
            moved.push_back(cv::norm(next[i] - began_[i]) / grey.cols);
        }
        began_ = began, now_ = now, last_ = grey;
        // Most corners are lost: far enough.
        if (2 * moved.size() < count_) return kStep * kStepEnd;
        const auto far = moved.begin() + static_cast<std::ptrdiff_t>(moved.size() * 4 / 5);
        std::nth_element(moved.begin(), far, moved.end());
        return *far;
    }

private:
    std::vector<cv::Point2f> began_, now_;
    std::size_t count_ = 0;
    cv::Mat last_;
};

/// Keeps every n-th file and removes the others.
void thin_out(std::vector<std::string>& files, std::size_t most) {
    if (files.size() <= most) return;
    std::vector<std::string> kept;
    for (std::size_t i = 0; i < most; ++i) kept.push_back(files[i * files.size() / most]);
    for (const std::string& file : files)
        if (std::ranges::find(kept, file) == kept.end()) fs::remove(file);
    files = kept;
}

}  // namespace

int extract_frames(const std::string& video, const std::string& folder, int most) {
    cv::VideoCapture in(video);
    if (!in.isOpened())
        throw input_error(video, ": OpenCV cannot read it as a video; convert it to MP4");
    std::vector<std::string> files;
    const auto keep = [&](const cv::Mat& frame) {
        files.push_back(fmt::format("{}/frame_{:05}.jpg", folder, files.size()));
        if (!cv::imwrite(files.back(), frame, {cv::IMWRITE_JPEG_QUALITY, 97}))
            throw Error(ExitCode::io, files.back() + ": cannot write it");
    };
    Motion motion;
    cv::Mat frame, best;
    double sharpest = -1;
    while (in.read(frame)) {
        SignalGuard::check();
        const cv::Mat grey = small_grey(frame);
        const double moved = files.empty() ? kStep : motion.follow(grey);
        if (moved >= kStep * kLookFrom)
            if (const double sharp = sharpness(grey); sharp > sharpest)
                sharpest = sharp, frame.copyTo(best);
        if (moved < kStep * kStepEnd && !files.empty()) continue;
        keep(best);
        motion.start(small_grey(best));
        sharpest = -1;
        motion.follow(grey);  // frames were skipped since
    }
    if (sharpest >= 0) keep(best);
    if (files.size() < 2)
        throw input_error(
            video, ": ", files.size(),
            " frames from different places; expected 2 or more: did the camera move?");
    thin_out(files, static_cast<std::size_t>(most));
    return static_cast<int>(files.size());
}

}  // namespace tvsgs::prepare
