// MPI: bytes of the host.
#include <mpi.h>

#include <algorithm>
#include <chrono>
#include <cstring>
#include <thread>

#include "comm/launch.h"

namespace tvsgs {
namespace {

// MPI 3 counts in int.
constexpr std::size_t kMostBytes = std::size_t{1} << 30;

void check(int code, const char* what) {
    if (code == MPI_SUCCESS) return;
    char text[MPI_MAX_ERROR_STRING] = {};
    int length = 0;
    MPI_Error_string(code, text, &length);
    throw Error(ExitCode::peer,
                str(what, ": ", text, "; another process is gone, or cannot be reached"));
}

class MpiCommunicator final : public Communicator {
public:
    MpiCommunicator() {
        MPI_Comm_rank(MPI_COMM_WORLD, &rank_);
        MPI_Comm_size(MPI_COMM_WORLD, &size_);
        MPI_Comm machine;
        check(MPI_Comm_split_type(MPI_COMM_WORLD, MPI_COMM_TYPE_SHARED, 0, MPI_INFO_NULL, &machine),
              "MPI_Comm_split_type");
        MPI_Comm_rank(machine, &local_rank_);
        MPI_Comm_size(machine, &local_size_);
        MPI_Comm_free(&machine);
        MPI_Comm_set_errhandler(MPI_COMM_WORLD, MPI_ERRORS_RETURN);
    }

    int rank() const override { return rank_; }
    int size() const override { return size_; }
    int local_rank() const override { return local_rank_; }
    int local_size() const override { return local_size_; }

    [[noreturn]] void abort(int code) override {
        MPI_Abort(MPI_COMM_WORLD, code);
        std::_Exit(code);
    }

    void leave() override {
        wait_for_all("end");
        MPI_Finalize();
    }

private:
    /// In pieces whose sum fits into an int, each in the order of the ranks.
    void gather(const void* part, const Begins& begins, void* all, bool calm) override {
        const auto ranks = static_cast<std::size_t>(size_);
        const std::size_t most = kMostBytes / ranks;
        std::size_t longest = 0;
        for (std::size_t r = 0; r < ranks; ++r)
            longest = std::max(longest, begins[r + 1] - begins[r]);
        const auto mine =
            begins[static_cast<std::size_t>(rank_) + 1] - begins[static_cast<std::size_t>(rank_)];
        std::vector<std::byte> piece;
        for (std::size_t done = 0; done < longest; done += most) {
            std::vector<int> counts, displacements;
            std::size_t total = 0;
            for (std::size_t r = 0; r < ranks; ++r) {
                const std::size_t bytes = begins[r + 1] - begins[r],
                                  now = std::min(bytes - std::min(bytes, done), most);
                counts.push_back(static_cast<int>(now));
                displacements.push_back(static_cast<int>(total));
                total += now;
            }
            const bool whole = longest <= most;
            if (!whole) piece.resize(total);
            gather_piece(static_cast<const std::byte*>(part) + std::min(done, mine), counts,
                         displacements, whole ? all : piece.data(), calm);
            for (std::size_t r = 0; !whole && r < ranks; ++r)
                std::copy_n(piece.begin() + displacements[r], counts[r],
                            static_cast<std::byte*>(all) + begins[r] + done);
        }
    }

    void gather_piece(const void* part,
                      const std::vector<int>& counts,
                      const std::vector<int>& displacements,
                      void* all,
                      bool calm) {
        MPI_Request request;
        const auto own = static_cast<std::size_t>(rank_);
        const bool in_place = part == static_cast<std::byte*>(all) + displacements[own];
        check(MPI_Iallgatherv(in_place ? MPI_IN_PLACE : part, counts[own], MPI_BYTE, all,
                              counts.data(), displacements.data(), MPI_BYTE, MPI_COMM_WORLD,
                              &request),
              "MPI_Iallgatherv");
        wait({&request, 1}, calm);
    }

    /// In pieces whose length fits into an int; those of a pair arrive in the order they were sent.
    void deal(const void* parts, const Begins& to, void* got, const Begins& from) override {
        const auto own = static_cast<std::size_t>(rank_);
        std::vector<MPI_Request> requests;
        const auto for_pieces = [&](const Begins& begins, const auto& start) {
            for (std::size_t r = 0; r < static_cast<std::size_t>(size_); ++r)
                for (std::size_t at = begins[r]; r != own && at < begins[r + 1]; at += kMostBytes) {
                    const auto bytes = static_cast<int>(std::min(begins[r + 1] - at, kMostBytes));
                    requests.push_back(MPI_REQUEST_NULL);
                    start(at, bytes, static_cast<int>(r), &requests.back());
                }
        };
        for_pieces(from, [&](std::size_t at, int bytes, int rank, MPI_Request* request) {
            check(MPI_Irecv(static_cast<std::byte*>(got) + at, bytes, MPI_BYTE, rank, 0,
                            MPI_COMM_WORLD, request),
                  "MPI_Irecv");
        });
        for_pieces(to, [&](std::size_t at, int bytes, int rank, MPI_Request* request) {
            check(MPI_Isend(static_cast<const std::byte*>(parts) + at, bytes, MPI_BYTE, rank, 0,
                            MPI_COMM_WORLD, request),
                  "MPI_Isend");
        });
        std::copy_n(static_cast<const std::byte*>(parts) + to[own], to[own + 1] - to[own],
                    static_cast<std::byte*>(got) + from[own]);
        wait({requests.data(), requests.size()}, false);
    }

    /// Looks often at first, as most calls are short and data moves only while one looks.
    void wait(Span<MPI_Request> requests, bool calm) {
        using Clock = std::chrono::steady_clock;
        const Clock::time_point begin = Clock::now();
        for (int done = 0;;) {
            check(MPI_Testall(requests.size(), requests.data, &done, MPI_STATUSES_IGNORE),
                  "MPI_Testall");
            if (done) return;
            const double seconds = std::chrono::duration<double>(Clock::now() - begin).count();
            keep_waiting(seconds);
            if (calm && seconds > 0.01)
                std::this_thread::sleep_for(std::chrono::milliseconds(2));
            else if (seconds > 5)
                std::this_thread::sleep_for(std::chrono::microseconds(50));
            else
                std::this_thread::yield();
        }
    }

    int rank_ = 0, size_ = 1, local_rank_ = 0, local_size_ = 1;
};

}  // namespace

bool has_mpi() {
    return true;
}

std::unique_ptr<Communicator> join_by_mpi(const Launch& launch) {
    if (launch.by != Launch::By::mpi || !launch.several()) return nullptr;
    int level = 0;
    MPI_Init_thread(nullptr, nullptr, MPI_THREAD_SERIALIZED, &level);
    int rank = 0, size = 1;
    MPI_Comm_rank(MPI_COMM_WORLD, &rank);
    MPI_Comm_size(MPI_COMM_WORLD, &size);
    if (size != launch.size || rank != launch.rank) {
        char library[MPI_MAX_LIBRARY_VERSION_STRING] = {};
        int length = 0;
        MPI_Get_library_version(library, &length);
        throw Error(ExitCode::usage,
                    str(launch.launcher, " has started process ", launch.rank, " of ", launch.size,
                        ", but MPI says ", rank, " of ", size,
                        "; expected the launcher of the MPI that the program was built with: ",
                        std::string(library).substr(0, std::string(library).find_first_of(",\n"))));
    }
    return std::make_unique<MpiCommunicator>();
}

}  // namespace tvsgs
