#include <zlib.h>
#include <zstd.h>

#include <bit>
#include <cstring>

#include "core/device/parallel.h"
#include "core/error.h"
#include "core/grouped.h"
#include "core/log.h"
#include "core/version.h"
#include "io/files/read_file.h"
#include "io/splats/splat_checks.h"
#include "io/splats/splat_files.h"
#include "io/splats/spz_math.h"

namespace tvsgs {
namespace {

static_assert(std::endian::native == std::endian::little, "SPZ is little-endian");

struct Header {
    std::uint32_t magic = spz::kMagic, version = 0, count = 0;
    std::uint8_t degree = 0, fractional_bits = 0, flags = 0;
    std::uint8_t streams = 0;  // version 4 only, else 0
};
static_assert(sizeof(Header) == spz::kHeaderBytes);
constexpr std::uint8_t kAntialiased = 1;

/// Version 4: the block after the header, and a row of the table, one per stream.
struct Container {
    std::uint32_t table = 0, zero[3] = {};  // `table`: offset of the table
};
struct TableRow {
    std::uint64_t packed = 0, bytes = 0;
};
static_assert(sizeof(Container) == 16 && sizeof(TableRow) == 16);
constexpr std::size_t kContainerEnd = sizeof(Header) + sizeof(Container);
/// Offsets of the arrays of a file and of its end. Version 4: as if not compressed.
struct Layout {
    std::size_t count, rest;  // `rest`: coefficients per channel after the first
    std::size_t rotation_bytes;

    explicit Layout(const Header& h)
        : count(h.count), rest(sh_count(h.degree) - 1), rotation_bytes(h.version == 2 ? 3 : 4) {}
    std::size_t means() const { return spz::kHeaderBytes; }
    std::size_t opacities() const { return means() + 9 * count; }
    std::size_t colors() const { return opacities() + count; }
    std::size_t scales() const { return colors() + 3 * count; }
    std::size_t rotations() const { return scales() + 3 * count; }
    std::size_t sh() const { return rotations() + rotation_bytes * count; }
    std::size_t end() const { return sh() + 3 * rest * count; }
    /// End of each array, which is one stream of version 4. An empty array has no stream.
    std::vector<std::size_t> stream_ends() const {
        std::vector<std::size_t> ends{opacities(), colors(), scales(), rotations(), sh()};
        if (rest > 0) ends.push_back(end());
        return ends;
    }
};

/// Compression or decompression by zlib, with clean-up.
struct Stream {
    z_stream z{};
    int (*end)(z_streamp);

    explicit Stream(int (*e)(z_streamp)) : end(e) {}
    Stream(const Stream&) = delete;
    Stream& operator=(const Stream&) = delete;
    ~Stream() { end(&z); }

    /// zlib counts in 32 bits: at most one GiB at a time.
    static uInt part(std::size_t bytes) {
        return static_cast<uInt>(std::min<std::size_t>(bytes, 1 << 30));
    }
};
constexpr int kGzip = 16 + MAX_WBITS;

std::vector<std::uint8_t> gzip(std::vector<std::uint8_t>& bytes) {
    Stream stream(deflateEnd);
    z_stream& z = stream.z;
    constexpr int kLevel = 3, kMemory = 8;  // level 6: 1 % smaller, twice the time
    if (deflateInit2(&z, kLevel, Z_DEFLATED, kGzip, kMemory, Z_DEFAULT_STRATEGY) != Z_OK)
        throw std::bad_alloc();
    std::string comment = kVersion;  // signature of tvsgs
    gz_header header{};              // no time and no name: equal splats give equal bytes
    header.os = 255;
    header.comment = reinterpret_cast<Bytef*>(comment.data());
    deflateSetHeader(&z, &header);
    std::vector<std::uint8_t> out(1 << 16);
    std::size_t taken = 0, written = 0;
    for (int status = Z_OK; status != Z_STREAM_END;) {
        if (written == out.size()) out.resize(2 * out.size());
        const uInt in = Stream::part(bytes.size() - taken),
                   room = Stream::part(out.size() - written);
        z.next_in = bytes.data() + taken, z.avail_in = in;
        z.next_out = out.data() + written, z.avail_out = room;
        status = deflate(&z, taken + in == bytes.size() ? Z_FINISH : Z_NO_FLUSH);
        taken += in - z.avail_in, written += room - z.avail_out;
    }
    out.resize(written);
    return out;
}

/// Reads a gzip file in pieces.
class Gunzip {
public:
    Gunzip(std::span<const std::uint8_t> bytes, const std::string& name)
        : bytes_(bytes), name_(name), stream_(inflateEnd) {
        if (inflateInit2(&stream_.z, kGzip) != Z_OK) throw std::bad_alloc();
    }
    /// Reads up to `bytes`, fewer at the end of the file. Throws if the file is damaged or cut off.
    std::size_t read(std::uint8_t* out, std::size_t bytes) {
        z_stream& z = stream_.z;
        std::size_t written = 0;
        while (written < bytes && !ended_) {
            const uInt in = Stream::part(bytes_.size() - taken_),
                       room = Stream::part(bytes - written);
            z.next_in = const_cast<Bytef*>(bytes_.data() + taken_), z.avail_in = in;  // read only
            z.next_out = out + written, z.avail_out = room;
            const int status = inflate(&z, Z_NO_FLUSH);
            taken_ += in - z.avail_in, written += room - z.avail_out;
            ended_ = status == Z_STREAM_END;
            if (status == Z_MEM_ERROR) throw std::bad_alloc();
            if (status != Z_OK && status != Z_STREAM_END && status != Z_BUF_ERROR)
                throw input_error(name_, ": damaged: gzip: ", z.msg ? z.msg : "wrong data");
            if (status == Z_BUF_ERROR || (!ended_ && written < bytes && taken_ == bytes_.size()))
                throw input_error(name_, ": cut off in its gzip stream");
        }
        return written;
    }

private:
    std::span<const std::uint8_t> bytes_;
    std::string name_;
    Stream stream_;
    std::size_t taken_ = 0;
    bool ended_ = false;
};

Header parse_header(const std::uint8_t* bytes, std::size_t size, const std::string& name) {
    Header h;
    std::memcpy(&h, bytes, std::min(size, sizeof h));
    if (size < sizeof h || h.magic != spz::kMagic)
        throw input_error(name,
                          ": not an SPZ file: no SPZ header, neither plain nor in a gzip stream");
    if (h.version < 2 || h.version > 4)
        throw input_error(name, ": SPZ version ", h.version, "; expected 2, 3 or 4");
    if (h.degree > spz::kMaxDegree)
        throw input_error(name, ": SH degree ", int{h.degree}, "; expected at most ",
                          spz::kMaxDegree);
    if (h.count == 0 || h.count > spz::kMaxSplats)
        throw input_error(name, ": claims ", h.count, " splats; expected 1 to ", spz::kMaxSplats);
    if (h.fractional_bits > 31)
        throw input_error(name, ": positions of ", int{h.fractional_bits},
                          " fractional bits; expected at most 31");
    return h;
}

/// Reads the rest, so that zlib verifies the checksum. Ignores trailing bytes up to `limit`.
void finish(Gunzip& gunzip, std::size_t limit, const std::string& name) {
    std::uint8_t scratch[1 << 14];
    for (std::size_t more = 0; const std::size_t n = gunzip.read(scratch, sizeof scratch);)
        if ((more += n) > limit)
            throw input_error(name, ": more than ", limit, " bytes after its splats");
}

/// One zstd frame with a checksum. The bytes do not depend on the number of threads.
std::vector<std::uint8_t> zstd_frame(std::span<const std::uint8_t> bytes) {
    const std::unique_ptr<ZSTD_CCtx, decltype(&ZSTD_freeCCtx)> context(ZSTD_createCCtx(),
                                                                       ZSTD_freeCCtx);
    if (!context) throw std::bad_alloc();
    constexpr int kLevel = 12;  // of 1 to 22; higher levels take much longer and gain little
    ZSTD_CCtx_setParameter(context.get(), ZSTD_c_compressionLevel, kLevel);
    ZSTD_CCtx_setParameter(context.get(), ZSTD_c_checksumFlag, 1);
    std::vector<std::uint8_t> frame(ZSTD_compressBound(bytes.size()));
    const std::size_t size =
        ZSTD_compress2(context.get(), frame.data(), frame.size(), bytes.data(), bytes.size());
    if (ZSTD_isError(size))
        throw Error(ExitCode::memory, "zstd: packing failed: ", ZSTD_getErrorName(size));
    frame.resize(size);
    return frame;
}

/// Unpacks the frame into all of `out`.
void read_zstd_frame(std::span<const std::uint8_t> frame,
                     std::span<std::uint8_t> out,
                     const std::string& where) {
    const std::size_t size = ZSTD_decompress(out.data(), out.size(), frame.data(), frame.size());
    if (ZSTD_isError(size)) throw input_error(where, ": damaged: zstd: ", ZSTD_getErrorName(size));
    if (size != out.size())
        throw input_error(where, ": holds ", size, " bytes; expected ", out.size());
}

constexpr const char* kStreamNames[] = {"positions", "opacities", "colours",
                                        "sizes",     "rotations", "SH coefficients"};

/// Version 4 from `bytes` in the order of Layout.
std::vector<std::uint8_t> container(Header h, const std::vector<std::uint8_t>& bytes) {
    const Layout at(h);
    const std::vector<std::size_t> ends = at.stream_ends();
    // The signature of tvsgs lies between header and table. Readers ignore this space unless the
    // flag of extensions is set; as an extension it would cause warnings.
    const std::string_view signature = kVersion;
    h.streams = static_cast<std::uint8_t>(ends.size());
    Container c;
    c.table = static_cast<std::uint32_t>(kContainerEnd + signature.size());
    std::vector<TableRow> table;
    std::vector<std::uint8_t> packed;
    for (std::size_t i = 0, begin = at.means(); i < ends.size(); begin = ends[i++]) {
        const auto frame = zstd_frame(std::span(bytes).subspan(begin, ends[i] - begin));
        table.push_back({frame.size(), ends[i] - begin});
        packed.insert(packed.end(), frame.begin(), frame.end());
    }
    std::vector<std::uint8_t> out;
    const auto put = [&](const void* from, std::size_t size) {
        const auto* first = static_cast<const std::uint8_t*>(from);
        out.insert(out.end(), first, first + size);
    };
    put(&h, sizeof h), put(&c, sizeof c);
    put(signature.data(), signature.size());
    put(table.data(), table.size() * sizeof(TableRow)), put(packed.data(), packed.size());
    return out;
}

/// Unpacks version 4 to the order of Layout, with the header in front.
std::vector<std::uint8_t> open_container(std::span<const std::uint8_t> file,
                                         const std::string& name) {
    const Header h = parse_header(file.data(), file.size(), name);
    if (h.version != 4)
        throw input_error(name, ": SPZ version ", h.version,
                          " without gzip; expected gzip, or version 4");
    const Layout at(h);
    const std::vector<std::size_t> ends = at.stream_ends();
    if (h.streams != ends.size())
        throw input_error(name, ": ", int{h.streams}, " arrays; expected ", ends.size(),
                          " for degree ", int{h.degree});
    Container c;
    if (file.size() < kContainerEnd) throw input_error(name, ": cut off in its header");
    std::memcpy(&c, file.data() + sizeof h, sizeof c);
    if (c.table < kContainerEnd || c.table > file.size() ||
        file.size() - c.table < ends.size() * sizeof(TableRow))
        throw input_error(name, ": the table of arrays is at byte ", c.table,
                          ", outside the file of ", file.size(), " bytes");
    std::vector<TableRow> table(ends.size());
    std::memcpy(table.data(), file.data() + c.table, table.size() * sizeof(TableRow));
    std::size_t from = c.table + table.size() * sizeof(TableRow);
    std::vector<std::span<const std::uint8_t>> frames;
    for (std::size_t i = 0, begin = at.means(); i < ends.size(); begin = ends[i++]) {
        constexpr std::size_t kMaxRatio = 1 << 15;  // zstd: 128 KiB of equal bytes become 4
        const std::size_t bytes = ends[i] - begin;
        if (table[i].bytes != bytes)
            throw input_error(name, ": ", table[i].bytes, " bytes of ", kStreamNames[i],
                              "; its header (", h.count, " splats, degree ", int{h.degree},
                              ") expects ", bytes);
        if (table[i].packed > file.size() - from)
            throw input_error(name, ": cut off in its ", kStreamNames[i]);
        if (bytes / kMaxRatio > table[i].packed)
            throw input_error(name, ": claims ", h.count, " splats, more than its ", file.size(),
                              " bytes can hold");
        frames.push_back(file.subspan(from, table[i].packed));
        from += table[i].packed;
    }
    if (from != file.size())
        throw input_error(name, ": ", file.size() - from, " bytes after its last array");
    std::vector<std::uint8_t> bytes(at.end());
    std::memcpy(bytes.data(), &h, sizeof h);
    for (std::size_t i = 0, begin = at.means(); i < ends.size(); begin = ends[i++])
        read_zstd_frame(frames[i], std::span(bytes).subspan(begin, ends[i] - begin),
                        str(name, ": its ", kStreamNames[i]));
    return bytes;
}

/// The same for versions 2 and 3.
std::vector<std::uint8_t> open_gzip(std::span<const std::uint8_t> file, const std::string& name) {
    Gunzip gunzip(file, name);
    std::uint8_t start[spz::kHeaderBytes] = {};
    const Header h = parse_header(start, gunzip.read(start, sizeof start), name);
    if (h.version == 4)
        throw input_error(name, ": SPZ version 4 inside gzip; expected version 2 or 3");
    const Layout at(h);
    constexpr std::size_t kMaxRatio = 1032;  // largest ratio of deflate
    if (at.end() / kMaxRatio > file.size())
        throw input_error(name, ": claims ", h.count, " splats, more than its ", file.size(),
                          " bytes can hold");
    std::vector<std::uint8_t> bytes(at.end());
    std::memcpy(bytes.data(), start, sizeof start);
    const std::size_t got =
        sizeof start + gunzip.read(bytes.data() + sizeof start, bytes.size() - sizeof start);
    if (got < bytes.size())
        throw input_error(name, ": ", got, " bytes of splats; its header (", h.count,
                          " splats, degree ", int{h.degree}, ") expects ", bytes.size());
    finish(gunzip, bytes.size(), name);
    return bytes;
}

}  // namespace

std::vector<std::uint8_t> spz_bytes(const Gaussians<Cpu>& g,
                                    const SplatFileOptions& options,
                                    const std::string& name) {
    const std::size_t count = g.means.size();
    if (count == 0 || count > spz::kMaxSplats)
        throw input_error(name, ": not written: ", grouped(count), " splats; SPZ holds 1 to ",
                          grouped(spz::kMaxSplats));
    if (options.spz_version < 2 || options.spz_version > 4)
        throw Error(ExitCode::internal, name, ": not written: version ", options.spz_version);
    require_writable(g, name);
    float largest = 0;
    for (const Vec3f p : g.means.span())
        for (int c = 0; c < 3; ++c) largest = std::max(largest, std::abs(p[c]));
    const int fraction = spz::fractional_bits(largest);
    if (fraction < 0)
        throw input_error(name, ": not written: a splat lies ", largest, " units from zero (limit ",
                          spz::kMaxFixed, "); remove far splats with --bbox");

    Header h;
    h.version = static_cast<std::uint32_t>(options.spz_version);
    h.count = static_cast<std::uint32_t>(count);
    h.degree = static_cast<std::uint8_t>(g.sh_degree);
    h.fractional_bits = static_cast<std::uint8_t>(fraction);
    h.flags = options.antialiased ? kAntialiased : 0;
    const Layout at(h);
    const HalfTurn turn = half_turn(options.frame.value_or(SplatFrame::rub));
    std::vector<std::uint8_t> bytes(at.end());
    std::memcpy(bytes.data(), &h, sizeof h);
    parallel_for(Cpu{}, static_cast<int>(count), [&](std::size_t i) {
        const auto put3 = [&](std::size_t begin, const auto& pack, Vec3f v) {
            for (int c = 0; c < 3; ++c) bytes[begin + c] = pack(v[c]);
        };
        const Vec3f p = turn(g.means[i]);
        for (int c = 0; c < 3; ++c) {
            const auto fixed = static_cast<int>(std::round(std::ldexp(p[c], fraction)));
            std::memcpy(&bytes[at.means() + 9 * i + 3 * c], &fixed, 3);
        }
        bytes[at.opacities() + i] = spz::pack_opacity(g.opacity_logits[i]);
        put3(at.colors() + 3 * i, spz::pack_color, g.sh[i]);
        put3(at.scales() + 3 * i, spz::pack_log_scale, g.log_scales[i]);
        std::uint8_t* const rotation = &bytes[at.rotations() + at.rotation_bytes * i];
        const Quatf q = turn(g.quats[i]);
        if (options.spz_version == 2) {
            const auto packed = spz::pack_first_three(q);
            std::copy(packed.begin(), packed.end(), rotation);
        } else {
            const std::uint32_t packed = spz::pack_smallest_three(q);
            std::memcpy(rotation, &packed, sizeof packed);
        }
        for (std::size_t k = 0; k < at.rest; ++k) {
            const int bits = k < 3 ? options.spz_sh_bits_1 : options.spz_sh_bits_rest;
            const float sign = turn.of_coefficient(static_cast<int>(k) + 1);
            put3(
                at.sh() + 3 * (at.rest * i + k), [bits](float f) { return spz::pack_sh(f, bits); },
                sign * g.sh[(k + 1) * count + i]);
        }
    });
    return options.spz_version == 4 ? container(h, bytes) : gzip(bytes);
}

SpzContents parse_spz(std::span<const std::uint8_t> file,
                      const std::string& name,
                      SplatFrame frame) {
    const bool plain = file.size() >= 4 && std::memcmp(file.data(), &spz::kMagic, 4) == 0;
    if (!plain && (file.size() < 2 || file[0] != 0x1f || file[1] != 0x8b))
        throw input_error(name, ": not an SPZ file: neither gzip nor SPZ version 4");
    const std::vector<std::uint8_t> bytes =
        plain ? open_container(file, name) : open_gzip(file, name);
    Header h;
    std::memcpy(&h, bytes.data(), sizeof h);
    const Layout at(h);

    SpzContents out;
    out.version = static_cast<int>(h.version);
    out.fractional_bits = h.fractional_bits;
    out.antialiased = h.flags & kAntialiased;
    Gaussians<Cpu>& g = out.splats;
    if (h.degree > 3)
        spdlog::warn("{}: uses SH coefficients up to degree 3, the file has degree {}", name,
                     int{h.degree});
    resize(g, static_cast<int>(h.count), std::min(int{h.degree}, 3));
    const int kept = sh_count(g.sh_degree) - 1;
    const HalfTurn turn = half_turn(frame);
    parallel_for(Cpu{}, g.size(), [&](std::size_t i) {
        const auto get3 = [&](std::size_t begin, const auto& unpack) {
            return Vec3f{unpack(bytes[begin]), unpack(bytes[begin + 1]), unpack(bytes[begin + 2])};
        };
        Vec3f p;
        for (int c = 0; c < 3; ++c) {
            std::uint32_t fixed = 0;
            std::memcpy(&fixed, &bytes[at.means() + 9 * i + 3 * c], 3);
            const int value = static_cast<int>(fixed << 8) >> 8;  // bit 23 is the sign
            p[c] = std::ldexp(static_cast<float>(value), -out.fractional_bits);
        }
        g.means[i] = turn(p);
        g.opacity_logits[i] = spz::unpack_opacity(bytes[at.opacities() + i]);
        g.sh[i] = get3(at.colors() + 3 * i, spz::unpack_color);
        g.log_scales[i] = get3(at.scales() + 3 * i, spz::unpack_log_scale);
        const std::uint8_t* const rotation = &bytes[at.rotations() + at.rotation_bytes * i];
        std::uint32_t packed = 0;
        std::memcpy(&packed, rotation, at.rotation_bytes);
        g.quats[i] = turn(h.version == 2 ? spz::unpack_first_three(rotation)
                                         : spz::unpack_smallest_three(packed));
        for (int k = 0; k < kept; ++k)
            g.sh[(k + 1) * h.count + i] =
                turn.of_coefficient(k + 1) * get3(at.sh() + 3 * (at.rest * i + k), spz::unpack_sh);
    });
    return out;
}

SpzContents read_spz(const std::string& path, SplatFrame frame) {
    const std::string bytes = read_bytes(path);
    return parse_spz({reinterpret_cast<const std::uint8_t*>(bytes.data()), bytes.size()}, path,
                     frame);
}

}  // namespace tvsgs
