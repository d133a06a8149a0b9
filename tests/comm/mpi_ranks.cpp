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

int run(Communicator& peers, bool alone) {
    std::vector<std::int64_t> sum{peers.rank() + 1};
    peers.all_reduce("sum", Communicator::Reduce::sum, sum);
    require(sum[0] == peers.size() * (peers.size() + 1) / 2, "sum");
    require(peers.local_size() == peers.size() && peers.local_rank() == peers.rank(),
            "all are on this machine");
    gather_uneven(peers);
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
