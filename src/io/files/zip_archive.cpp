#include "io/files/zip_archive.h"

#include <zip.h>

#include <memory>
#include <set>

#include "core/error.h"
#include "io/files/read_file.h"

namespace tvsgs {
namespace {

using Archive = std::unique_ptr<zip_t, decltype(&zip_discard)>;

std::string reason_of(zip_error_t& error) {
    std::string reason = zip_error_strerror(&error);
    zip_error_fini(&error);
    return reason;
}

}  // namespace

void read_zip(const std::string& path,
              const std::string& kind,
              const ZipLimits& limits,
              const std::function<void(const std::string&, std::string)>& take) {
    require_regular_file(path);
    int code = 0;
    const Archive zip(zip_open(path.c_str(), ZIP_RDONLY | ZIP_CHECKCONS, &code), zip_discard);
    if (!zip) {
        zip_error_t error;
        zip_error_init_with_code(&error, code);
        throw input_error(path, ": cannot read it as a ", kind,
                          " (ZIP) archive: ", reason_of(error));
    }
    const auto entries = static_cast<std::uint64_t>(zip_get_num_entries(zip.get(), 0));
    if (entries > limits.entries)
        throw input_error(path, ": ", entries, " entries (limit ", limits.entries, ")");
    std::set<std::string> names;
    std::uint64_t total = 0;
    for (std::uint64_t i = 0; i < entries; ++i) {
        zip_stat_t stat;
        if (zip_stat_index(zip.get(), i, 0, &stat) != 0 || stat.name == nullptr)
            throw input_error(path, ": entry ", i, " is damaged");
        const std::string name = stat.name;
        const auto fail = [&](const auto&... what) {
            throw input_error(path, ": ", name, ": ", what...);
        };
        constexpr unsigned kNeeded = ZIP_STAT_SIZE | ZIP_STAT_COMP_SIZE | ZIP_STAT_COMP_METHOD;
        if ((stat.valid & kNeeded) != kNeeded) fail("the entry has no size");
        if (stat.comp_method != ZIP_CM_STORE && stat.comp_method != ZIP_CM_DEFLATE)
            fail("unknown compression; expected deflate");
        if (stat.size > limits.entry_bytes || stat.size / limits.ratio > stat.comp_size)
            fail(stat.size, " bytes from ", stat.comp_size, " exceed the limit");
        total += stat.size;
        if (total > limits.total_bytes)
            fail("the entries have ", total, " bytes up to here (limit ", limits.total_bytes, ")");
        if (!names.insert(name).second) fail("two entries have this name");
        const std::unique_ptr<zip_file_t, decltype(&zip_fclose)> file(
            zip_fopen_index(zip.get(), i, 0), zip_fclose);
        std::string bytes(stat.size, '\0');
        char end = 0;
        // libzip compares the checksum only when the entry is read to its end.
        if (!file ||
            zip_fread(file.get(), bytes.data(), stat.size) != static_cast<zip_int64_t>(stat.size) ||
            zip_fread(file.get(), &end, 1) != 0)
            fail("the entry is truncated, or its checksum is wrong");
        take(name, std::move(bytes));
    }
}

std::string zip_bytes(const std::vector<std::pair<std::string, std::string>>& entries) {
    zip_error_t error;
    zip_error_init(&error);
    const auto check = [&](bool good, auto* of) {
        if (good) return;
        throw Error(ExitCode::internal,
                    "making a ZIP archive failed: ", of ? zip_error_strerror(of) : "out of memory");
    };
    // `bytes` must outlive the archive: closing the archive writes them.
    zip_source_t* const bytes = zip_source_buffer_create(nullptr, 0, 0, &error);
    check(bytes != nullptr, &error);
    zip_source_keep(bytes);
    const std::unique_ptr<zip_source_t, decltype(&zip_source_free)> held(bytes, zip_source_free);
    Archive zip(zip_open_from_source(bytes, ZIP_TRUNCATE, &error), zip_discard);
    if (!zip) zip_source_free(bytes);
    check(zip != nullptr, &error);
    for (const auto& [name, content] : entries) {
        zip_source_t* const source =
            zip_source_buffer(zip.get(), content.data(), content.size(), 0);
        check(source != nullptr, zip_get_error(zip.get()));
        const zip_int64_t at = zip_file_add(zip.get(), name.c_str(), source, ZIP_FL_ENC_UTF_8);
        if (at < 0) zip_source_free(source);
        check(at >= 0, zip_get_error(zip.get()));
        const auto index = static_cast<zip_uint64_t>(at);
        constexpr zip_uint16_t kFirstOf1980 = 1 << 5 | 1;  // earliest possible date
        check(zip_set_file_compression(zip.get(), index, ZIP_CM_STORE, 0) == 0 &&
                  zip_file_set_dostime(zip.get(), index, 0, kFirstOf1980, 0) == 0,
              zip_get_error(zip.get()));
    }
    check(zip_close(zip.get()) == 0, zip_get_error(zip.get()));
    (void)zip.release();  // zip_close() has released it
    std::string out;
    zip_stat_t stat;
    check(zip_source_stat(bytes, &stat) == 0 && zip_source_open(bytes) == 0,
          zip_source_error(bytes));
    out.resize(stat.size);
    const zip_int64_t got = zip_source_read(bytes, out.data(), out.size());
    zip_source_close(bytes);
    check(got == static_cast<zip_int64_t>(out.size()), zip_source_error(bytes));
    return out;
}

}  // namespace tvsgs
