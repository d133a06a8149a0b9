#include "io/files/npz.h"
#include "io/io_test.h"
#include "support/test_data.h"

namespace tvsgs {
namespace {

namespace fs = std::filesystem;

/// A hand-made MATLAB file: header, then one element.
class MatFileTest : public IoTest {
protected:
    static std::string u32(std::uint32_t v) {
        return {static_cast<char>(v), static_cast<char>(v >> 8), static_cast<char>(v >> 16),
                static_cast<char>(v >> 24)};
    }
    static std::string element(std::uint32_t type, std::string data) {
        const auto size = static_cast<std::uint32_t>(data.size());
        data.resize((data.size() + 7) / 8 * 8, '\0');
        return u32(type) + u32(size) + data;
    }
    /// Variable "x": array class, shape, and the real part as stored.
    static std::string file(std::uint32_t array_class,
                            const std::string& shape,
                            std::uint32_t type,
                            const std::string& data,
                            std::uint32_t flags = 0) {
        std::string head = "MATLAB 5.0 MAT-file";
        head.resize(124, ' ');
        head += std::string("\x00\x01IM", 4);
        return head + element(14, element(6, u32(array_class | flags) + u32(0)) +
                                      element(5, shape) + element(1, "x") + element(type, data));
    }
};

TEST_F(MatFileTest, ReadsNarrowStorage) {
    // Class double, stored as bytes, as MATLAB does for small integers; also logical.
    const std::string shape = u32(2) + u32(3);
    for (const std::uint32_t flags : {0u, 0x200u}) {
        const MatArray x = read_mat_array(
            write("a.mat", file(flags ? 9 : 6, shape, 2, "\x01\x02\x03\x04\x05\x06", flags)), "x");
        EXPECT_EQ(x.shape, (std::vector<std::int64_t>{2, 3}));
        EXPECT_EQ(x.numbers, (std::vector<double>{1, 2, 3, 4, 5, 6}));
    }
}

TEST_F(MatFileTest, BadFiles) {
    const std::string shape = u32(2) + u32(3),
                      whole = file(6, shape, 2, "\x01\x02\x03\x04\x05\x06");
    const auto expect = [&](const std::string& bytes, const std::string& text) {
        const std::string path = write("a.mat", bytes);
        expect_error(ExitCode::input, text, [&] { read_mat_array(path, "x"); });
    };
    for (std::size_t size = 0; size < whole.size(); size += 3)
        if (size != 128) expect(whole.substr(0, size), "E_MAT");
    expect(whole.substr(0, 128), "E_MAT");
    expect(file(4, shape, 4, std::string(12, 'a')), "not a numeric array");  // text
    expect(file(6, u32(1u << 16) + u32(1u << 16), 2, "\x01"), "2^28");
    expect_error(ExitCode::input, "no variable 'y'",
                 [&] { read_mat_array(write("a.mat", whole), "y"); });
    expect_error(ExitCode::input, "nothing.mat",
                 [&] { read_mat_array((folder / "nothing.mat").string(), "x"); });
    std::string hdf = "MATLAB 7.3 MAT-file";
    hdf.resize(600, ' ');
    expect(hdf, "E_MAT_V73");
}

TEST_F(MatFileTest, TheOraclesFiles) {
    const fs::path example = test_data("geometry");
    const MatArray mask = read_mat_array((example / "dtu_obsmask.mat").string(), "ObsMask");
    EXPECT_EQ(mask.shape, (std::vector<std::int64_t>{24, 24, 24}));
    EXPECT_EQ(mask.numbers[20 + 24 * (20 + 24 * 20)], 1);
    EXPECT_EQ(mask.numbers[0], 0);
    EXPECT_EQ(read_mat_array((example / "dtu_plane.mat").string(), "P").numbers,
              (std::vector<double>{0, 0, 1, 4.9}));
}

}  // namespace
}  // namespace tvsgs
