#include "apps/view/server.h"

#include <httplib.h>

#include <chrono>
#include <cstdio>
#include <filesystem>
#include <mutex>
#include <random>
#include <thread>

#include "core/log.h"
#include "io/files/read_file.h"
#include "pipeline/run/run_folder.h"

namespace tvsgs {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kMaxRequestBytes = 1024;  // of a body; no request needs one
constexpr int kSeconds = 5;                     // timeout of reads and writes
constexpr std::size_t kThreads = 32;

/// 128 random bits of the system.
std::string make_token() {
    std::random_device random;
    std::string token;
    for (int i = 0; i < 4; ++i) token += fmt::format("{:08x}", static_cast<unsigned>(random()));
    return token;
}

/// Compares in constant time.
bool same(const std::string& a, const std::string& b) {
    if (a.size() != b.size()) return false;
    unsigned difference = 0;
    for (std::size_t i = 0; i < a.size(); ++i)
        difference |= static_cast<unsigned char>(a[i]) ^ static_cast<unsigned char>(b[i]);
    return difference == 0;
}

/// The value of a cookie in a header "a=1; b=2"; empty: not found.
std::string cookie(const std::string& header, const std::string& name) {
    const std::string all = "; " + header, start = "; " + name + "=";
    const std::size_t at = all.find(start);
    if (at == std::string::npos) return "";
    const std::size_t from = at + start.size();
    return all.substr(from, all.find(';', from) - from);
}

class Server {
public:
    Server(const ViewInput& input, const ViewPageOptions& options)
        : input_(input), options_(options), run_(input.runs.front()) {
        input_.may_train = options_.follow = true;
    }

    void listen(int port) {
        // Connections that send nothing each hold a thread until the timeout.
        server_.new_task_queue = [] { return new httplib::ThreadPool(kThreads); };
        server_.set_payload_max_length(kMaxRequestBytes);
        server_.set_read_timeout(kSeconds);
        server_.set_write_timeout(kSeconds);
        server_.set_keep_alive_max_count(16);
        server_.set_default_headers({{"Content-Security-Policy", "frame-ancestors 'none'"},
                                     {"X-Content-Type-Options", "nosniff"},
                                     {"Referrer-Policy", "no-referrer"},
                                     {"Cache-Control", "no-store"}});
        server_.set_pre_routing_handler([this](const auto& request, auto& response) {
            return admit(request, response) ? httplib::Server::HandlerResponse::Unhandled
                                            : httplib::Server::HandlerResponse::Handled;
        });
        serve("/", "text/html; charset=utf-8", [this] { return page(); });
        serve("/api/state", "application/json", [this] { return state(); });
        serve("/api/splats", "application/octet-stream",
              [this] { return read_bytes(live("splats.spz")); });
        // Not SO_REUSEPORT, which httplib sets: two servers would share a port and each get some of
        // the requests.
        server_.set_socket_options([](socket_t socket) {
            const int yes = 1;
            setsockopt(socket, SOL_SOCKET, SO_REUSEADDR, &yes, sizeof yes);
        });
        const char* const host = "127.0.0.1";  // only this machine
        port_ = port > 0 ? (server_.bind_to_port(host, port) ? port : -1)
                         : server_.bind_to_any_port(host);
        if (port_ < 0)
            throw Error(ExitCode::usage,
                        str("Port ", port, " is in use or not permitted; choose another"));
        std::printf("http://127.0.0.1:%d/?token=%s\n", port_, token_.c_str());
        std::fflush(stdout);
        spdlog::info("Open this address in a browser of this machine; Ctrl-C ends the server");
        if (!server_.listen_after_bind())
            throw Error(ExitCode::io, "the server failed; start it again");
    }

private:
    std::string live(const char* name) const { return str(run_, "/live/", name); }

    /// Rejects requests with another host name (a foreign page can point its name at this machine)
    /// and requests without the token, which only the user's terminal shows. The first request
    /// stores the token in a cookie, so that it does not stay in the address; other parameters do.
    bool admit(const httplib::Request& request, httplib::Response& response) {
        const std::string host = request.get_header_value("Host"), port = std::to_string(port_),
                          name = "tvsgs_" + port;
        if (host != "127.0.0.1:" + port && host != "localhost:" + port) {
            response.status = 403;
        } else if (request.method != "GET") {
            response.status = 405;
            response.set_header("Allow", "GET");
        } else if (request.path == "/" && same(request.get_param_value("token"), token_)) {
            response.set_header("Set-Cookie",
                                str(name, "=", token_, "; HttpOnly; SameSite=Strict; Path=/"));
            httplib::Params rest = request.params;
            rest.erase("token");
            response.set_redirect(rest.empty() ? "/" : httplib::append_query_params("/", rest),
                                  303);
        } else if (!same(cookie(request.get_header_value("Cookie"), name), token_)) {
            response.status = 403;
            response.set_content("Open the address that tvsgs-view printed.\n", "text/plain");
        } else {
            return true;
        }
        return false;
    }

    /// Answers requests for `path` by make(). Reports errors here, not to the browser.
    template <class Make>
    void serve(const char* path, const char* type, const Make& make) {
        server_.Get(path, [type, make](const auto&, auto& response) {
            try {
                response.set_content(make(), type);
            } catch (const std::exception& error) {
                spdlog::warn("{}", error.what());
                response.status = 503;
                response.set_content("Failed: see the messages of tvsgs-view.\n", "text/plain");
            }
        });
    }

    /// Changes when the run's results change.
    std::string version_of_run() const {
        std::string text;
        std::error_code code;
        std::vector<std::string> files = {run_ + "/report.json", run_ + "/config.json",
                                          find_mesh(run_)};
        try {
            files.push_back(find_splats(run_));
        } catch (const Error&) {
            // No splats yet.
        }
        for (const std::string& file : files)
            if (const auto time = fs::last_write_time(file, code); !code)
                text += file + " " + std::to_string(time.time_since_epoch().count()) + " ";
        return text;
    }

    std::string page() {
        const std::lock_guard lock(mutex_);  // two pages at once would need twice the memory
        const std::string version = version_of_run();
        if (version != version_ || page_.empty()) {
            ViewPage made = view_page(read_view_subject(input_), options_);
            for (const std::string& note : made.notes) spdlog::warn("{}", note);
            page_ = std::move(made.html), version_ = version;
        }
        return page_;
    }

    std::string state() const {
        std::error_code code;
        const auto time = fs::last_write_time(live("splats.spz"), code);
        if (code || !fs::is_regular_file(live("state.json"), code))
            return str("{\"live\": false, \"finished\": ",
                       fs::exists(run_ + "/report.json", code) ? "true" : "false", "}\n");
        const std::chrono::duration<double> age = fs::file_time_type::clock::now() - time;
        JsonValue json = parse_json_value(read_text(live("state.json"), 4096), live("state.json"));
        json.set("live", 1.0);
        json.set("age", age.count());
        json.set("tag", std::to_string(time.time_since_epoch().count()));
        return json_text(json) + "\n";
    }

    ViewInput input_;
    ViewPageOptions options_;
    const std::string run_;
    const std::string token_ = make_token();
    int port_ = 0;
    std::mutex mutex_;
    std::string page_, version_;
    httplib::Server server_;
};

/// Waits while a training prepares its run folder.
void wait_for_start(const std::string& run) {
    std::error_code code;
    const auto prepares = [&] {
        return !fs::exists(run + "/cameras.json", code) && FolderLock(run).held();
    };
    if (!prepares()) return;
    spdlog::info("{}: the training reads its scene; the address follows", run);
    // The lock changes hands when the folder is written.
    for (int free = 0; free < 3; free = prepares() ? 0 : free + 1)
        std::this_thread::sleep_for(std::chrono::milliseconds(200));
}

}  // namespace

void serve(const ViewInput& input, const ViewPageOptions& options, int port) {
    const std::string& run = input.runs.front();
    wait_for_start(run);
    run_config_path(run);  // reports a missing run before there is an address
    Server(input, options).listen(port);
}

}  // namespace tvsgs
