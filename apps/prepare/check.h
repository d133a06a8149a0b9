// What came out of COLMAP: how good it is, and what to photograph again.
#pragma once

#include <map>
#include <string>
#include <vector>

#include "apps/prepare/sparse_model.h"
#include "io/files/json_value.h"

namespace tvsgs::prepare {

/// A row of photographs, by name, that found no pose.
struct MissingRun {
    std::vector<std::string> names;
    std::string before, after;  // the registered neighbours by name; may be empty
    int piece = -1;             // they hang together among themselves, in that other model
    int features = -1;          // median; -1: not known
};

struct Check {
    std::size_t photographs = 0, registered = 0, points = 0, observations = 0;
    double residual_px = 0;           // mean distance of an observation to its point's projection
    double worst_px = 0;              // of a photograph's mean
    std::string worst;                // that photograph
    double track_length = 0;          // mean
    double angle_deg = 0;             // median over points: widest angle between two of its rays
    int features = 0;                 // median over the registered photographs; 0: not known
    std::vector<std::size_t> pieces;  // registered photographs of each model, largest first
    std::vector<MissingRun> missing;
};

/// `names` are all photographs, sorted; `models[0]` is the one that is kept, the others are what
/// does not hang together with it. `features` may lack photographs.
Check check_models(const std::vector<std::string>& names,
                   const std::vector<SparseModel>& models,
                   const std::map<std::string, int>& features);

/// The same for people: messages and warnings of the log.
void say_check(const Check& check);

JsonValue json_of(const Check& check);

}  // namespace tvsgs::prepare
