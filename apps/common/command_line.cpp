#include "apps/common/command_line.h"

#include <fcntl.h>

#include <algorithm>
#include <cerrno>
#include <csignal>
#include <cstdio>
#include <cstring>
#include <exception>
#include <iostream>
#include <new>
#include <vector>

#include "core/buffer.h"
#include "core/nearest_name.h"
#include "io/atomic_file.h"
#include "io/manifest.h"
#include "mesh/device_algorithms.h"
#include "pipeline/signals.h"

namespace tvsgs {
namespace {

/// Thrown after --help or --version has been printed.
struct AskedAndAnswered {};

/// What was asked for has to arrive, unless the reader had enough of it.
void flush_standard_output() {
    errno = 0;
    if ((std::fflush(stdout) != 0 || std::ferror(stdout) != 0) && errno != EPIPE)
        throw Error(ExitCode::io, str("standard output: writing failed",
                                      errno != 0 ? str(": ", std::strerror(errno)) : ""));
}

/// A reader that leaves (`| head`) must not kill a training, and a standard stream that was closed
/// must not lend its number to a file of the run, into which messages would then go.
void guard_standard_streams() {
    std::signal(SIGPIPE, SIG_IGN);
    std::signal(SIGXFSZ, SIG_IGN);  // a file that must not grow is an error with a message
    for (int stream = 0; stream < 3; ++stream)
        if (fcntl(stream, F_GETFD) == -1)
            open("/dev/null", O_RDWR);  // takes the lowest free number
}

void let_last_win(CLI::App& app) {
    const auto all = [](auto*) { return true; };
    for (CLI::Option* option : app.get_options())
        if (option->get_multi_option_policy() == CLI::MultiOptionPolicy::Throw &&
            option->get_expected_max() == 1)
            option->multi_option_policy(CLI::MultiOptionPolicy::TakeLast);
    for (CLI::App* sub : app.get_subcommands(std::function<bool(CLI::App*)>(all)))
        let_last_win(*sub);
}

}  // namespace

const CLI::Validator kPositive(
    [](std::string& text) {
        double value = 0;
        const bool good = CLI::detail::lexical_cast(text, value) && value > 0;
        return good ? std::string() : str("expected a number above 0, found '", text, "'");
    },
    "> 0");

void parse_command_line(CLI::App& app, int argc, char** argv) {
    let_last_win(app);
    std::vector<std::string> words;
    for (int i = argc - 1; i > 0; --i) {  // CLI11 takes them last to first
        std::string word = argv[i];
        if (word.starts_with("--")) {
            const std::size_t end = std::min(word.find('='), word.size());
            std::replace(word.begin() + 2, word.begin() + static_cast<std::ptrdiff_t>(end), '_',
                         '-');
        }
        words.push_back(word);
    }
    std::vector<std::string> known;
    const std::function<void(const CLI::App&)> collect = [&](const CLI::App& a) {
        for (const CLI::Option* option : a.get_options())
            for (const std::string& name : option->get_lnames()) known.push_back("--" + name);
        for (const CLI::App* sub : a.get_subcommands([](const CLI::App*) { return true; }))
            collect(*sub);
    };
    collect(app);
    try {
        app.parse(std::vector<std::string>(words));  // it would eat the words
    } catch (const CLI::Success& success) {          // --help, --version
        app.exit(success);
        std::cout.flush();
        flush_standard_output();
        throw AskedAndAnswered{};
    } catch (const CLI::ParseError& error) {
        std::string hint;
        const auto subs = app.get_subcommands([](const CLI::App*) { return true; });
        for (const CLI::App* sub : subs)
            if (app.get_subcommands().empty())
                hint += (hint.empty() ? ": " : ", ") + sub->get_name();
        for (auto word = words.rbegin(); word != words.rend() && hint.empty(); ++word) {
            const std::string flag = word->substr(0, word->find('='));
            if (!flag.starts_with("--") ||
                std::find(known.begin(), known.end(), flag) != known.end())
                continue;
            const std::string near = nearest_name(flag, known);
            hint = near.empty() ? str("; unknown flag ", flag)
                                : str("; unknown flag ", flag, ", did you mean ", near, "?");
        }
        throw Error(ExitCode::usage, str("command line: ", error.what(), hint, "; see --help"));
    }
}

CLI::Option* add_output_flag(CLI::App& app,
                             const std::string& names,
                             std::string& file,
                             const std::string& description) {
    return app.add_option(names, file, description)->each([](const std::string& name) {
        require_replaceable(name);
    });
}

int run_command(const std::function<int()>& command) {
    guard_standard_streams();
    end_on_signals();
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
        std::fprintf(stderr, "error: %s\n", error.what());
        return static_cast<int>(error.code());
    } catch (const std::filesystem::filesystem_error& error) {
        // A link to itself, a folder that may not be entered, a name that is too long.
        std::fprintf(stderr, "error: %s: %s\n", error.path1().c_str(),
                     error.code().message().c_str());
        return static_cast<int>(ExitCode::io);
    } catch (const std::bad_alloc&) {
        // The library does not say how much it was asked for.
        const Error explained = out_of_memory(
            str("the host gave no more beside the ", memory_use(Cpu{}).current_bytes >> 20,
                " MiB of buffers; ", free_bytes(Cpu{}) >> 20, " MiB are free on the machine"));
        std::fprintf(stderr, "error: %s\n", explained.what());
        return static_cast<int>(ExitCode::memory);
    } catch (const std::exception& error) {
        std::fprintf(stderr, "error: internal: %s\n", error.what());
        return static_cast<int>(ExitCode::internal);
    }
}

}  // namespace tvsgs
