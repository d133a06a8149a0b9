// tvsgs-view as a server: access control, and the state of a training.
#include <gtest/gtest.h>
#include <httplib.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <thread>

#include "io/files/json_value.h"
#include "io/splats/ply.h"
#include "io/splats/splat_files.h"
#include "pipeline/run/run_folder.h"
#include "support/browser.h"
#include "support/command.h"
#include "support/random_gaussians.h"

namespace tvsgs {
namespace {

namespace fs = std::filesystem;
using namespace std::chrono_literals;

/// A synthetic run that has just begun, and its server.
class ViewServer : public testing::Test {
protected:
    void SetUp() override {
        folder_ = fs::path(testing::TempDir()) / ("tvsgs_serve_" + std::to_string(::getpid()));
        fs::remove_all(folder_);
        fs::create_directories(folder_ / "run/live");
        std::ofstream(folder_ / "run/config.json")
            << R"({"backbone": "ewa", "scene": {"path": "nowhere"}})";
        std::ofstream(folder_ / "run/cameras.json")
            << R"([{"img_name": "a.png", "width": 64, "height": 48, "position": [0, 0, -4],
                "rotation": [[1, 0, 0], [0, 1, 0], [0, 0, 1]], "fx": 70, "fy": 70}])";
        std::ofstream(folder_ / "secret.txt") << "secret";
        start();
    }
    void TearDown() override {
        kill(server_, SIGKILL);
        waitpid(server_, nullptr, 0);
        fs::remove_all(folder_);
    }

    void start() {
        const std::string out = folder_ / "url.txt", err = folder_ / "err.txt",
                          run = folder_ / "run";
        server_ = fork();
        if (server_ == 0) {
            if (!freopen(out.c_str(), "w", stdout) || !freopen(err.c_str(), "w", stderr)) _exit(9);
            execl(TVSGS_BIN_DIR "/tvsgs-view", "tvsgs-view", run.c_str(), nullptr);
            _exit(9);
        }
        for (int i = 0; i < 600 && url_.find('\n') == std::string::npos; ++i) {
            std::this_thread::sleep_for(50ms);
            url_ = contents(out);
        }
        ASSERT_EQ(url_.find("http://127.0.0.1:"), 0u) << url_ << contents(err);
        url_.pop_back();
        port_ = std::stoi(url_.substr(17));
        token_ = url_.substr(url_.find("token=") + 6);
    }

    httplib::Client client() const { return httplib::Client("127.0.0.1", port_); }
    httplib::Headers let_in() const {
        return {{"Cookie", "x=1; tvsgs_" + std::to_string(port_) + "=" + token_ + "; y=2"}};
    }
    int status(const char* path, const httplib::Headers& headers) const {
        httplib::Client c = client();
        const auto result = c.Get(path, headers);
        return result ? result->status : -1;
    }
    void write_snapshot(int iteration) {
        write_splat_file(folder_ / "run/live/splats.spz", test::random_gaussians(200, 3, 0.05, 0),
                         {.frame = SplatFrame::rdf});
        std::ofstream(folder_ / "run/live/state.json")
            << R"({"iteration": )" << iteration
            << R"(, "iterations": 4000, "seconds": 7, "gaussians": 200, "origin": [0, 0, 0]})";
    }

    fs::path folder_;
    pid_t server_ = -1;
    std::string url_, token_;
    int port_ = 0;
};

TEST_F(ViewServer, LetsInWhoHasTheTokenAndAsksForThisMachine) {
    EXPECT_GE(token_.size(), 32u);
    EXPECT_EQ(status("/", {}), 403);
    EXPECT_EQ(status("/api/state", {}), 403);
    EXPECT_EQ(status("/?token=0123456789abcdef0123456789abcdef", {}), 403);
    EXPECT_EQ(status(("/api/state?token=" + token_).c_str(), {}), 403) << "a cookie it has to be";
    const std::string half = token_.substr(0, 16), port = std::to_string(port_);
    EXPECT_EQ(status("/api/state", {{"Cookie", "tvsgs_" + port + "=" + half}}), 403);
    EXPECT_EQ(status("/api/state", {{"Cookie", "tvsgs_" + port + "="}}), 403);

    httplib::Client c = client();
    const auto first = c.Get(("/?token=" + token_).c_str());
    ASSERT_TRUE(first);
    EXPECT_EQ(first->status, 303);
    EXPECT_EQ(first->get_header_value("Location"), "/") << "no token in the address";
    const std::string set = first->get_header_value("Set-Cookie");
    EXPECT_EQ(set, "tvsgs_" + port + "=" + token_ + "; HttpOnly; SameSite=Strict; Path=/");
    EXPECT_EQ(status("/api/state", let_in()), 200);

    // Other host names for this machine, as a foreign page can use them.
    for (const std::string& host : {"evil.example:" + port, std::string("evil.example"),
                                    std::string("127.0.0.1"), "127.0.0.1.evil.example:" + port}) {
        httplib::Headers headers = let_in();
        headers.emplace("Host", host);
        EXPECT_EQ(status("/api/state", headers), 403) << host;
    }
    httplib::Headers local = let_in();
    local.emplace("Host", "localhost:" + port);
    EXPECT_EQ(status("/api/state", local), 200);

    const auto post = c.Post("/api/state", let_in(), "", "text/plain");
    ASSERT_TRUE(post);
    EXPECT_EQ(post->status, 405);
    for (const char* path :
         {"/config.json", "/../secret.txt", "/run/config.json", "/api/../config.json",
          "/%2e%2e/secret.txt", "/api/splats/../../config.json"})
        EXPECT_EQ(status(path, let_in()), 404) << path;
    const auto page = c.Get("/", let_in());
    ASSERT_TRUE(page);
    EXPECT_EQ(page->status, 200);
    EXPECT_EQ(page->get_header_value("X-Content-Type-Options"), "nosniff");
    EXPECT_EQ(page->get_header_value("Cache-Control"), "no-store");
    EXPECT_EQ(page->get_header_value("Access-Control-Allow-Origin"), "");
}

TEST_F(ViewServer, TellsOfATrainingAndOfItsEnd) {
    httplib::Client c = client();
    const auto state = [&] {
        const auto result = c.Get("/api/state", let_in());
        EXPECT_TRUE(result && result->status == 200);
        return parse_json_value(result->body, "state");
    };
    EXPECT_EQ(state()["live"].number, 0);
    EXPECT_EQ(status("/api/splats", let_in()), 503);
    write_snapshot(1234);
    const JsonValue now = state();
    EXPECT_EQ(now["live"].number, 1);
    EXPECT_EQ(now["iteration"].number, 1234);
    const auto splats = c.Get("/api/splats", let_in());
    ASSERT_TRUE(splats && splats->status == 200);
    EXPECT_EQ(splats->body, contents(folder_ / "run/live/splats.spz"));
    std::this_thread::sleep_for(20ms);
    write_snapshot(1300);
    EXPECT_NE(state()["tag"].text, now["tag"].text);
    // When results exist, the page shows them; first those of a stopped training.
    const auto before = c.Get("/", let_in());
    fs::remove_all(folder_ / "run/live");
    EXPECT_EQ(state()["live"].number, 0);
    write_splat_ply(folder_ / "run/point_cloud/iteration_9/point_cloud.ply",
                    test::random_gaussians(77, 3, 0.05, 0));
    const auto stopped = c.Get("/", let_in());
    ASSERT_TRUE(stopped);
    EXPECT_NE(stopped->body.find("77 splats"), std::string::npos);
    EXPECT_EQ(state()["finished"].number, 0);
    write_splat_ply(folder_ / "run/point_cloud/iteration_12/point_cloud.ply",
                    test::random_gaussians(78, 3, 0.05, 0));
    std::ofstream(folder_ / "run/report.json") << "{}";
    EXPECT_EQ(state()["finished"].number, 1);
    const auto after = c.Get("/", let_in());
    ASSERT_TRUE(before && after);
    EXPECT_NE(before->body.find("<p class=\"quiet\">1 camera.</p>"), std::string::npos);
    EXPECT_NE(after->body.find("78 splats"), std::string::npos);
}

/// As typed into two terminals, the second one at once.
TEST_F(ViewServer, WaitsForATrainingThatReadsItsScene) {
    const fs::path run = folder_ / "begun";
    fs::create_directories(run);
    std::optional<FolderLock> lock(run);
    std::thread trainer([&] {
        std::this_thread::sleep_for(500ms);
        for (const char* name : {"config.json", "cameras.json"})
            fs::copy_file(folder_ / "run" / name, run / name);
    });
    const Result served = run_script(
        folder_, "timeout -s INT 3 " TVSGS_BIN_DIR "/tvsgs-view begun >out.txt 2>err.txt");
    trainer.join();
    EXPECT_TRUE(served.says("the training reads its scene")) << served;
    EXPECT_EQ(served.out.find("http://127.0.0.1:"), 0u) << served;
    lock.reset();
    fs::remove(run / "cameras.json"), fs::remove(run / "config.json");
    const Result none =
        run_script(folder_, "timeout 20 " TVSGS_BIN_DIR "/tvsgs-view begun >out.txt 2>err.txt");
    EXPECT_EQ(none.code, 3) << "nobody trains there";
}

TEST_F(ViewServer, APortHasOneServer) {
    const Result second =
        run_script(folder_, "timeout 20 " TVSGS_BIN_DIR "/tvsgs-view run --port " +
                                std::to_string(port_) + " >out.txt 2>err.txt");
    EXPECT_EQ(second.code, 2) << second;
    EXPECT_TRUE(second.says("is in use")) << second;
    EXPECT_EQ(second.out, "");
}

TEST_F(ViewServer, ABrowserFollowsIt) {
    if (chromium().empty()) GTEST_SKIP() << "no chromium here";
    write_snapshot(1234);
    const std::string html = document_in_browser(
        folder_, url_ + "&wait=1", "--virtual-time-budget=10000");  // it asks once a second
    EXPECT_NE(text_of(html, "training").find("iteration 1,234 of 4,000, 200 splats"),
              std::string::npos)
        << text_of(html, "training") << text_of(html, "status");
}

}  // namespace
}  // namespace tvsgs
