#include "core/log.h"

#include <spdlog/sinks/stdout_color_sinks.h>

#include "core/progress.h"

namespace tvsgs {
namespace {

/// Begins each message on a new line.
class MessageSink final
    : public spdlog::sinks::ansicolor_stderr_sink<spdlog::details::console_mutex> {
    void log(const spdlog::details::log_msg& message) override {
        if (should_log(message.level)) end_progress_line();
        ansicolor_stderr_sink::log(message);
    }
};

}  // namespace

void init_log(Verbosity verbosity) {
    auto logger = std::make_shared<spdlog::logger>("tvsgs", std::make_shared<MessageSink>());
    logger->set_pattern("%^%l%$: %v");
    logger->set_level(verbosity == Verbosity::quiet    ? spdlog::level::warn
                      : verbosity == Verbosity::normal ? spdlog::level::info
                                                       : spdlog::level::debug);
    spdlog::set_default_logger(std::move(logger));
    set_progress_style(verbosity == Verbosity::quiet ? ProgressStyle::quiet
                                                     : ProgressStyle::automatic);
}

}  // namespace tvsgs
