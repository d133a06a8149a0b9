#include "apps/common/command_line.h"

#include <fcntl.h>

#include <algorithm>
#include <cctype>
#include <cerrno>
#include <cmath>
#include <csignal>
#include <cstdio>
#include <cstring>
#include <exception>
#include <new>
#include <regex>
#include <set>
#include <string_view>

#include "apps/common/build_info.h"
#include "apps/common/help_pages.h"
#include "core/device/buffer.h"
#include "core/device/threads.h"
#include "core/grouped.h"
#include "core/nearest_name.h"
#include "core/progress.h"
#include "io/files/atomic_file.h"
#include "io/files/manifest.h"
#include "mesh/fuse/device_algorithms.h"
#include "pipeline/run/signals.h"

namespace tvsgs {
namespace {

/// Thrown after --help or --version has been printed.
struct AskedAndAnswered {};

/// Reports a failed write to standard output, unless the reader has closed it.
void flush_standard_output() {
    errno = 0;
    if ((std::fflush(stdout) != 0 || std::ferror(stdout) != 0) && errno != EPIPE)
        throw Error(ExitCode::io, "cannot write to standard output",
                    errno != 0 ? str(": ", std::strerror(errno)) : "");
}

/// Ignores SIGPIPE, so that a reader that ends (`| head`) does not kill a training. Opens closed
/// standard streams, so that no file of the run gets their numbers and receives messages.
void guard_standard_streams() {
    std::signal(SIGPIPE, SIG_IGN);
    std::signal(SIGXFSZ, SIG_IGN);  // a file-size limit becomes an error with a message
    for (int stream = 0; stream < 3; ++stream)
        if (fcntl(stream, F_GETFD) == -1)
            open("/dev/null", O_RDWR);  // takes the lowest free number
}

constexpr const char* kPlainLetters =  // need no quotes in a shell
    "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789-_./+=:,@%";
constexpr const char* kManFlag = "--help-man";      // used by cmake/install.cmake
constexpr const char* kWordsFlag = "--help-words";  // used by packaging/tvsgs.bash

/// Placeholder for the text value of an option, by its first long name.
std::string type_of(const CLI::Option& option) {
    static const std::pair<const char*, std::set<std::string>> kTypes[] = {
        {"SIZE", {"gpu-memory", "host-memory", "memory"}},
        {"NAME", {"split", "method", "scene-name", "points", "mesh-units", "marker-dictionary"}},
        {"NAME,...", {"scenes", "checkpoints"}},
        {"N", {"scan", "cull-dilate"}},
        {"N,N,...", {"views", "gpus", "cull", "spz-sh-bits"}},
        {"X", {"max-distance", "tnt-tau"}},
        {"X,X,...", {"tau", "eval-at"}},
        {"X,Y,Z,X,Y,Z", {"bbox"}},
        {"KEY=VALUE", {"set"}},
        {"KEY<=X", {"require"}},
        {"DEVICE", {"device"}},
        {"auto|none|N", {"texture"}}};
    for (const auto& [type, names] : kTypes)
        if (!option.get_lnames().empty() && names.contains(option.get_lnames().front()))
            return type;
    return "PATH";
}

/// Settings of all options: the last value wins, and help shows the default unless the description
/// does.
void settle_flags(CLI::App& app) {
    start_group(app, CLI::OptionDefaults().get_group());
    if (!app.get_parent())
        app.set_version_flag("-V,--version", kBuildInfo, "print version, build and libraries");
    use_help_format(app);
    app.set_help_flag("-h,--help", "print this page");
    app.set_help_all_flag("--help-all", "print all flags");
    app.add_option_function<int>(
           "--threads",
           [](int count) {
               set_thread_count(count);
               setenv("OMP_NUM_THREADS", std::to_string(count).c_str(), 1);  // for child programs
           },
           "CPU threads [OMP_NUM_THREADS, else all available CPUs]")
        ->check(CLI::Range(1, 1024));
    for (CLI::Option* option : app.get_options()) {
        if (option->get_multi_option_policy() == CLI::MultiOptionPolicy::Throw &&
            option->get_expected_max() == 1)
            option->multi_option_policy(CLI::MultiOptionPolicy::TakeLast);
        const bool says_default = option->get_description().find('[') != std::string::npos;
        if (option->get_expected_max() == 1 && !says_default && option->get_default_str().empty())
            option->capture_default_str();
        if (option->get_default_str() == "[]") option->default_str("");
        if (option->get_type_name() == "TEXT") option->type_name(type_of(*option));
    }
    for (CLI::App* sub : app.get_subcommands(std::function<bool(CLI::App*)>())) settle_flags(*sub);
}

/// Completion words of the command, or of the subcommand in `argv`.
std::string words_for_shell(CLI::App& app, int argc, char* const* argv) {
    for (int i = 1; i < argc; ++i)
        for (const CLI::App* sub : subcommands_of(app))
            if (sub->get_name() == argv[i]) return completion_words(*sub);
    return completion_words(app);
}

/// The first word that is neither an option nor a positional argument.
std::string first_extra(const CLI::App& app) {
    const std::vector<std::string> extras = app.remaining(true);
    return extras.empty() ? "DIR" : extras.front();
}

/// The positional arguments of a command; empty: none.
std::string missing_places(const CLI::App& app) {
    std::string places;
    for (const CLI::Option* option : app.get_options())
        if (option->get_positional()) places += " " + option->get_name(true);
    for (char& c : places) c = static_cast<char>(std::toupper(static_cast<unsigned char>(c)));
    return places.empty() ? "" : str("; expected ", app.get_name(), places);
}

/// "whole number" or "number": the type of the flag `name` of the subcommand in use.
std::string number_of(CLI::App& app, const std::string& name) {
    if (const auto chosen = app.get_subcommands(); !chosen.empty())
        return number_of(*chosen.front(), name);
    const CLI::Option* const option = app.get_option_no_throw(name);
    return option && option->get_type_name().find("INT") != std::string::npos ? "a whole number"
                                                                              : "a number";
}

/// The message of the library's error, reworded: flag, what was expected, what was found.
std::string fault_of(CLI::App& app, const CLI::ParseError& error) {
    const std::string text = error.what();
    std::smatch m;
    if (std::regex_match(text, m, std::regex("Could not convert: (\\S+) = (.*)")))
        return str(m[1], ": expected ", number_of(app, m[1]), ", found '", m[2], "'");
    if (std::regex_match(text, m, std::regex("(.*): Value (.*) not in range (.*)")))
        return str(m[1], ": expected ", m[3], ", found ", m[2]);
    if (std::regex_match(text, m, std::regex("(.*): (.*) not in \\{(.*)\\}")))
        return str(m[1], ": expected one of ", m[3], ", found '", m[2], "'");
    if (std::regex_match(text, m, std::regex("(\\S+) excludes (\\S+)")))
        return str(m[1], " and ", m[2], " exclude each other; give one");
    if (std::regex_match(text, m,
                         std::regex("The following arguments? w[a-z]+ not expected: (.*)")))
        return str("unexpected: ", m[1]);
    return text;
}

template <class Test>
CLI::Validator number_that(const Test& good, const std::string& expected, const std::string& help) {
    return CLI::Validator(
        [=](std::string& text) {
            double value = 0;
            return CLI::detail::lexical_cast(text, value) && good(value)
                       ? std::string()
                       : str("expected ", expected, ", found '", text, "'");
        },
        help);
}

/// Prints `text` and ends the command.
[[noreturn]] void answer(const std::string& text) {
    std::fputs(text.c_str(), stdout);
    flush_standard_output();
    throw AskedAndAnswered{};
}

}  // namespace

const CLI::Validator kPositive = number_that(
    [](double value) { return value > 0 && std::isfinite(value); }, "a number above 0", "> 0");

CLI::Validator in_range(double low, double high) {
    return number_that([=](double value) { return value >= low && value <= high; },
                       str("a number from ", low, " to ", high),
                       CLI::Range(low, high).get_description());
}

void parse_command_line(CLI::App& app, int argc, char* const* argv) {
    settle_flags(app);
    if (argc > 1 && argv[argc - 1] == std::string_view(kManFlag)) answer(man_page(app));
    if (argc > 1 && argv[argc - 1] == std::string_view(kWordsFlag))
        answer(words_for_shell(app, argc, argv));
    std::vector<std::string> words;
    for (int i = argc - 1; i > 0; --i) {  // CLI11 takes them last to first
        std::string word = argv[i];
        if (word.starts_with("--")) {
            const std::size_t end = std::min(word.find('='), word.size());
            std::replace(word.begin() + 2, word.begin() + std::ptrdiff_t(end), '_', '-');
        }
        words.push_back(word);
    }
    std::vector<std::string> known;
    const std::function<void(const CLI::App&)> collect = [&](const CLI::App& a) {
        for (const CLI::Option* option : a.get_options())
            for (const std::string& name : option->get_lnames()) known.push_back("--" + name);
        for (const CLI::App* sub : subcommands_of(a)) collect(*sub);
    };
    collect(app);
    try {
        app.parse(std::vector<std::string>(words));  // parse() modifies the words
    } catch (const CLI::CallForHelp&) {
        answer(help_page(app));
    } catch (const CLI::CallForAllHelp&) {
        answer(app.help("", app.get_subcommands().empty() && !subcommands_of(app).empty()
                                ? CLI::AppFormatMode::All
                                : CLI::AppFormatMode::Normal));
    } catch (const CLI::Success& version) {
        answer(str(version.what(), "\n"));
    } catch (const CLI::ParseError& error) {
        std::string hint;
        for (auto word = words.rbegin(); word != words.rend() && hint.empty(); ++word) {
            const std::string flag = word->substr(0, word->find('='));
            if (!flag.starts_with("--") || std::ranges::find(known, flag) != known.end()) continue;
            const std::string near = nearest_name(flag, known);
            hint = near.empty() ? str("; unknown flag ", flag)
                                : str("; unknown flag ", flag, ", did you mean ", near, "?");
        }
        // A folder without its flag, where no positional argument takes it.
        const auto is = [&](CLI::ExitCodes code) {
            return hint.empty() && error.get_exit_code() == int(code);
        };
        if (is(CLI::ExitCodes::ExtrasError) && std::ranges::find(known, "--scene") != known.end())
            hint = str("; did you mean --scene ", first_extra(app), "?");
        if (is(CLI::ExitCodes::RequiredError)) hint = missing_places(app);
        if (hint.empty() && app.get_subcommands().empty())
            for (const CLI::App* sub : subcommands_of(app))
                hint += (hint.empty() ? ": " : ", ") + sub->get_name();
        throw usage_error("command line: ", fault_of(app, error), hint, "; see --help");
    }
}

CLI::Option* add_output_flag(CLI::App& app,
                             const std::string& names,
                             std::string& file,
                             const std::string& description) {
    return app.add_option(names, file, description)->each([](const std::string& name) {
        require_replaceable(name);
        require_not_results_file(name);
    });
}

CLI::Option* add_choice(CLI::App& app,
                        const std::string& names,
                        std::string& value,
                        const std::vector<std::string>& choices,
                        const std::string& description) {
    return app.add_option(names, value, description)->check(CLI::IsMember(choices));
}

void start_group(CLI::App& app, const std::string& heading) {
    app.option_defaults()->group(heading);
}

CLI::Option* add_repeated(CLI::App& app,
                          const std::string& names,
                          std::vector<std::string>& values,
                          const std::string& description) {
    return app.add_option(names, values, description)->expected(1)->take_all();
}

void add_log_flags(CLI::App& app, Verbosity most) {
    init_log(Verbosity::normal);
    CLI::Option* const quiet = app.add_flag_callback(
        "--quiet", [] { init_log(Verbosity::quiet); }, "warnings and errors only");
    if (most == Verbosity::verbose)
        app.add_flag_callback(
               "-v,--verbose", [] { init_log(Verbosity::verbose); }, "more detail")
            ->excludes(quiet);
}

bool is_quiet() {
    return progress_style() == ProgressStyle::quiet;
}

void choose_progress_style(const std::string& name) {
    if (!is_quiet() && name != "auto")
        set_progress_style(name == "json" ? ProgressStyle::json : ProgressStyle::plain);
}

int run_subcommand(CLI::App& app,
                   const std::vector<Subcommand>& subcommands,
                   Verbosity most,
                   int argc,
                   char* const* argv) {
    app.require_subcommand(1);
    for (const Subcommand& sub : subcommands) add_log_flags(*sub.app, most);
    parse_command_line(app, argc, argv);
    for (const Subcommand& sub : subcommands)
        if (sub.app->parsed()) return sub.run();
    return 0;
}

std::string for_shell(const std::string& word) {
    if (!word.empty() && word.find_first_not_of(kPlainLetters) == word.npos) return word;
    std::string quoted = "'";
    for (const char c : word) quoted += c == '\'' ? std::string("'\\''") : std::string(1, c);
    return quoted + '\'';
}

std::string shell_line(const std::vector<std::string>& words) {
    std::string line;
    for (const std::string& word : words) line += (line.empty() ? "" : " ") + for_shell(word);
    return line;
}

void say_next(const std::vector<std::string>& words, const std::string& what) {
    spdlog::info("Next, {}:\n    {}", what, shell_line(words));
}

int run_command(const std::function<int()>& command) {
    guard_standard_streams();
    end_on_signals();
    const auto fail = [](ExitCode code, const std::string& text) {
        std::fprintf(stderr, "error: %s\n", text.c_str());
        return int(code);
    };
    try {
        const int code = command();
        flush_standard_output();
        return code;
    } catch (const AskedAndAnswered&) {
        return 0;
    } catch (const Stopped& stopped) {
        std::fprintf(stderr, "stopped by signal %d (%s)\n", stopped.signal,
                     strsignal(stopped.signal));
        return 128 + stopped.signal;
    } catch (const Error& error) {
        return fail(error.code(), error.what());
    } catch (const std::filesystem::filesystem_error& error) {
        // For example a link to itself, a folder without permission, a name that is too long.
        return fail(ExitCode::io, str(error.path1().string(), ": ", error.code().message()));
    } catch (const std::bad_alloc&) {
        // std::bad_alloc does not give the size.
        return fail(
            ExitCode::memory,
            out_of_memory(str("host memory: ", grouped(memory_use(Cpu{}).current_bytes >> 20),
                              " MiB of buffers in use, ", grouped(free_bytes(Cpu{}) >> 20),
                              " MiB free on this machine"))
                .what());
    } catch (const std::exception& error) {
        return fail(ExitCode::internal, str("internal: ", error.what(), "; please report it"));
    }
}

}  // namespace tvsgs
