// The keys of a run's config.json, for every command that reads a run folder.
#pragma once

#include <string>

#include "io/config/config.h"
#include "io/scene/scene_reader.h"
#include "mvs/stereo/patch_match.h"
#include "optim/loop/train.h"
#include "pipeline/mesh/mesh_extraction.h"
#include "pipeline/mesh/mesh_output.h"
#include "pipeline/priors/priors.h"
#include "pipeline/run/train_evaluation.h"
#include "plan/memory.h"
#include "plan/settings.h"

namespace tvsgs {

struct OutputOptions {
    enum class Scales { automatic, three } ply_scales = Scales::automatic;

    template <class Visitor>
    void fields(Visitor& field) {
        field.choice("ply_scales", ply_scales, {"auto", "three"},
                     "scales per splat in PLY files; auto: two if the rasteriser draws discs; "
                     "three: with a thin third one, for viewers of 3DGS");
    }
};

struct RunOptions {
    SceneOptions scene;
    TrainOptions train;
    StereoOptions stereo;  // used for a scene with few points
    PriorOptions priors;
    MeshOptions mesh;
    MeshOutputOptions mesh_output;  // under the key `mesh`
    EvaluationOptions eval;
    MemoryOptions memory;
    PlanOptions plan;
    OutputOptions output;

    /// Adds all options to the table, which then refers to this object.
    void add_to(OptionTable& table) {
        table.add("", train);
        table.add("scene", scene);
        table.add("stereo", stereo);
        table.add("priors", priors);
        table.add("mesh", mesh);
        table.add("mesh", mesh_output);
        table.add("eval", eval);
        table.add("memory", memory);
        table.add("plan", plan);
        table.add("output", output);
    }
};

/// Options with the table that sets them by key. A copy is independent of its original.
struct Configuration {
    RunOptions options;
    OptionTable table;

    Configuration() { options.add_to(table); }
    Configuration(const Configuration& other) : options(other.options) {
        options.add_to(table);
        for (const Option& option : other.table.options())
            if (!option.source.empty()) table.set(option.key, option.get(), option.source);
    }
    Configuration& operator=(const Configuration&) = delete;
};

inline std::string config_json(RunOptions options, const JsonValue& info) {
    OptionTable table;
    options.add_to(table);
    return table.json(info);
}

}  // namespace tvsgs
