#include "apps/priors/onnx_file.h"

#include <algorithm>
#include <optional>
#include <set>

#include "io/read_file.h"

namespace tvsgs::priors {
namespace {

/// The fields of one protobuf message, one after the other. Numbers of the fields are those of
/// ONNX's public schema, onnx.proto.
class Message {
public:
    Message(std::string_view all, const std::string& path) : rest_(all), path_(path) {}

    int field = 0;
    std::int64_t number = 0;  // of a varint
    std::string_view bytes;   // of what has a length

    /// False at the end.
    bool next() {
        if (rest_.empty()) return false;
        const std::uint64_t key = varint();
        field = static_cast<int>(key >> 3);
        number = 0, bytes = {};
        switch (key & 7) {
            case 0:
                number = static_cast<std::int64_t>(varint());
                break;
            case 1:
                take(8);
                break;
            case 2:
                bytes = take(varint());
                break;
            case 5:
                take(4);
                break;
            default:
                fail();
        }
        if (field == 0) fail();
        return true;
    }
    Message inner() const { return {bytes, path_}; }
    std::string text() const { return std::string(bytes); }

private:
    [[noreturn]] void fail() const {
        throw input_error("E_ONNX: ", path_,
                          ": is no ONNX file, or is cut off; expected a network as exporters write "
                          "it (*.onnx): download or export it again");
    }
    std::uint64_t varint() {
        std::uint64_t value = 0;
        for (unsigned shift = 0; shift < 64 && !rest_.empty(); shift += 7) {
            const auto byte = static_cast<unsigned char>(rest_.front());
            rest_.remove_prefix(1);
            value |= static_cast<std::uint64_t>(byte & 127) << shift;
            if (byte < 128) return value;
        }
        fail();
    }
    std::string_view take(std::uint64_t size) {
        if (size > rest_.size()) fail();
        const std::string_view taken = rest_.substr(0, size);
        rest_.remove_prefix(size);
        return taken;
    }

    std::string_view rest_;
    const std::string& path_;
};

std::int64_t length_of(Message dimension) {
    std::int64_t length = -1;  // a name of its own, or nothing: free
    while (dimension.next())
        if (dimension.field == 1 && dimension.number > 0) length = dimension.number;
    return length;
}

/// ValueInfoProto: name, type.tensor_type.shape.dim.
OnnxTensor tensor_of(Message info) {
    OnnxTensor tensor;
    while (info.next()) {
        if (info.field == 1) tensor.name = info.text();
        if (info.field != 2) continue;
        for (Message type = info.inner(); type.next();)
            if (type.field == 1)
                for (Message array = type.inner(); array.next();)
                    if (array.field == 2)
                        for (Message shape = array.inner(); shape.next();)
                            if (shape.field == 1) tensor.shape.push_back(length_of(shape.inner()));
    }
    return tensor;
}

/// The text of the field of a message; the last where there are several.
std::string text_in(Message message, int field) {
    std::string found;
    while (message.next())
        if (message.field == field) found = message.text();
    return found;
}

/// TensorProto.external_data: pairs of keys and values, of which "location" is a file.
std::string weights_file_of(Message tensor) {
    while (tensor.next())
        if (tensor.field == 13 && text_in(tensor.inner(), 1) == "location")
            return text_in(tensor.inner(), 2);
    return "";
}

OnnxFile parse_graph(Message graph) {
    OnnxFile file;
    std::set<std::string> weights, operators;
    while (graph.next()) {
        if (graph.field == 1) operators.insert(text_in(graph.inner(), 4));
        if (graph.field == 5) {
            weights.insert(text_in(graph.inner(), 8));
            if (file.weights_file.empty()) file.weights_file = weights_file_of(graph.inner());
        }
        if (graph.field == 11) file.inputs.push_back(tensor_of(graph.inner()));
        if (graph.field == 12) file.outputs.push_back(tensor_of(graph.inner()));
    }
    // Old exporters list weights as inputs as well.
    std::erase_if(file.inputs, [&](const OnnxTensor& t) { return weights.contains(t.name); });
    file.operators.assign(operators.begin(), operators.end());
    return file;
}

}  // namespace

OnnxFile parse_onnx(std::string_view bytes, const std::string& path) {
    std::optional<OnnxFile> file;
    for (Message model(bytes, path); model.next();)
        if (model.field == 7) file = parse_graph(model.inner());
    if (!file || file->operators.empty())
        throw input_error("E_ONNX: ", path, ": of ", bytes.size(),
                          " bytes has no network in it; expected an ONNX file (*.onnx)");
    return *file;
}

std::string text_of(const std::vector<std::int64_t>& shape) {
    std::string text;
    for (const std::int64_t n : shape) text += (text.empty() ? "" : ", ") + (n < 0 ? "?" : str(n));
    return "(" + text + ")";
}

std::string text_of(const std::vector<OnnxTensor>& tensors) {
    std::string text;
    for (const OnnxTensor& t : tensors)
        text += str(text.empty() ? "" : ", ", shown(t.name), " ", text_of(t.shape));
    return text.empty() ? "none" : text;
}

}  // namespace tvsgs::priors
