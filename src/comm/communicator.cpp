#include "comm/communicator.h"

#include <algorithm>
#include <cstring>

namespace tvsgs {
namespace {

constexpr double kGrace = 10;  // seconds that a process waits that is asked to end

}  // namespace

struct Communicator::Letter {
    std::uint64_t number, bytes;
    char what[32];
    std::byte part[208];  // the whole of it, or nothing
};

std::vector<Communicator::Letter> Communicator::exchange_letters(const char* what,
                                                                 const void* part,
                                                                 std::size_t bytes,
                                                                 bool calm) {
    what_ = what;
    const auto ranks = static_cast<std::size_t>(size());
    Letter mine{};
    mine.number = calls_++, mine.bytes = bytes;
    std::strncpy(mine.what, what, sizeof mine.what - 1);
    if (part != nullptr && bytes <= sizeof mine.part) std::memcpy(mine.part, part, bytes);
    std::vector<Letter> all(ranks);
    Begins begins;
    for (std::size_t r = 0; r <= ranks; ++r) begins.push_back(r * sizeof(Letter));
    gather(&mine, begins, all.data(), calm);
    for (std::size_t r = 0; r < ranks; ++r) {
        const Letter& other = all[r];
        if (other.number != mine.number || std::strcmp(other.what, mine.what) != 0)
            throw Error(ExitCode::peer,
                        str("rank ", r, " is at call ", other.number, " (", other.what,
                            ") and rank ", rank(), " at call ", mine.number, " (", mine.what,
                            "): the processes do not do the same; start them all with the same "
                            "command and the same program"));
    }
    return all;
}

Communicator::Begins Communicator::exchange_sizes(const char* what, std::size_t bytes) {
    Begins begins{0};
    for (const Letter& letter : exchange_letters(what, nullptr, bytes, false))
        begins.push_back(begins.back() + letter.bytes);
    return begins;
}

Communicator::Begins Communicator::all_gather_v(const char* what,
                                                const void* part,
                                                std::size_t bytes,
                                                std::vector<std::byte>& all) {
    const std::vector<Letter> letters = exchange_letters(what, part, bytes, false);
    Begins begins{0};
    bool there = true;  // in the letters
    for (const Letter& letter : letters) {
        begins.push_back(begins.back() + letter.bytes);
        there &= letter.bytes <= sizeof letter.part;
    }
    all.resize(begins.back());
    if (!there) {
        gather(part, begins, all.data(), false);
        return begins;
    }
    for (std::size_t r = 0; r < letters.size(); ++r)
        std::copy_n(letters[r].part, letters[r].bytes,
                    all.begin() + static_cast<std::ptrdiff_t>(begins[r]));
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

void Communicator::gather_on_gpu(const std::vector<Gather>&, const std::function<void()>&) {
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
    exchange_letters(what, nullptr, 0, true);
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
