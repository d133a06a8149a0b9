#include "pipeline/run/resume.h"

#include <filesystem>

#include "core/error.h"
#include "core/grouped.h"
#include "core/log.h"

namespace tvsgs {
namespace fs = std::filesystem;

Resume open_resume(const std::string& given, std::string& out, OptionTable& table) {
    Resume resume;
    resume.asked = true;
    const std::string place = given.empty() ? out : given;
    std::error_code code;
    if (place.empty()) throw Error(ExitCode::usage, "--resume: no run given; give --resume RUN");
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

void check_resume(const Resume& resume,
                  const std::string& out,
                  bool overwrite,
                  const TrainOptions& train) {
    if (!overwrite && resume.in_place() && !resume.point && holds_splats(out))
        throw Error(ExitCode::usage, "--resume: ", out,
                    " has splats but no checkpoint, so it cannot continue; give another run, "
                    "or --overwrite to remove it and start from the beginning");
    if (!resume.point) return;
    if (train.iterations <= resume.done())
        throw Error(ExitCode::usage, resume.point->file, ": already trained for ",
                    grouped(resume.done()), " iterations; give more, such as --iterations ",
                    2 * resume.done());
    for (const auto& [key, value] : resume.configured)
        if (key == "backbone" && value != train.backbone)
            throw Error(ExitCode::usage, resume.point->file, ": splats of backbone '", value,
                        "', but the configuration has '", train.backbone,
                        "'; give --set backbone=", value, ", or start a new run without --resume");
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
        spdlog::info("{}: {} iterations are done; changed since: {}", point.file,
                     grouped(point.done), json_text(changed));
    } else if (resume.asked) {
        spdlog::info("{}: no checkpoint yet; starts from the beginning", run.path());
    }
}

}  // namespace tvsgs
