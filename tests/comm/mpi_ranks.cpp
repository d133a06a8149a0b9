// A process that mpirun has started, for test_mpi: calls with large, uneven and empty parts; or,
// with `alone`, rank 1 leaves the others waiting. Prints what is wrong.
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <thread>

#include "comm/launch.h"

namespace tvsgs {
namespace {

void require(bool holds, const char* what) {
    if (!holds) throw Error(ExitCode::internal, what);
}

void gather_uneven(Communicator& peers) {
    const auto rank = static_cast<std::size_t>(peers.rank());
    for (const std::size_t scale : {std::size_t{0}, std::size_t{1}, std::size_t{1000003}}) {
        // Rank 1 has nothing.
        const auto count_of = [scale](std::size_t r) { return r == 1 ? 0 : scale * (r + 1); };
        std::vector<std::byte> mine(count_of(rank)), all;
        for (std::size_t i = 0; i < mine.size(); ++i)
            mine[i] = static_cast<std::byte>(i * 7 + rank);
        const auto begins = peers.all_gather_v("uneven", mine.data(), mine.size(), all);
        require(begins.size() == static_cast<std::size_t>(peers.size()) + 1, "begins");
        for (std::size_t r = 0; r + 1 < begins.size(); ++r) {
            require(begins[r + 1] - begins[r] == count_of(r), "sizes");
            for (std::size_t i = begins[r]; i < begins[r + 1]; ++i)
                require(all[i] == static_cast<std::byte>((i - begins[r]) * 7 + r), "bytes");
        }
    }
}

void share_and_deal(Communicator& peers) {
    const int ranks = peers.size(), own = peers.rank();
    for (const int count : {1, 70, 1000003}) {
        std::vector<int> values(static_cast<std::size_t>(count), -1);
        const Part part = own_part(&peers, count);
        for (int i = part.begin; i < part.end; ++i) values[static_cast<std::size_t>(i)] = 3 * i;
        share_parts(&peers, "array", Cpu{}, values.data(), count);
        for (int i = 0; i < count; ++i)
            require(values[static_cast<std::size_t>(i)] == 3 * i, "shared");

        // Rank r gets r x count numbers from each.
        Buffer<int, Cpu> parts, got;
        std::vector<int> sent;
        std::vector<std::size_t> begins{0};
        for (int r = 0; r < ranks; ++r) {
            for (int i = 0; i < r * count; ++i) sent.push_back(i + 7 * own + r);
            begins.push_back(sent.size());
        }
        copy(sent, parts);
        const auto came = peers.all_to_all_v("dealt", parts, begins, got);
        require(
            got.size() == static_cast<std::size_t>(ranks * own) * static_cast<std::size_t>(count),
            "dealt sizes");
        for (int r = 0; r < ranks; ++r)
            for (int i = 0; i < own * count; ++i)
                require(got[came[static_cast<std::size_t>(r)] + static_cast<std::size_t>(i)] ==
                            i + 7 * r + own,
                        "dealt");
    }
}

int run(Communicator& peers, bool alone) {
    std::vector<std::int64_t> sum{peers.rank() + 1};
    peers.all_reduce("sum", Communicator::Reduce::sum, sum);
    require(sum[0] == peers.size() * (peers.size() + 1) / 2, "sum");
    require(peers.local_size() == peers.size() && peers.local_rank() == peers.rank(),
            "all are on this machine");
    gather_uneven(peers);
    share_and_deal(peers);
    if (alone) {
        peers.set_limit(1);
        peers.set_iteration(7);
        if (peers.rank() == 1) std::this_thread::sleep_for(std::chrono::seconds(60));
    }
    require(peers.broadcast("text", "hello", 0) == "hello", "text");
    return 0;
}

}  // namespace
}  // namespace tvsgs

int main(int argc, char** argv) {
    using namespace tvsgs;
    std::unique_ptr<Communicator> peers;
    int code = 1;
    try {
        peers = join_by_mpi(read_launch(std::getenv));
        require(peers != nullptr, "started by mpirun as one of several");
        code = run(*peers, argc == 2 && std::strcmp(argv[1], "alone") == 0);
        peers->leave();
    } catch (const Error& error) {
        std::fprintf(stderr, "%s\n", error.what());
        code = static_cast<int>(error.code());
        if (peers) peers->abort(code);
    }
    return code;
}
