#include <gtest/gtest.h>

#include <cstdint>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <iterator>

#include "core/error.h"
#include "io/files/npz.h"
#include "support/test_data.h"

namespace tvsgs::test {
namespace {

template <class T>
std::string raw(std::initializer_list<T> values) {
    std::string bytes;
    for (const T value : values) {
        char b[sizeof(T)];
        std::memcpy(b, &value, sizeof(T));
        bytes.append(b, sizeof(T));
    }
    return bytes;
}

std::string npy(const std::string& header, const std::string& data, char version = 1) {
    std::string text = header + "\n";
    const auto length = static_cast<std::uint32_t>(text.size());
    std::string bytes = std::string("\x93NUMPY", 6) + version + '\0';
    bytes += version == 1 ? raw({static_cast<std::uint16_t>(length)}) : raw({length});
    return bytes + text + data;
}
std::string header(const std::string& descr,
                   const std::string& shape,
                   const std::string& fortran = "False") {
    return "{'descr': '" + descr + "', 'fortran_order': " + fortran + ", 'shape': " + shape + ", }";
}

using Numbers = std::vector<double>;

TEST(Npy, NumericTypes) {
    EXPECT_EQ(parse_npy(npy(header("<f4", "(2,)"), raw({1.5f, -2.0f})), "a").numbers,
              (Numbers{1.5, -2}));
    EXPECT_EQ(parse_npy(npy(header("<f8", "(1, 2)"), raw({0.1, 3e300}), 2), "a").numbers,
              (Numbers{0.1, 3e300}));
    EXPECT_EQ(parse_npy(npy(header("<i8", "()"), raw<std::int64_t>({-7})), "a").numbers,
              (Numbers{-7}));
    EXPECT_EQ(parse_npy(npy(header("<i4", "(2,)"), raw<std::int32_t>({-1, 5}), 3), "a").numbers,
              (Numbers{-1, 5}));
    EXPECT_EQ(parse_npy(npy(header("|u1", "(2,)"), raw<std::uint8_t>({200, 1})), "a").numbers,
              (Numbers{200, 1}));
    EXPECT_EQ(parse_npy(npy(header("|b1", "(2,)"), raw<std::uint8_t>({0, 1})), "a").numbers,
              (Numbers{0, 1}));
    EXPECT_EQ(parse_npy(npy(header(">i4", "(1,)"), std::string("\0\0\1\2", 4)), "a").numbers,
              (Numbers{258}));
    EXPECT_EQ(parse_npy(npy(header("<f4", "(0, 3)"), ""), "a").shape,
              (std::vector<std::int64_t>{0, 3}));
}

TEST(Npy, TextAndFortranOrder) {
    const NpyArray text =
        parse_npy(npy(header("<U3", "()"), raw<std::uint32_t>({'a', 0xe9, 0})), "a");
    EXPECT_TRUE(text.is_text);
    EXPECT_EQ(text.text, "a?");
    // [[1, 2, 3], [4, 5, 6]] column by column.
    const std::string data = raw<std::int32_t>({1, 4, 2, 5, 3, 6});
    EXPECT_EQ(parse_npy(npy(header("<i4", "(2, 3)", "True"), data), "a").numbers,
              (Numbers{1, 2, 3, 4, 5, 6}));
}

void expect_rejected(const std::string& bytes, const std::string& reason) {
    try {
        parse_npy(bytes, "scene/a.npy");
        ADD_FAILURE() << "accepted; expected: " << reason;
    } catch (const Error& error) {
        EXPECT_EQ(error.code(), ExitCode::input);
        EXPECT_NE(std::string(error.what()).find(reason), std::string::npos) << error.what();
        EXPECT_NE(std::string(error.what()).find("scene/a.npy"), std::string::npos) << error.what();
    }
}

TEST(Npy, BadFiles) {
    const std::string good = npy(header("<f4", "(2,)"), raw({1.5f, -2.0f}));
    for (std::size_t length = 0; length < good.size(); ++length)
        EXPECT_THROW(parse_npy(good.substr(0, length), "a"), Error);
    expect_rejected("PK\3\4 not an array", "signature");
    expect_rejected(good + "x", "9");
    expect_rejected(npy(header("|O", "(1,)"), "12345678"), "unsupported type");
    expect_rejected(npy(header("<c8", "(1,)"), "12345678"), "unsupported type");
    expect_rejected(npy(header("<U2", "(1,)"), "12345678"), "unsupported type");
    expect_rejected(
        npy("{'descr': [('x', '<f4')], 'fortran_order': False, 'shape': (1,), }", "1234"),
        "structured");
    expect_rejected(npy(header("<f4", "(4294967296,)"), "1234"), "2^31");
    expect_rejected(npy(header("<f4", "(2000000000, 2000000000, 2000000000)"), "1234"), "1 GiB");
    expect_rejected(npy("{'descr': '<f4', 'shape': (1,), }", "1234"), "lacks");
    expect_rejected(
        npy("{'descr': '<f4', 'fortran_order': False, 'shape': (1,), 'more': 'x'}", "1234"),
        "unknown key");
}

TEST(Npz, StoredCase) {
    const std::string path = test_data("tensor_voting/cases/per_splat.npz");
    const NpzArchive archive = read_npz(path);
    EXPECT_EQ(find_array(archive, "means").shape, (std::vector<std::int64_t>{220, 3}));
    EXPECT_EQ(find_array(archive, "means").numbers.size(), 660u);
    EXPECT_EQ(find_array(archive, "k").numbers, (Numbers{20}));
    EXPECT_EQ(find_array(archive, "mode").text, "per_splat");
    EXPECT_THROW(find_array(archive, "nothing"), Error);

    // Every damage gives an error with a code and no crash: truncated files and flipped bytes.
    std::ifstream file(path, std::ios::binary);
    const std::string bytes{std::istreambuf_iterator<char>(file), {}};
    const std::string damaged =
        (std::filesystem::temp_directory_path() / "tvsgs_damaged.npz").string();
    const auto read_damaged = [&](const std::string& content) {
        std::ofstream(damaged, std::ios::binary) << content;
        return read_npz(damaged);
    };
    for (const double part : {0.0, 0.1, 0.5, 0.999}) {
        const auto length = static_cast<std::size_t>(part * static_cast<double>(bytes.size()));
        EXPECT_THROW(read_damaged(bytes.substr(0, length)), Error) << length;
    }
    std::string flipped = bytes;
    flipped[bytes.size() / 2] = static_cast<char>(flipped[bytes.size() / 2] ^ 0x55);
    EXPECT_THROW(read_damaged(flipped), Error);
    std::filesystem::remove(damaged);
    EXPECT_THROW(read_npz("/nowhere/at/all.npz"), Error);
}

}  // namespace
}  // namespace tvsgs::test
