#include "core/log.h"

#include <spdlog/pattern_formatter.h>
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

/// "warning: " before warnings, nothing before information.
class LevelPrefix final : public spdlog::custom_flag_formatter {
    void format(const spdlog::details::log_msg& message,
                const std::tm& /*time*/,
                spdlog::memory_buf_t& out) override {
        if (message.level < spdlog::level::warn) return;
        const spdlog::string_view_t name = spdlog::level::to_string_view(message.level);
        out.append(name.begin(), name.end());
        out.push_back(':'), out.push_back(' ');
    }
    std::unique_ptr<spdlog::custom_flag_formatter> clone() const override {
        return std::make_unique<LevelPrefix>();
    }
};

}  // namespace

void init_log(Verbosity verbosity) {
    auto logger = std::make_shared<spdlog::logger>("tvsgs", std::make_shared<MessageSink>());
    auto formatter = std::make_unique<spdlog::pattern_formatter>();
    formatter->add_flag<LevelPrefix>('L').set_pattern("%^%L%$%v");
    logger->set_formatter(std::move(formatter));
    logger->set_level(verbosity == Verbosity::quiet    ? spdlog::level::warn
                      : verbosity == Verbosity::normal ? spdlog::level::info
                                                       : spdlog::level::debug);
    spdlog::set_default_logger(std::move(logger));
    set_progress_style(verbosity == Verbosity::quiet ? ProgressStyle::quiet
                                                     : ProgressStyle::automatic);
}

}  // namespace tvsgs
