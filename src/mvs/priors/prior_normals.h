// Detection of the frame of prior normals from the points around them.
// [docs/guide/priors.md#normals]
#pragma once

#include <string>
#include <vector>

#include "core/scene/camera.h"
#include "core/scene/prior_conventions.h"

namespace tvsgs {

/// Unit normals of a cloud, each of the plane through the 12 nearest points, with either sign; 0 if
/// these points do not lie in a plane.
std::vector<Vec3f> cloud_normals(const std::vector<Vec3f>& points);

/// The map's normal at a point and the normal of the surrounding points: unit, in the camera's
/// frame, facing the camera.
struct NormalSample {
    Vec3d found;  // as in the file
    Vec3d
        found_world;  // camera_from_world.R * found: in the camera's frame if the file is in world
    Vec3d expected;
};

/// camera = signs * (world ? R : 1) * found, element by element.
struct NormalReading {
    bool world = false;
    Vec3f signs{1, 1, 1};
};
/// The reading that a convention describes, and its name for messages.
NormalReading reading_of(const NormalConvention& convention);
std::string text_of(const NormalReading& reading);

/// The chosen reading with its agreement.
struct NormalChoice {
    NormalReading reading;
    double cosine = 0;  // mean over the samples; 0: not tested
    std::size_t samples = 0;
};

/// Agreement of normals with the points of a view, and of the best single normal.
struct PriorAgreement {
    double cosine = 1, cosine_of_constant = 0;  // means over the samples
};
/// 1 and 0 for fewer than 50 samples, which cannot tell.
PriorAgreement agreement_of(const std::vector<NormalSample>& samples, const NormalReading& reading);

/// True if the map's error (1 - cosine) is more than half of that of the best single normal. Up to
/// 0.15 (32 degrees) the points may be wrong: the right maps had errors of up to 24 degrees.
inline bool is_uninformative(const PriorAgreement& a) {
    return 1 - a.cosine > 0.15 && 1 - a.cosine > 0.5 * (1 - a.cosine_of_constant);
}

/// The convention that fits the points. It tries a sign for each axis of the camera's frame, and
/// world normals with either sign. A reading other than `convention` must be better by 0.2 in mean
/// cosine; if `convention` is declared, that is an error. Fewer than 50 samples test nothing.
/// Throws Error(ExitCode::input), E_PRIORS, also if no reading exceeds 0.3.
NormalChoice choose_normals(const std::vector<NormalSample>& samples,
                            const NormalConvention& convention);

}  // namespace tvsgs
