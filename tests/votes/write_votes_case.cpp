// write_votes_case FOLDER: events of votes_case.h, their results, and the voting losses of one
// event with their derivatives, as raw arrays for test_python.py.
#include <filesystem>
#include <fstream>

#include "optim/losses/loss_tv.h"
#include "votes/votes_case.h"

namespace tvsgs::test {
namespace {

std::filesystem::path folder;

template <class T>
void write(const std::string& name, const std::vector<T>& values) {
    std::ofstream(folder / name, std::ios::binary)
        .write(reinterpret_cast<const char*>(values.data()),
               std::streamsize(values.size() * sizeof(T)));
}

/// One of the losses with weight 1: its value, and its derivatives in `dL`.
template <bool kPosition>
double evaluate(const Gaussians<Cpu>& gaussians,
                const TensorField<Cpu>& field,
                Span<const float> radii_px,
                Reduction reduction,
                Gaussians<Cpu>& dL) {
    LossContext context;
    context.shared.tv_reduction = reduction;
    Objective<Cpu> objective;
    resize(objective.dL_dgaussians, gaussians.size(), 0);
    fill_zero(objective.dL_dgaussians);
    objective.partial.resize(kSumBlocks), objective.count.resize(1);
    copy(std::vector<double>{0}, objective.values);
    TvLoss<Cpu, kPosition>({1, 1}, context)
        .add_to(objective, {gaussians, {}, {}, field, radii_px, 1});
    dL = std::move(objective.dL_dgaussians);
    return objective.values[0];
}

void write_losses(const Cloud& splats, const FieldOnHost& on_host) {
    const Gaussians<Cpu> gaussians = to_gaussians<Cpu>(splats);
    TensorField<Cpu> field;
    copy(on_host.normals, field.normals), copy(on_host.targets, field.targets);
    copy(on_host.flags, field.flags);
    std::vector<std::uint8_t> visible;
    std::vector<float> radii_px;
    for (int i = 0; i < splats.size(); ++i) {
        visible.push_back(i % 3 != 0);
        radii_px.push_back(i % 3 != 0 ? 2.0f : 0.0f);
    }
    write("visible", visible);
    for (const auto& [name, reduction] :
         {std::pair{"all", Reduction::mean}, std::pair{"visible", Reduction::visible_mean}}) {
        const Span<const float> radii{radii_px.data(), radii_px.size()};
        Gaussians<Cpu> by_normal, by_position;
        const double normal = evaluate<false>(gaussians, field, radii, reduction, by_normal);
        const double position = evaluate<true>(gaussians, field, radii, reduction, by_position);
        write(str("loss_", name), std::vector{normal, position});
        write(str("dL_dquats_", name), to_host(by_normal.quats));
        write(str("dL_dmeans_", name), to_host(by_position.means));
    }
}

}  // namespace
}  // namespace tvsgs::test

int main(int /*argc*/, char** argv) {
    using namespace tvsgs;
    using namespace tvsgs::test;
    folder = argv[1];
    const std::vector<VotesEvent> events = votes_events();
    const std::vector<FieldOnHost> results = votes_results<Cpu>(events);
    for (std::size_t i = 0; i < events.size(); ++i) {
        const Gaussians<Cpu> g = to_gaussians<Cpu>(events[i].splats);
        const auto named = [i](const char* name) { return str(name, '_', i); };
        write(named("means"), to_host(g.means));
        write(named("log_scales"), to_host(g.log_scales));
        write(named("quats"), to_host(g.quats));
        if (events[i].refresh) write(named("parents"), events[i].parents);
        write(named("normals"), results[i].normals);
        write(named("targets"), results[i].targets);
        write(named("eigenvalues"), results[i].eigenvalues);
        write(named("flags"), results[i].flags);
    }
    write_losses(events[4].splats, results[4]);
}
