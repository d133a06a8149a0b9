#include "apps/eval/result.h"

#include <cstdio>

#include "core/error.h"
#include "core/version.h"
#include "io/files/atomic_file.h"

namespace tvsgs {

void put_report(const JsonValue& json, const std::string& out) {
    JsonValue report = JsonValue().add("version", kVersion);
    report.members.insert(report.members.end(), json.members.begin(), json.members.end());
    const std::string text = json_text(report) + "\n";
    std::fputs(text.c_str(), stdout);
    if (out.empty()) return;
    write_text_file(out, text);
    result_of_run() = out;
}

std::string& result_of_run() {
    static std::string path;
    return path;
}

}  // namespace tvsgs
