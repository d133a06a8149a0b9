#include <cmath>
#include <cstring>

#include "io/files/npz.h"
#include "io/io_test.h"

namespace tvsgs {
namespace {

/// Length of the header, header, data.
std::string safetensors(const std::string& header, const std::string& data) {
    const std::uint64_t length = header.size();
    std::string bytes(8, '\0');
    std::memcpy(bytes.data(), &length, 8);
    return bytes + header + data;
}

template <class T>
std::string raw(std::initializer_list<T> values) {
    return {reinterpret_cast<const char*>(values.begin()), values.size() * sizeof(T)};
}

class Safetensors : public IoTest {
protected:
    void expect_damaged(const std::string& text, const std::string& bytes) {
        const std::string path = write("bad.safetensors", bytes);
        expect_error(ExitCode::input, text, [&] { read_safetensors(path); });
    }
};

TEST_F(Safetensors, Types) {
    const std::string header =
        R"({"__metadata__": {"format": "pt"}, "a": {"dtype": "F32", "shape": [2, 1], )"
        R"("data_offsets": [0, 8]}, "b": {"dtype": "F64", "shape": [], "data_offsets": [8, 16]}, )"
        R"("half": {"dtype": "F16", "shape": [5], "data_offsets": [16, 26]}})";
    const std::string data = raw({1.5f, -2.0f}) + raw({0.1}) +
                             raw<std::uint16_t>({0x3c00, 0xc000, 0x0001, 0x7bff, 0x7c00});
    const NpzArchive archive = read_tensors(write("good", safetensors(header, data)));
    ASSERT_EQ(archive.size(), 3u);
    EXPECT_EQ(archive.at("a").shape, (std::vector<std::int64_t>{2, 1}));
    EXPECT_EQ(archive.at("a").numbers, (std::vector<double>{1.5, -2}));
    EXPECT_EQ(archive.at("b").numbers, std::vector<double>{0.1});
    EXPECT_EQ(archive.at("half").numbers,
              (std::vector<double>{1, -2, std::ldexp(1, -24), 65504, INFINITY}));
}

TEST_F(Safetensors, DamagedFiles) {
    const std::string entry = R"("dtype": "F32", "shape": [2], "data_offsets": )";
    const auto with = [&](const std::string& offsets) {
        return safetensors("{\"a\": {" + entry + offsets + "}}", raw({1.0f, 2.0f}));
    };
    const std::string good = with("[0, 8]");
    EXPECT_EQ(read_safetensors(write("good", good)).at("a").numbers.size(), 2u);
    for (std::size_t length = 0; length < good.size(); ++length) {
        const std::string path = write("bad", good.substr(0, length));
        EXPECT_THROW(read_safetensors(path), Error) << length;
    }
    expect_damaged("lies at bytes 4 to 12 of 8", with("[4, 12]"));
    expect_damaged("2 numbers in 4 bytes", with("[0, 4]"));
    expect_damaged("whole numbers", with("[-1, 7]"));
    expect_damaged("no data_offsets", with("8"));
    expect_damaged("the header claims", std::string(8, '\x7f') + "{}");
    expect_damaged("has type BF16",
                   safetensors(R"({"a": {"dtype": "BF16", "shape": [1], "data_offsets": [0, 2]}})",
                               std::string(2, ' ')));
    expect_damaged("larger than the file",
                   safetensors(R"({"a": {"dtype": "F32", "shape": [4294967296, 4294967296], )"
                               R"("data_offsets": [0, 0]}})",
                               ""));
    expect_damaged("overlap",
                   safetensors("{\"a\": {" + entry + "[0, 8]}, \"b\": {" + entry + "[0, 8]}}",
                               raw({1.0f, 2.0f})));
}

}  // namespace
}  // namespace tvsgs
