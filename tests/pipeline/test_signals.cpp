// Signals that ask a command to end.
#include <gtest/gtest.h>
#include <unistd.h>

#include <csignal>

#include "pipeline/run/signals.h"

namespace tvsgs {
namespace {

// As sent by `timeout`: to the command, then to its process group.
TEST(SignalGuards, ASignalThatIsSentTwiceAtOnceIsOne) {
    const SignalGuard guard;
    EXPECT_EQ(SignalGuard::received(), 0);
    std::raise(SIGTERM);
    std::raise(SIGTERM);
    EXPECT_EQ(SignalGuard::received(), SIGTERM);
    EXPECT_THROW(SignalGuard::check(), Stopped);
}

TEST(SignalGuardsDeathTest, ALaterOneEndsTheCommand) {
    EXPECT_EXIT(
        {
            const SignalGuard guard;
            std::raise(SIGTERM);
            usleep(200000);
            std::raise(SIGINT);
        },
        testing::KilledBySignal(SIGINT), "");
}

}  // namespace
}  // namespace tvsgs
