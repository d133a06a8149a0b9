#include <sys/wait.h>
#include <unistd.h>

#include <cstdio>

#include "core/version.h"
#include "io/files/atomic_file.h"
#include "io/io_test.h"

namespace tvsgs {
namespace {

using AtomicFileTest = IoTest;

const std::string kOld = std::string("by ") + kVersion;

int files_in(const std::filesystem::path& folder) {
    int count = 0;
    for ([[maybe_unused]] const auto& entry : std::filesystem::directory_iterator(folder)) ++count;
    return count;
}

TEST_F(AtomicFileTest, AppearsOnlyWhenCommitted) {
    const std::string path = (folder / "new/folder/file.txt").string();
    {
        AtomicFile file(path);
        file.write("abc");
        EXPECT_FALSE(std::filesystem::exists(path));
        file.commit();
    }
    EXPECT_EQ(read_bytes(path), "abc");
    EXPECT_EQ(files_in(folder / "new/folder"), 1);
}

TEST_F(AtomicFileTest, LeavesTheOldFileWhenNotCommitted) {
    const std::string path = write("file.txt", kOld);
    {
        AtomicFile file(path);
        file.write("half of the new");
    }
    EXPECT_EQ(read_bytes(path), kOld);
    EXPECT_EQ(files_in(folder), 1);
}

TEST_F(AtomicFileTest, OverwritesWhole) {
    const std::string path = write("file.txt", kOld + ", and longer");
    write_text_file(path, "new");
    EXPECT_EQ(read_bytes(path), "new");
}

TEST_F(AtomicFileTest, ReplacesNothingButOurs) {
    for (const std::string text : {"mine", "about tvsgs and its votes", "tvsgs 0"}) {
        const std::string path = write("file.txt", text);
        const bool ours = text == "tvsgs 0";
        if (!ours)
            expect_error(ExitCode::usage, "file.txt: already exists and is not ours",
                         [&] { write_text_file(path, "new"); });
        else
            write_text_file(path, "new");
        EXPECT_EQ(read_bytes(path), ours ? "new" : text);
    }
    write_text_file(write("empty.txt", ""), "new");  // as mktemp creates it
    create_results_folder(folder / "results", {"a.txt", "maps"});
    const std::string listed = (folder / "results/a.txt").string();
    write_text_file(listed, "new");
    write_text_file(listed, "newer");
    EXPECT_EQ(read_bytes(listed), "newer");
    create_results_folder(folder / "results", {"a.txt", "maps"});
    write("results/maps/b.txt", kOld);  // the manifest of such a folder decides
    expect_error(ExitCode::usage, "b.txt: already exists and is not ours", [&] {
        create_results_folder(folder / "results", {"a.txt", "maps"});
    });
}

TEST_F(AtomicFileTest, NamesPathAndReasonWhenItCannotWrite) {
    const std::string file_as_folder = write("file", "");
    expect_error(ExitCode::io, "file/below",
                 [&] { write_text_file(file_as_folder + "/below", "x"); });
    std::filesystem::create_directories(folder / "taken");
    expect_error(ExitCode::io, "taken", [&] { write_text_file((folder / "taken").string(), "x"); });
    expect_error(ExitCode::io, "/proc/no", [] { write_text_file("/proc/no/such/file", "x"); });
}

// A file must not replace the device: as root that would destroy the machine's /dev/null.
TEST_F(AtomicFileTest, WritesToDevicesDirectly) {
    write_text_file("/dev/null", "x");
    EXPECT_TRUE(std::filesystem::is_character_file("/dev/null"));
    if (!std::filesystem::is_character_file("/dev/full")) GTEST_SKIP() << "no /dev/full here";
    expect_error(ExitCode::io, "/dev/full: writing failed: No space left on device",
                 [] { write_text_file("/dev/full", "x"); });
    EXPECT_TRUE(std::filesystem::is_character_file("/dev/full"));
}

TEST_F(AtomicFileTest, AppendsToAFileThatStandardOutputIs) {
    const std::string file = (folder / "out.txt").string();
    ASSERT_FALSE(is_stream(file));
    ASSERT_TRUE(is_stream("/dev/stdout"));
    const pid_t child = fork();
    if (child == 0) {
        if (std::freopen(file.c_str(), "w", stdout) == nullptr) _exit(1);
        std::puts("before");
        std::fflush(stdout);
        write_text_file("/dev/stdout", "text");
        _exit(0);
    }
    int status = -1;
    waitpid(child, &status, 0);
    EXPECT_EQ(status, 0);
    EXPECT_EQ(read_bytes(file), "before\ntext");
}

TEST_F(AtomicFileTest, FollowsLinks) {
    const std::string target = write("target.txt", kOld), link = (folder / "link").string();
    std::filesystem::create_symlink(target, link);
    write_text_file(link, "new");
    EXPECT_TRUE(std::filesystem::is_symlink(link));
    EXPECT_EQ(read_bytes(target), "new");
}

TEST_F(AtomicFileTest, ASignalHandlerCanCleanUp) {
    const std::string path = write("file.txt", kOld);
    AtomicFile file(path);
    file.write("half of the new");
    EXPECT_EQ(files_in(folder), 2);
    remove_temporary_files();
    EXPECT_EQ(files_in(folder), 1);
    EXPECT_EQ(read_bytes(path), kOld);
}

TEST_F(AtomicFileTest, UnwritableFolder) {
    if (geteuid() == 0) GTEST_SKIP() << "root may write everywhere";
    std::filesystem::permissions(
        folder, std::filesystem::perms::owner_read | std::filesystem::perms::owner_exec);
    expect_error(ExitCode::io, "Permission denied",
                 [&] { write_text_file((folder / "file").string(), "x"); });
}

}  // namespace
}  // namespace tvsgs
