#include "comm/communicator.h"

#include <algorithm>
#include <cstring>

namespace tvsgs {
namespace {

constexpr double kGrace = 10;  // seconds that a process waits that is asked to end

/// What every rank says of its next call, before the call.
struct Header {
    std::uint64_t number, bytes;
    char what[32];
};

Header header_of(std::uint64_t number, const char* what, std::size_t bytes) {
    Header header{};
    header.number = number, header.bytes = bytes;
    std::strncpy(header.what, what, sizeof header.what - 1);
    return header;
}

}  // namespace

Communicator::Begins Communicator::exchange_sizes(const char* what, std::size_t bytes, bool calm) {
    what_ = what;
    const auto ranks = static_cast<std::size_t>(size());
    const Header mine = header_of(calls_++, what, bytes);
    std::vector<Header> all(ranks);
    Begins begins;
    for (std::size_t r = 0; r <= ranks; ++r) begins.push_back(r * sizeof(Header));
    gather(&mine, begins, all.data(), calm);
    begins.assign(1, 0);
    for (std::size_t r = 0; r < ranks; ++r) {
        const Header& other = all[r];
        if (other.number != mine.number || std::strcmp(other.what, mine.what) != 0)
            throw Error(ExitCode::peer,
                        str("rank ", r, " is at call ", other.number, " (", other.what,
                            ") and rank ", rank(), " at call ", mine.number, " (", mine.what,
                            "): the processes do not do the same; start them all with the same "
                            "command and the same program"));
        begins.push_back(begins.back() + other.bytes);
    }
    return begins;
}

Communicator::Begins Communicator::all_gather_v(const char* what,
                                                const void* part,
                                                std::size_t bytes,
                                                std::vector<std::byte>& all) {
    Begins begins = exchange_sizes(what, bytes, false);
    all.resize(begins.back());
    if (!all.empty()) gather(part, begins, all.data(), false);
    return begins;
}

void Communicator::require_same_parts(const char* what,
                                      const Begins& said,
                                      const Begins& expected) const {
    if (said != expected)
        throw Error(ExitCode::peer, str("rank ", rank(), ": the processes do not divide alike (",
                                        what, "): they are not at the same state"));
}

Communicator::Begins Communicator::exchange_places(const char* what, const Begins& to) {
    const auto ranks = static_cast<std::size_t>(size()), own = static_cast<std::size_t>(rank());
    std::vector<std::uint64_t> sizes(ranks);
    for (std::size_t r = 0; r < ranks; ++r) sizes[r] = to[r + 1] - to[r];
    std::vector<std::byte> all;
    all_gather_v(what, sizes.data(), ranks * sizeof sizes[0], all);
    Begins from{0};
    for (std::size_t r = 0; r < ranks; ++r) {
        std::uint64_t bytes = 0;
        std::memcpy(&bytes, all.data() + (r * ranks + own) * sizeof bytes, sizeof bytes);
        from.push_back(from.back() + bytes);
    }
    return from;
}

void Communicator::deal_on_gpu(const void*, const Begins&, void*, const Begins&) {
    throw Error(ExitCode::internal, "the backend of these processes does not reach GPU memory");
}

void Communicator::gather_on_gpu(const void*, const Begins&, void*) {
    throw Error(ExitCode::internal, "the backend of these processes does not reach GPU memory");
}

void Communicator::broadcast(const char* what, void* data, std::size_t bytes, int root) {
    std::vector<std::byte> all;
    all_gather_v(what, data, rank() == root ? bytes : 0, all);
    if (all.size() != bytes)
        throw Error(ExitCode::peer, str("rank ", root, " has sent ", all.size(), " bytes (", what,
                                        "), and rank ", rank(), " expects ", bytes));
    std::memcpy(data, all.data(), bytes);
}

std::string Communicator::broadcast(const char* what, const std::string& text, int root) {
    std::vector<std::byte> all;
    all_gather_v(what, text.data(), rank() == root ? text.size() : 0, all);
    return {reinterpret_cast<const char*>(all.data()), all.size()};
}

void Communicator::all_reduce(const char* what, Reduce reduce, std::vector<std::int64_t>& values) {
    const std::size_t count = values.size();
    std::vector<std::byte> all;
    all_gather_v(what, values.data(), count * sizeof values[0], all);
    if (all.size() != count * sizeof values[0] * static_cast<std::size_t>(size()))
        throw Error(ExitCode::peer,
                    str("the ranks have not as many numbers to reduce (", what, ")"));
    for (int r = 0; r < size(); ++r)
        for (std::size_t i = 0; i < count; ++i) {
            std::int64_t value = 0;
            std::memcpy(&value,
                        all.data() + (static_cast<std::size_t>(r) * count + i) * sizeof value,
                        sizeof value);
            if (r == 0)
                values[i] = value;
            else
                values[i] = reduce == Reduce::sum   ? values[i] + value
                            : reduce == Reduce::min ? std::min(values[i], value)
                                                    : std::max(values[i], value);
        }
}

void Communicator::wait_for_all(const char* what) {
    unlimited_ = true;
    exchange_sizes(what, 0, true);
    unlimited_ = false;
}

void Communicator::keep_waiting(double seconds) {
    if (unlimited_) return;
    const auto give_up = [&](const std::string& why) {
        throw Error(ExitCode::peer,
                    str("rank ", rank(), " of ", size(), " ", why, " (call '", what_,
                        "', iteration ", iteration_,
                        "): another process is gone or stuck; the same command with --resume goes "
                        "on from the last checkpoint"));
    };
    if (seconds > limit_) give_up(str("has waited ", limit_, " s for the others (comm.timeout)"));
    if (!asked_to_end_ || !asked_to_end_()) {
        asked_at_ = -1;
        return;
    }
    if (asked_at_ < 0 || asked_at_ > seconds) asked_at_ = seconds;
    if (seconds - asked_at_ > kGrace)
        give_up(str("was asked to end and has waited ", kGrace, " s for the others"));
}

}  // namespace tvsgs
