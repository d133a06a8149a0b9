#include "apps/reconstruct/record.h"

#include <algorithm>

#include "core/error.h"
#include "core/version.h"
#include "io/files/atomic_file.h"
#include "io/files/json_value.h"
#include "io/files/read_file.h"

namespace tvsgs::reconstruct {

namespace fs = std::filesystem;

Record::Record(const fs::path& folder) : file_((folder / "reconstruct.json").string()) {
    if (!fs::exists(file_)) return;
    const JsonValue json = parse_json_value(read_text(file_), file_);
    if (!json["version"].text.starts_with("tvsgs ") || !json["stages"].is(JsonValue::Kind::list))
        throw input_error(file_, ": not a file of tvsgs-reconstruct; choose another folder");
    for (const JsonValue& stage : json["stages"].items)
        stages_.push_back({stage["name"].text, stage["command"].text, stage["done"].number != 0});
    is_new_ = false;
}

const Record::Stage* Record::find(const std::string& name) const {
    const auto found = std::ranges::find(stages_, name, &Stage::name);
    return found == stages_.end() ? nullptr : &*found;
}

bool Record::is_done(const std::string& name) const {
    const Stage* const stage = find(name);
    return stage != nullptr && stage->done;
}

void Record::clear() {
    stages_.clear();
    save();
}

void Record::start(const std::string& name, const std::string& command) {
    stages_.erase(std::ranges::find(stages_, name, &Stage::name), stages_.end());
    stages_.push_back({name, command});
    save();
}

void Record::finish(const std::string& name) {
    std::ranges::find(stages_, name, &Stage::name)->done = true;
    save();
}

void Record::save() const {
    JsonValue stages = JsonValue::list();
    for (const Stage& stage : stages_)
        stages.items.push_back(JsonValue()
                                   .add("name", stage.name)
                                   .add("command", stage.command)
                                   .add("done", stage.done));
    write_text_file(file_,
                    json_text(JsonValue().add("version", kVersion).add("stages", stages)) + "\n");
}

}  // namespace tvsgs::reconstruct
