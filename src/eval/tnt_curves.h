// Writes precision and recall over the threshold, in the files of the official tool.
#pragma once

#include <string>

#include "eval/tnt_protocol.h"

namespace tvsgs {

/// Writes FOLDER/<scene>.precision.txt, .recall.txt, .prf_tau_plotstr.txt and
/// PR_<scene>_@d_th_0_*.svg.
void write_curves(const std::string& folder,
                  const std::string& scene,
                  const TntMetrics& metrics,
                  double tau);

}  // namespace tvsgs
