#include "pipeline/run/resume.h"

#include <filesystem>

#include "core/error.h"
#include "core/log.h"

namespace tvsgs {
namespace fs = std::filesystem;

Resume open_resume(const std::string& given, std::string& out, OptionTable& table) {
    Resume resume;
    resume.asked = true;
    const std::string place = given.empty() ? out : given;
    std::error_code code;
    if (place.empty())
        throw Error(ExitCode::usage,
                    "--resume: no run given; expected --resume RUN, or --out RUN with it");
    if (!given.empty() || fs::is_directory(place, code)) resume.point = open_checkpoint(place);
    const std::string run = resume.point ? resume.point->run : place;
    if (out.empty()) out = run;
    resume.same_run = run == out || fs::equivalent(run, out, code);
    if (resume.point) {
        table.read_text(resume.point->file, resume.point->config);
        resume.configured = config_values(table);
    }
    const std::string config = out + "/config.json";
    if (resume.same_run && fs::exists(config, code)) table.read_file(config);
    return resume;
}

bool is_configured(const Resume& resume, const std::string& out) {
    std::error_code code;
    return resume.asked && (resume.point || fs::exists(out + "/config.json", code));
}

void require_nothing_lost(const Resume& resume, const std::string& out) {
    if (!resume.in_place() || resume.point || !holds_splats(out)) return;
    throw Error(
        ExitCode::usage,
        str("--resume: ", out,
            " has splats and no checkpoint (--checkpoint-every 0, or one that was lost), so "
            "it cannot go on; expected another run, or --overwrite, which removes this one "
            "and starts from the beginning"));
}

void require_iterations_left(const Resume& resume, int iterations) {
    if (!resume.point || iterations > resume.done()) return;
    throw Error(ExitCode::usage,
                str(resume.point->file, ": ", resume.done(),
                    " iterations are done; expected more than that in all, such as --iterations ",
                    2 * resume.done()));
}

void require_same_backbone(const Resume& resume, const std::string& backbone) {
    if (!resume.point) return;
    for (const auto& [key, value] : resume.configured)
        if (key == "backbone" && value != backbone)
            throw Error(ExitCode::usage,
                        str(resume.point->file, ": its splats are those of backbone '", value,
                            "', and the run is to go on with '", backbone, "'; expected backbone ",
                            value, ", or a new run (without --resume)"));
}

void log_resume(const Resume& resume, const JsonValue& changed, RunFolder& run) {
    if (resume.point) {
        const ResumePoint& point = *resume.point;
        if (resume.in_place()) remove_checkpoints_after(run.path(), point.done);
        run.log(JsonValue()
                    .add("event", "resumed")
                    .add("iteration", point.done)
                    .add("seconds", point.seconds)
                    .add("checkpoint", point.file)
                    .add("changed", changed));
        spdlog::info("{}: {} iterations are done; changed since: {}", point.file, point.done,
                     json_text(changed));
    } else if (resume.asked) {
        spdlog::info("{}: no checkpoint yet, so the run starts from the beginning", run.path());
    }
}

}  // namespace tvsgs
