// Writes small ONNX files: the few messages of its protobuf schema that networks of the tests need.
#pragma once

#include <bit>
#include <cstdint>
#include <cstring>
#include <string>
#include <vector>

namespace tvsgs::test {

// Protobuf: a key of field and wire type, then a varint, four bytes, or a length and its bytes.
inline std::string varint(std::uint64_t value) {
    std::string out;
    for (; value >= 128; value >>= 7) out += static_cast<char>(value | 128);
    return out + static_cast<char>(value);
}
inline std::string number(int field, std::int64_t value) {
    return varint(static_cast<std::uint64_t>(field) << 3) +
           varint(static_cast<std::uint64_t>(value));
}
inline std::string part(int field, const std::string& bytes) {
    return varint((static_cast<std::uint64_t>(field) << 3) | 2) + varint(bytes.size()) + bytes;
}

using Ints = std::vector<std::int64_t>;

inline std::string ints_attribute(const std::string& name, const Ints& values) {
    std::string out = part(1, name);
    for (const std::int64_t v : values) out += number(8, v);
    return part(5, out + number(20, 7));
}
inline std::string int_attribute(const std::string& name, std::int64_t value) {
    return part(5, part(1, name) + number(3, value) + number(20, 2));
}

/// A node of the graph; `attributes`: of the functions above.
inline std::string node(const std::string& op,
                        const std::vector<std::string>& inputs,
                        const std::vector<std::string>& outputs,
                        const std::string& attributes = "",
                        const std::string& name = "") {
    std::string out;
    for (const std::string& input : inputs) out += part(1, input);
    for (const std::string& output : outputs) out += part(2, output);
    if (!name.empty()) out += part(3, name);
    return part(1, out + part(4, op) + attributes);
}

/// A constant of the graph: float32, or int64.
inline std::string constant(const std::string& name,
                            const Ints& shape,
                            const std::vector<float>& values) {
    std::string out, raw(values.size() * sizeof(float), '\0');
    for (const std::int64_t n : shape) out += number(1, n);
    std::memcpy(raw.data(), values.data(), raw.size());
    return part(5, out + number(2, 1) + part(8, name) + part(9, raw));
}
inline std::string constant(const std::string& name, const Ints& values) {
    std::string raw(values.size() * sizeof(std::int64_t), '\0');
    std::memcpy(raw.data(), values.data(), raw.size());
    return part(5, number(1, static_cast<std::int64_t>(values.size())) + number(2, 7) +
                       part(8, name) + part(9, raw));
}

/// A constant whose numbers are in another file.
inline std::string constant_elsewhere(const std::string& name, const Ints& shape) {
    std::string out;
    for (const std::int64_t n : shape) out += number(1, n);
    return part(5, out + number(2, 1) + part(8, name) +
                       part(13, part(1, "location") + part(2, "net.onnx.data")) + number(14, 1));
}

/// An input (field 11) or output (12) of the graph; a length of -1 is free.
inline std::string value_info(int field, const std::string& name, const Ints& shape) {
    std::string dimensions;
    for (const std::int64_t n : shape)
        dimensions += part(1, n < 0 ? part(2, "free") : number(1, n));
    return part(field, part(1, name) + part(2, part(1, number(1, 1) + part(2, dimensions))));
}

/// A file of nodes, constants, inputs and outputs.
inline std::string onnx_file(const std::string& graph) {
    return number(1, 7) + part(2, "tvsgs tests") + part(8, number(2, 11)) +
           part(7, graph + part(2, "graph"));
}

/// One convolution of `image` [1, 3, height, width] to `map` without padding: weights [channels, 3,
/// kernel, kernel], biases [channels].
inline std::string convolution(const Ints& image,
                               int channels,
                               const std::vector<float>& weights,
                               const std::vector<float>& biases,
                               int kernel = 1) {
    return onnx_file(node("Conv", {"image", "weights", "biases"}, {"map"},
                          ints_attribute("kernel_shape", {kernel, kernel}) +
                              ints_attribute("strides", {kernel, kernel})) +
                     constant("weights", {channels, 3, kernel, kernel}, weights) +
                     constant("biases", {channels}, biases) + value_info(11, "image", image) +
                     value_info(12, "map", {-1, channels, -1, -1}));
}

}  // namespace tvsgs::test
