// Voting events of a trainer whose splats move and grow, with the results of TensorVoter.
#pragma once

#include "tv/tv_support.h"

namespace tvsgs::test {

struct VotesEvent {
    Cloud splats;
    bool refresh;
    std::vector<int> parents{};  // of a refresh; empty: none
};

inline TvOptions votes_options() {
    TvOptions options = options_with(20);
    options.refresh_every = 1000;
    return options;
}

inline std::vector<VotesEvent> votes_events() {
    Random random(7);
    const auto moved = [&](Cloud cloud) {
        for (Vec3f& mean : cloud.means) mean = mean + 0.01f * random.normal3();
        return cloud;
    };
    const Cloud start = sphere(300, 5, 0.03f);
    Cloud broken = moved(start);  // its search has found the splat
    broken.means[10].y = std::nanf("");
    const Cloud shifted = moved(start);
    Cloud grown;
    std::vector<int> parents;
    for (int i = 20; i < 350; ++i) {  // 20 removed, 30 doubled, 20 new
        const std::size_t parent = std::size_t(i % start.size());
        grown.add(shifted.means[parent], start.scales[parent], start.quats[parent]);
        parents.push_back(i < 330 ? int(parent) : -1);
    }
    return {{start, true},           {broken, false},       {moved(broken), true},
            {grown, true, parents},  {moved(grown), false}, {sphere(90, 6, 0.02f), true},
            {sphere(1, 6, 0), true}, {Cloud{}, true}};
}

/// The field after each event.
template <class Device>
std::vector<FieldOnHost> votes_results(const std::vector<VotesEvent>& events) {
    const TvOptions options = votes_options();
    TensorVoter<Device> voter(options);
    TensorField<Device> field;
    std::vector<FieldOnHost> results;
    int step = 1;
    for (const VotesEvent& event : events) {
        step += event.refresh ? options.refresh_every : options.vote_every;
        const Buffer<int, Device> parents = to_device<Device>(event.parents);
        if (!event.parents.empty()) voter.structure_changed(parents.span(), field);
        voter.vote(step, to_gaussians<Device>(event.splats), field);
        results.push_back(read(field, voter));
    }
    return results;
}

}  // namespace tvsgs::test
