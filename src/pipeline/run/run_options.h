// All options of a run, as stored in its config.json.
#pragma once

#include "io/config/config.h"
#include "io/scene/scene_reader.h"
#include "mvs/stereo/descriptors.h"
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
    DescriptorOptions descriptors;
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
        table.add("descriptors", descriptors);
        table.add("priors", priors);
        table.add("mesh", mesh);
        table.add("mesh", mesh_output);
        table.add("eval", eval);
        table.add("memory", memory);
        table.add("plan", plan);
        table.add("output", output);
    }
};

}  // namespace tvsgs
