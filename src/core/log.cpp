#include "core/log.h"

#include <spdlog/sinks/stdout_color_sinks.h>

namespace tvsgs {

void init_log(Verbosity verbosity) {
    auto logger = std::make_shared<spdlog::logger>(
        "tvsgs", std::make_shared<spdlog::sinks::stderr_color_sink_mt>());
    logger->set_pattern("%^%l%$: %v");
    logger->set_level(verbosity == Verbosity::quiet    ? spdlog::level::warn
                      : verbosity == Verbosity::normal ? spdlog::level::info
                                                       : spdlog::level::debug);
    spdlog::set_default_logger(std::move(logger));
}

}  // namespace tvsgs
