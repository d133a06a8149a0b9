// The flags that describe a network.
#pragma once

#include <CLI/CLI.hpp>
#include <string>
#include <vector>

#include "apps/priors/recipe.h"

namespace tvsgs::priors {

class RecipeFlags {
public:
    void add_to(CLI::App& app);

    /// The preset's, or none, with what flags say. Throws Error(ExitCode::usage) where neither says
    /// the kind, or flags do not go together.
    Recipe recipe() const;

    /// A size that a preset has, not a flag: what the file fixes goes before it.
    bool size_of_preset() const { return !preset_.empty() && size_.empty() && side_flags() == 0; }

private:
    int side_flags() const { return (long_side_ > 0) + (short_side_ > 0); }
    void require_fitting(MapKind kind) const;
    void set_size(Recipe& recipe) const;

    std::string preset_, kind_, size_, fit_, order_, output_, quantity_, alignment_, geometry_,
        frame_, facing_, range_;
    int long_side_ = 0, short_side_ = 0, multiple_ = 0, patch_ = 0;
    double scale_ = 0;
    std::vector<double> mean_, std_;
};

}  // namespace tvsgs::priors
