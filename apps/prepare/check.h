// Checks the result of COLMAP: its quality, and which photographs to take again.
#pragma once

#include <map>
#include <string>
#include <vector>

#include "apps/prepare/sparse_model.h"
#include "io/files/json_value.h"

namespace tvsgs::prepare {

/// Consecutive photographs, by name, without a pose.
struct MissingRun {
    std::vector<std::string> names;
    std::string before, after;  // names of the registered neighbours; may be empty
    int piece = -1;             // another model that contains all of them; -1: none
    int features = -1;          // median; -1: unknown
};

struct Check {
    std::size_t photographs = 0, registered = 0, points = 0, observations = 0;
    double residual_px = 0;   // mean reprojection error
    double worst_px = 0;      // largest mean of a photograph
    std::string worst;        // the photograph with worst_px
    double track_length = 0;  // mean
    double angle_deg = 0;     // median over points of the widest angle between two of its rays
    int features = 0;         // median over the registered photographs; 0: unknown
    std::vector<std::size_t> pieces;  // registered photographs of each model, largest first
    std::vector<MissingRun> missing;
};

/// `names`: all photographs, sorted. `models[0]` is kept; the other models are not connected to it.
/// `features` may lack photographs.
Check check_models(const std::vector<std::string>& names,
                   const std::vector<SparseModel>& models,
                   const std::map<std::string, int>& features);

/// Logs the check as messages and warnings.
void log_check(const Check& check);

JsonValue json_of(const Check& check);

}  // namespace tvsgs::prepare
