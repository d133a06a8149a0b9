// In which frame the normals of a prior stand, by the points around which they lie.
// [docs/guide/priors.md#normals]
#pragma once

#include <string>
#include <vector>

#include "core/scene/camera.h"
#include "core/scene/prior_conventions.h"

namespace tvsgs {

/// Unit normals of a cloud, by the plane through the 12 nearest points; 0 where these do not lie in
/// one. Of either sign.
std::vector<Vec3f> cloud_normals(const std::vector<Vec3f>& points);

/// What a map says at a point, and what the points around say: unit, in the camera's frame, facing
/// the camera.
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
NormalReading reading_of(const NormalConvention& convention);
std::string text_of(const NormalReading& reading);

struct NormalChoice {
    NormalReading reading;
    double cosine = 0;  // mean over the samples; 0: not tested
    std::size_t samples = 0;
};

/// How well normals agree with the points of a view, and how well the best single normal would.
struct PriorAgreement {
    double cosine = 1, cosine_of_constant = 0;  // means over the samples
};
/// 1 and 0 where fewer than 50 samples tell nothing.
PriorAgreement agreement_of(const std::vector<NormalSample>& samples, const NormalReading& reading);

/// Does a map leave more than half open of what the best single normal does? (1 - cosine); up to
/// 0.15 (32 degrees) the fault may be the points': the right maps had up to 24 degrees.
inline bool tells_nothing(const PriorAgreement& a) {
    return 1 - a.cosine > 0.15 && 1 - a.cosine > 0.5 * (1 - a.cosine_of_constant);
}

/// The convention that the points bear out: each axis of the camera's frame may be turned, world
/// normals may face away. Another than the convention's has to be better by 0.2 in the mean cosine;
/// if the convention is declared, that is an error. Fewer than 50 samples test nothing. Throws
/// Error(ExitCode::input), E_PRIORS, also where nothing is better than 0.3.
NormalChoice choose_normals(const std::vector<NormalSample>& samples,
                            const NormalConvention& convention);

}  // namespace tvsgs
