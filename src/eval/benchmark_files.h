// Parts that the DTU and Tanks and Temples evaluations share: predictions, truths, culling by
// masks, a check of the frames, and clouds coloured by their errors.
#pragma once

#include <string>
#include <vector>

#include "core/scene/image.h"
#include "eval/protocols.h"

namespace tvsgs {

/// Positions and faces in double precision.
struct PreciseMesh {
    Points vertices;
    std::vector<Vec3i> faces;
};

/// Keeps the marked vertices, and the faces whose corners are all kept.
void keep_vertices(PreciseMesh& mesh, const std::vector<char>& keep);

/// Removes vertices that are not finite, and their faces; returns the number of vertices.
std::size_t drop_non_finite(PreciseMesh& mesh);

/// A mask and its projection: pixel ~ rows * world + last.
struct MaskView {
    Vec3d rows[3], last;
    ImageU8 mask;  // [H, W, 1], 0: background
};

/// True where a pixel of `mask` that is not 0 lies within `radius` pixels.
ImageU8 dilated(const ImageU8& mask, int radius);

/// Keeps a vertex if in every view it lies outside of the image or inside the mask dilated by
/// `radius` pixels. Returns per view the number of vertices that this view rejects.
std::vector<std::size_t> cull_by_masks(PreciseMesh& mesh,
                                       const std::vector<MaskView>& views,
                                       int radius);

/// A mesh, a cloud, or the centres of splats; vertices that are not finite are removed.
struct Prediction {
    PreciseMesh mesh;
    bool is_splats = false;
    std::size_t vertices = 0, faces = 0, dropped = 0, transparent = 0;  // as read; removed
};

/// Drops splats fainter than `min_opacity`. Throws Error(ExitCode::input) when nothing remains.
Prediction read_prediction(const std::string& path, double min_opacity);

/// Returns the finite points of a ground-truth file. `missing`: message if the file does not exist,
/// with the expected file and where the benchmark distributes it.
Points read_truth(const std::string& path, const std::string& missing);

/// Throws Error(ExitCode::input) with `missing` unless the file exists.
void require_file(const std::string& path, const std::string& missing);

struct FrameCheck {
    Vec3d offset{};            // centre of the prediction minus centre of the truth
    double size_ratio = 1;     // of the diagonals, prediction over truth
    bool apart = false;        // the boxes do not overlap
    Vec3d lower[2], upper[2];  // boxes of prediction and truth

    /// Whether the boxes overlap and their sizes differ by less than 20 times, else a unit is
    /// wrong.
    bool plausible() const { return !apart && size_ratio > 0.05 && size_ratio < 20; }

    /// Boxes, offset and ratio as text.
    std::string text() const;
};

/// Compares boxes of the middle 90 % of the points along each axis, so that outliers do not count.
/// Neither cloud may be empty.
FrameCheck check_frame(const Points& prediction, const Points& truth);

enum class ErrorPalette {
    dtu,   // white to red over 10 mm; green: outliers; blue: excluded
    tnt,   // matplotlib's "hot" reversed, over three thresholds
    safe,  // cividis, for colour-blind readers; orange: outliers; grey: excluded
};

/// RGB in [0, 1] for an error; `full` is the end of the scale. `dtu` and `safe` have separate
/// colours for outliers and excluded points; `tnt` shows outliers at the end of its scale.
Vec3f error_color(ErrorPalette palette, double error, double full, PointStatus status);

/// Parses a name of --palette; returns `standard` for an empty name.
ErrorPalette find_palette(const std::string& name, ErrorPalette standard);

/// Writes points coloured by their errors; `full` is the end of the colour scale.
void write_error_cloud(const std::string& path,
                       const MeasuredPoints& points,
                       ErrorPalette palette,
                       double full);

}  // namespace tvsgs
