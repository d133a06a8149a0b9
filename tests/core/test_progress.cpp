// Tests the progress lines: their text, and when they stay silent.
#include <fcntl.h>
#include <gtest/gtest.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include <cmath>
#include <cstdio>
#include <cstdlib>

#include "core/log.h"
#include "core/progress.h"

namespace tvsgs {
namespace {

TEST(Paces, SayNothingWithoutABasis) {
    ProgressRate pace;
    EXPECT_TRUE(std::isnan(pace.left(100)));
    pace.add(5, 1);  // a slow first step
    EXPECT_TRUE(std::isnan(pace.left(100)));
    pace.add(6.9, 51);
    EXPECT_TRUE(std::isnan(pace.left(100))) << "1.9 s";
    pace.add(7, 52);
    // 51 steps in 2 s; the first one, which took 5, does not count.
    EXPECT_NEAR(pace.left(100), 48 * 2.0 / 51, 1e-9);
    EXPECT_EQ(pace.left(40), 0) << "never below";
    ProgressRate stuck;
    stuck.add(0, 3), stuck.add(10, 3);
    EXPECT_TRUE(std::isnan(stuck.left(10))) << "nothing was done";
}

TEST(Paces, GoByWhatWasSeenLately) {
    ProgressRate pace;
    for (int i = 0; i <= 20; ++i) pace.add(i, 100 * i);           // 100 a second
    for (int i = 21; i <= 60; ++i) pace.add(i, 2000 + (i - 20));  // then 1
    EXPECT_NEAR(pace.left(2050), 10, 0.5);
    pace.restart();
    EXPECT_TRUE(std::isnan(pace.left(2050)));
}

TEST(ProgressTexts, SayWhatIsKnown) {
    EXPECT_EQ(progress_text("stereo", 65, 0.5, 3725),
              "stereo 1:05 [##########..........] 50 %  about 1:02:05 left");
    EXPECT_EQ(progress_text("", 1, 0, NAN), "0:01 [....................] 0 %");
    EXPECT_EQ(progress_text("x", 0, 2, 0, true),
              "x 0:00 [####################] 100 %  more than 0:00 left");
    EXPECT_EQ(progress_text("x", 0, NAN, NAN), "x 0:00 [####################] 100 %");
}

TEST(ProgressStyles, QuietAndJsonAreSilent) {
    EXPECT_EQ(progress_style(), ProgressStyle::quiet) << "of a program that asks for nothing";
    init_log(Verbosity::normal);
    EXPECT_EQ(progress_style(), ProgressStyle::automatic);
    init_log(Verbosity::quiet);
    EXPECT_EQ(progress_style(), ProgressStyle::quiet);
    testing::internal::CaptureStderr();
    for (const ProgressStyle style :
         {ProgressStyle::quiet, ProgressStyle::json, ProgressStyle::plain}) {
        set_progress_style(style);
        Progress progress("work", 3);
        for (int i = 0; i < 3; ++i) progress.advance();
    }
    EXPECT_EQ(testing::internal::GetCapturedStderr(), "") << "plain: over at once";
    set_progress_style(ProgressStyle::quiet);
}

/// Output of `action` on a terminal of 3 rows and 12 columns.
template <class Action>
std::string on_terminal(const Action& action) {
    const int terminal = posix_openpt(O_RDWR | O_NOCTTY), before = dup(STDERR_FILENO);
    EXPECT_EQ(grantpt(terminal) + unlockpt(terminal), 0);
    const int inside = open(ptsname(terminal), O_RDWR | O_NOCTTY);
    const winsize size{3, 12, 0, 0};
    EXPECT_EQ(ioctl(inside, TIOCSWINSZ, &size), 0);
    dup2(inside, STDERR_FILENO);
    set_progress_style(ProgressStyle::automatic);
    action();
    set_progress_style(ProgressStyle::quiet);
    std::fputs("end", stderr);
    dup2(before, STDERR_FILENO);
    std::string text;
    char byte;
    while (!text.ends_with("end") && read(terminal, &byte, 1) == 1) text += byte;
    for (const int file : {terminal, inside, before}) close(file);
    return text;
}

TEST(ProgressLines, ReplaceEachOtherOnATerminal) {
    EXPECT_EQ(on_terminal([] {
                  show_progress_lines({"one", "two"});
                  show_progress_lines({"1", "a line that is too long", "no row for this one"});
                  end_progress_line();
                  show_progress_lines({"alone"});
                  end_progress_line();
                  end_progress_line();
              }),
              "\rone\033[K\r\ntwo\033[K\033[J"               // the terminal makes \r\n of \n
              "\033[1A\r1\033[K\r\na line that\033[K\033[J"  // replace the lines
              "\033[1A\r\033[J"                              // removes several lines
              "\ralone\033[K\033[J\r\nend");                 // keeps one line
}

}  // namespace
}  // namespace tvsgs
