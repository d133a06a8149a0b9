// tvsgs-view: shows runs as one file that opens in a browser without a network, or serves them to
// the browser of this machine, also during a training.
#include <filesystem>

#include "apps/common/command_line.h"
#include "apps/common/open_page.h"
#include "apps/view/server.h"
#include "io/files/atomic_file.h"
#include "io/files/read_file.h"
#include "pipeline/run/run_folder.h"
#include "report/view_page.h"

namespace tvsgs {
namespace {

constexpr std::size_t kMaxRuns = 2;  // side by side

struct Arguments {
    ViewInput input;
    ViewPageOptions page;
    std::string out;  // empty: serve the page
    int port = 0;
    bool open = false;
};

Arguments parse(int argc, char** argv) {
    Arguments a;
    double megabytes = 40;
    CLI::App app{
        "Shows one run, or two side by side, on a page: splats, mesh, cameras with photographs, "
        "errors.",
        "tvsgs-view"};
    app.get_formatter()->column_width(40);
    app.add_option("runs,-m,--run,--model,--model-path", a.input.runs,
                   "run folder, two run folders of one scene, or a file of splats")
        ->required();
    add_output_flag(app, "-o,--out,--output", a.out,
                    "page to write, .html [none: served to a browser of this machine, also while a "
                    "run trains]");
    add_number(app, "--port", a.port, 1, 65535, "port of the server [any free one]");
    app.add_option("-s,--scene", a.input.scene, "folder of the scene [that of the first run]");
    app.add_option("--gt", a.input.gt,
                   "true surface, mesh or cloud: colours splats and mesh by distance to it [that "
                   "of the evaluation]");
    app.add_option("--crop", a.input.crop, "with --gt: selection volume, as for tvsgs-eval");
    add_number(app, "--megabytes", megabytes, 1.0, 2000.0,
               "page size; view-dependent colour, then small splats are dropped [40]");
    add_number(app, "--max-splats", a.page.max_splats, 1, 50000000,
               "keep the N largest splats of each run [all]");
    add_number(app, "--photos", a.page.max_photos, 0, 10000, "most photographs on the page [60]");
    app.add_flag("--open", a.open,
                 "open the written page in the browser of the desktop (xdg-open)");
    add_log_flags(app);
    parse_command_line(app, argc, argv);
    if (a.input.runs.size() > kMaxRuns)
        throw usage_error(a.input.runs.size(), " runs; expected one or two");
    if (!a.input.crop.empty() && a.input.gt.empty())
        throw usage_error("--crop ", a.input.crop, ": needs --gt");
    if (const std::string& last = a.input.runs.back();
        a.out.empty() && std::filesystem::path(last).extension() == ".html")
        throw usage_error(last, ": expected a run folder; to write a page, give --out ", last);
    if (a.out.empty() && is_file(a.input.runs.front()))
        throw usage_error(a.input.runs.front(),
                          ": is a file; to write its page, give --out FILE.html");
    if (a.out.empty() && a.input.runs.size() > 1)
        throw usage_error("two runs: give --out FILE.html; the server shows one run only");
    if (!a.out.empty() && a.port > 0)
        throw usage_error("--port and --out exclude each other: a file is not served");
    if (a.open && a.out.empty())  // the list of processes would show the token
        throw usage_error("--open needs --out FILE.html; open the address of a server yourself");
    a.page.max_bytes = static_cast<std::size_t>(megabytes * 1e6);
    return a;
}

}  // namespace

int command(int argc, char** argv) {
    const Arguments a = parse(argc, argv);
    if (a.out.empty()) {
        serve(a.input, a.page, a.port);
        return 0;
    }
    require_output(a.out, {".html"}, {});
    const ViewPage page = view_page(read_view_subject(a.input), a.page);
    for (const std::string& note : page.notes) spdlog::warn("{}", note);
    write_text_file(a.out, page.html);
    spdlog::info("Page: {} ({:.1f} MB){}", a.out, static_cast<double>(page.html.size()) / 1e6,
                 a.open ? "" : "; open it in a browser");
    if (a.open) open_page(a.out);
    say_next({"tvsgs-export", a.input.runs.front(), "splats.spz"},
             "write the splats for other viewers");
    return 0;
}

}  // namespace tvsgs
