// PLY parser shared by the readers of clouds, meshes and splats.
#pragma once

#include <algorithm>
#include <bit>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "core/device/parallel_lists.h"
#include "core/log.h"
#include "io/files/number_types.h"
#include "io/files/read_file.h"

namespace tvsgs::ply {

static_assert(std::endian::native == std::endian::little);

struct Type {
    const char *name, *other_name;
    std::size_t bytes;
    double (*load)(const char*);
    bool real = false;
};
inline constexpr Type kTypes[] = {{"char", "int8", 1, load_double<std::int8_t>},
                                  {"uchar", "uint8", 1, load_double<std::uint8_t>},
                                  {"short", "int16", 2, load_double<std::int16_t>},
                                  {"ushort", "uint16", 2, load_double<std::uint16_t>},
                                  {"int", "int32", 4, load_double<std::int32_t>},
                                  {"uint", "uint32", 4, load_double<std::uint32_t>},
                                  {"float", "float32", 4, load_double<float>, true},
                                  {"double", "float64", 8, load_double<double>, true}};

struct Property {
    std::string name;
    const Type *type = nullptr, *count_type = nullptr;  // count_type: only of lists
};

struct Element {
    std::string name;
    std::uint64_t count = 0;
    std::vector<Property> properties;

    int find(std::string_view wanted) const {
        for (std::size_t i = 0; i < properties.size(); ++i)
            if (properties[i].name == wanted) return static_cast<int>(i);
        return -1;
    }
    /// Index of the first of several spellings; -1 if none exists.
    int find(std::initializer_list<const char*> spellings) const {
        for (const char* spelling : spellings)
            if (const int i = find(spelling); i >= 0) return i;
        return -1;
    }
    bool has(std::initializer_list<const char*> all) const {
        return std::ranges::all_of(all, [&](std::string_view wanted) { return find(wanted) >= 0; });
    }
};

/// Parses a PLY file. Read or skip the elements in the order of the file.
class PlyReader {
public:
    static constexpr std::size_t kMaxHeader = 1 << 20;

    explicit PlyReader(const std::string& path) : PlyReader(path, read_bytes(path)) {}
    /// `bytes`: of the file, at least its header.
    PlyReader(const std::string& path, std::string bytes) : path_(path), bytes_(std::move(bytes)) {
        read_header();
    }

    const std::vector<Element>& elements() const { return elements_; }

    /// Calls action(i, row) for each row of an element without lists. Call check_count() first. A
    /// row has one number per property. Several threads read a binary file.
    template <class Action>
    void for_rows(const Element& element, const Action& action) {
        const auto read = [&](std::size_t& at, std::vector<double>& row) {
            for (std::size_t i = 0; i < row.size(); ++i)
                row[i] = get(*element.properties[i].type, at);
        };
        if (ascii_) {
            std::vector<double> row(element.properties.size());
            for (std::size_t i = 0; i < element.count; ++i) read(offset_, row), action(i, row);
            return;
        }
        std::size_t bytes = 0;
        for (const Property& p : element.properties) bytes += p.type->bytes;
        for_parts(element.count, [&](std::size_t /*part*/, std::size_t first, std::size_t last) {
            std::vector<double> row(element.properties.size());
            std::size_t at = offset_ + first * bytes;
            for (std::size_t i = first; i < last; ++i) read(at, row), action(i, row);
        });
        offset_ += element.count * bytes;
    }

    /// Calls on_list(property index, values) for each list in a row. Skips scalars.
    template <class OnList>
    void read_lists(const Element& element, std::vector<double>& values, const OnList& on_list) {
        for (std::size_t i = 0; i < element.properties.size(); ++i) {
            const Property& property = element.properties[i];
            if (!property.count_type) {
                get(*property.type, offset_);
                continue;
            }
            const double count = get(*property.count_type, offset_);
            if (!(count >= 0 && count <= static_cast<double>(left())))
                count_error(element, "a list of ", count, " values");
            values.resize(static_cast<std::size_t>(count));
            for (double& value : values) value = get(*property.type, offset_);
            on_list(static_cast<int>(i), values);
        }
    }

    /// Throws unless the rest of the file can hold the element, so that a wrong count allocates no
    /// memory.
    void check_count(const Element& element) const {
        std::uint64_t row = 0;
        for (const Property& p : element.properties)
            row += ascii_ ? 2 : (p.count_type ? p.count_type : p.type)->bytes;
        // The last number of a text file needs no separator.
        if (row > 0 && element.count > (left() + (ascii_ ? 1 : 0)) / row)
            count_error(element, element.count, " rows of ", row, " or more bytes");
    }

    void skip(const Element& element) {
        check_count(element);
        if (element.properties.empty()) return;
        std::vector<double> values;
        for (std::uint64_t i = 0; i < element.count; ++i)
            read_lists(element, values, [](int, auto&) {});
    }

    /// Call it after the last element. Remaining bytes mean that a count is wrong.
    void finish() const {
        const auto rest = std::string_view(bytes_).substr(offset_);
        if (!(ascii_ ? trimmed(rest) : rest).empty())
            spdlog::warn(
                "{}: ignored {} bytes after the last element; are the counts in the header right?",
                path_, rest.size());
    }

    template <class... Parts>
    [[noreturn]] void header_error(const Parts&... what) const {
        throw input_error("E_PLY_HEADER: ", path_, ": ", what...);
    }
    template <class... Parts>
    [[noreturn]] void count_error(const Element& element, const Parts&... what) const {
        throw input_error("E_PLY_COUNT: ", path_, ": byte ", offset_, ", element '", element.name,
                          "': ", what..., ", but ", left(),
                          " bytes are left; the file is cut off: copy it again");
    }
    const std::string& path() const { return path_; }

private:
    std::size_t left() const { return bytes_.size() - offset_; }

    void read_header() {
        bool has_format = false;
        for (int number = 1;; ++number) {
            const std::size_t end = bytes_.find('\n', offset_);
            if (end == std::string::npos || end > kMaxHeader)
                header_error("no end_header in the first MiB; is this a PLY file?");
            std::string_view line =
                trimmed(std::string_view(bytes_).substr(offset_, end - offset_));
            offset_ = end + 1;
            const std::string_view word = next_word(line);
            if (number == 1) {
                if (word != "ply") header_error("does not start with 'ply'");
            } else if (word == "format") {
                const std::string_view format = next_word(line);
                ascii_ = format == "ascii";
                big_endian_ = format == "binary_big_endian";
                if (!ascii_ && !big_endian_ && format != "binary_little_endian")
                    header_error("unknown format '", shown(format), "'");
                has_format = true;
            } else if (word == "element") {
                Element element;
                element.name = shown(next_word(line));
                if (!parse_number(next_word(line), element.count))
                    header_error("line ", number, ": element '", element.name,
                                 "' has no valid count");
                elements_.push_back(element);
            } else if (word == "property") {
                if (elements_.empty())
                    header_error("line ", number, ": a property before the first element");
                add_property(line, elements_.back(), number);
            } else if (word == "end_header") {
                break;
            } else if (word != "comment" && word != "obj_info" && !word.empty()) {
                header_error("line ", number, ": unknown keyword '", shown(word),
                             "'; is the header cut off?");
            }
        }
        if (!has_format) header_error("no format line");
    }

    void add_property(std::string_view line, Element& element, int number) const {
        const auto type_of = [&](std::string_view word) {
            for (const Type& type : kTypes)
                if (word == type.name || word == type.other_name) return &type;
            header_error("line ", number, ": unknown type '", shown(word), "'");
        };
        Property property;
        std::string_view word = next_word(line);
        if (word == "list") {
            property.count_type = type_of(next_word(line));
            if (property.count_type->real)
                header_error("line ", number, ": a list with a floating-point count");
            word = next_word(line);
        }
        property.type = type_of(word);
        property.name = next_word(line);
        if (element.find(property.name) >= 0)
            header_error("line ", number, ": property '", shown(property.name), "' is given twice");
        element.properties.push_back(property);
    }

    /// Reads the number at byte `at` and moves `at` to the byte after it.
    double get(const Type& type, std::size_t& at) const {
        if (ascii_) {
            std::string_view rest = std::string_view(bytes_).substr(at);
            const std::string_view word = next_word(rest);
            at = bytes_.size() - rest.size();
            double value = 0;
            if (word.empty()) truncated();
            if (!parse_number(word, value))
                throw input_error("E_PLY_COUNT: ", path_, ": byte ", at - word.size(), ": '",
                                  shown(word), "' is not a number");
            return value;
        }
        if (bytes_.size() - at < type.bytes) truncated();
        const char* from = &bytes_[at];
        char raw[sizeof(double)];
        if (big_endian_) from = raw, std::reverse_copy(&bytes_[at], &bytes_[at] + type.bytes, raw);
        at += type.bytes;
        return type.load(from);
    }

    [[noreturn]] void truncated() const {
        throw input_error("E_PLY_COUNT: ", path_, ": the file ends at byte ", bytes_.size(),
                          " in the middle of its elements: copy it again");
    }

    std::string path_, bytes_;
    std::size_t offset_ = 0;
    bool ascii_ = false, big_endian_ = false;
    std::vector<Element> elements_;
};

}  // namespace tvsgs::ply
