#include "io/files/checkpoint.h"

#include <zlib.h>

#include <bit>
#include <cstdio>
#include <filesystem>

#include "core/grouped.h"
#include "io/files/atomic_file.h"
#include "io/files/number_types.h"
#include "io/files/read_file.h"

namespace tvsgs {
namespace {

static_assert(std::endian::native == std::endian::little);

constexpr char kMagic[] = "TVSGSCKP";
constexpr std::size_t kMagicBytes = 8, kFixedBytes = kMagicBytes + 4 + 4 + 8 + 4;
constexpr std::size_t kMaxTableBytes = 1 << 20;  // enough for a few hundred names

/// Reads values from the front of a text. Reading beyond its end is an error.
struct Reader {
    const std::string& path;
    std::string_view left;

    std::string_view bytes(std::size_t count) {
        if (left.size() < count) throw input_error(path, ": its table of arrays is damaged");
        const std::string_view taken = left.substr(0, count);
        left.remove_prefix(count);
        return taken;
    }
    template <class T>
    T take() {
        return load<T>(bytes(sizeof(T)).data());
    }
};

/// Entry of an array in the table.
struct Entry {
    std::string name;
    std::uint32_t element_bytes;
    bool real;
    std::uint64_t bytes;
    std::uint32_t crc;
};

Entry take_entry(Reader& reader) {
    Entry e;
    e.name = reader.bytes(reader.take<std::uint32_t>());
    e.element_bytes = reader.take<std::uint32_t>();
    e.real = reader.take<std::uint8_t>() != 0;
    e.bytes = reader.take<std::uint64_t>();
    e.crc = reader.take<std::uint32_t>();
    if (e.element_bytes == 0 || e.bytes % e.element_bytes != 0 ||
        (e.real && e.element_bytes % 4 != 0))
        throw input_error(reader.path, ": its table of arrays is damaged at '", shown(e.name), "'");
    return e;
}

class File {
public:
    explicit File(const std::string& path) : path_(path), file_(open_file(path)) {
        std::error_code no_matter;
        const auto size = std::filesystem::file_size(path, no_matter);
        size_ = no_matter ? 0 : size;
    }

    std::uint64_t size() const { return size_; }

    void read(void* to, std::size_t bytes) {
        if (bytes == 0 || std::fread(to, 1, bytes, file_.get()) == bytes) return;
        check_read(file_, path_);
        throw input_error(path_, ": the checkpoint is cut off after ", grouped(size_), " bytes");
    }

private:
    std::string path_;
    OpenFile file_;
    std::uint64_t size_ = 0;
};

}  // namespace

std::uint32_t checksum(const void* data, std::size_t bytes, std::uint32_t so_far) {
    return static_cast<std::uint32_t>(crc32_z(so_far, static_cast<const Bytef*>(data), bytes));
}

void write_checkpoint(const std::string& path, std::initializer_list<const State*> parts) {
    std::string table;
    std::uint64_t data_bytes = 0;
    std::uint32_t count = 0;
    for (const State* part : parts)
        for (const StateArray& array : part->arrays) {
            const std::size_t bytes = array.bytes.size();
            put(table, static_cast<std::uint32_t>(array.name.size()));
            table += array.name;
            put(table, array.element_bytes);
            put(table, static_cast<std::uint8_t>(array.real));
            put(table, std::uint64_t{bytes});
            put(table, checksum(array.bytes.data(), bytes));
            data_bytes += bytes, ++count;
        }
    std::string head(kMagic, kMagicBytes);
    put(head, kCheckpointVersion);
    put(head, static_cast<std::uint32_t>(table.size()));
    put(head, static_cast<std::uint64_t>(kFixedBytes + table.size() + 4 + data_bytes));
    put(head, count);
    head += table;
    put(head, checksum(head.data(), head.size()));
    AtomicFile file(path);
    file.write(head);
    for (const State* part : parts)
        for (const StateArray& array : part->arrays)
            file.write(array.bytes.data(), array.bytes.size());
    file.commit();
}

State read_checkpoint(const std::string& path) {
    File file(path);
    std::string head(kFixedBytes, '\0');
    if (file.size() < kFixedBytes)
        throw input_error(path, ": ", file.size(),
                          " bytes, too short for a checkpoint of tvsgs-train");
    file.read(head.data(), head.size());
    Reader fixed{path, head};
    if (fixed.bytes(kMagicBytes) != kMagic)
        throw input_error(path, ": not a checkpoint of tvsgs-train");
    const auto version = fixed.take<std::uint32_t>(), table_bytes = fixed.take<std::uint32_t>();
    const auto file_bytes = fixed.take<std::uint64_t>();
    const auto arrays = fixed.take<std::uint32_t>();
    if (version != kCheckpointVersion)
        throw input_error(path, ": checkpoint version ", version, ", or damaged; expected version ",
                          kCheckpointVersion, "; resume with the program that wrote it");
    if (table_bytes > kMaxTableBytes || file.size() < kFixedBytes + table_bytes + 4)
        throw input_error(path, ": the checkpoint is cut off or damaged in its first bytes");
    head.resize(kFixedBytes + table_bytes + 4);
    file.read(head.data() + kFixedBytes, table_bytes + 4);
    Reader reader{path, std::string_view(head).substr(kFixedBytes)};
    const std::string_view table = reader.bytes(table_bytes);
    if (reader.take<std::uint32_t>() != checksum(head.data(), kFixedBytes + table_bytes))
        throw input_error(
            path, ": the checksum of the table of arrays differs; the checkpoint is damaged");
    if (file.size() != file_bytes)
        throw input_error(path, ": ", grouped(file.size()), " bytes, expected ",
                          grouped(file_bytes), "; the checkpoint is ",
                          file.size() < file_bytes ? "cut off" : "damaged");

    reader.left = table;
    State state;
    std::uint64_t left = file_bytes - head.size();
    for (std::uint32_t i = 0; i < arrays; ++i) {
        const Entry entry = take_entry(reader);
        if (entry.bytes > left)
            throw input_error(path, ": its table of arrays is damaged at '", shown(entry.name),
                              "'");
        left -= entry.bytes;
        StateArray& array = state.add(entry.name, entry.element_bytes,
                                      entry.bytes / entry.element_bytes, entry.real);
        file.read(array.bytes.data(), array.bytes.size());
        if (checksum(array.bytes.data(), array.bytes.size()) != entry.crc)
            throw input_error(path, ": the checksum of array '", shown(entry.name),
                              "' differs; the checkpoint is damaged");
    }
    if (left != 0 || !reader.left.empty())
        throw input_error(path,
                          ": the table of arrays and the size differ; the checkpoint is damaged");
    return state;
}

}  // namespace tvsgs
