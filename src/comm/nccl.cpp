// NCCL: bytes between GPUs. It adds nothing, as the order of its sums is its own affair.
#include <cuda_runtime_api.h>
#include <nccl.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <condition_variable>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <memory>
#include <mutex>
#include <thread>
#include <utility>

#include "comm/launch.h"
#include "comm/rendezvous.h"

#if NCCL_VERSION_CODE < NCCL_VERSION(2, 18, 0)
#error "NCCL 2.18 or newer is expected, as it was tried; or configure with -DTVSGS_NCCL=OFF"
#endif

namespace tvsgs {
namespace {

constexpr double kMeeting = 120;  // seconds within which all have to be there
constexpr double kEnding = 10;    // and those that NCCL has to end what it does

using Clock = std::chrono::steady_clock;

double seconds_since(Clock::time_point begin) {
    return std::chrono::duration<double>(Clock::now() - begin).count();
}

void check_cuda_call(cudaError_t code, const char* what) {
    if (code != cudaSuccess)
        throw Error(ExitCode::device, str(what, ": ", cudaGetErrorString(code)));
}

[[noreturn]] void fail(ncclResult_t code, const char* what) {
    const bool ours = code == ncclInvalidUsage || code == ncclInvalidArgument;
    throw Error(ours ? ExitCode::device : ExitCode::peer,
                str("NCCL, ", what, ": ", ncclGetErrorString(code), ": ", ncclGetLastError(nullptr),
                    ours ? "; two processes may not share a GPU"
                         : "; another process is gone, or cannot be reached"));
}

/// Multicast through the switches adds as it likes, and was seen to hang; it has to be off before
/// NCCL looks.
void switch_multicast_off() {
    const char* const given = std::getenv("NCCL_NVLS_ENABLE");
    if (given != nullptr && std::strcmp(given, "0") != 0)
        throw Error(ExitCode::usage, str("environment: NCCL_NVLS_ENABLE=", given,
                                         ": expected 0, or that it is not set"));
    ::setenv("NCCL_NVLS_ENABLE", "0", 1);
}

/// Memory of the GPU that grows.
class Staging {
public:
    ~Staging() { cudaFree(data_); }
    Staging() = default;
    Staging(const Staging&) = delete;
    Staging& operator=(const Staging&) = delete;

    std::byte* of(std::size_t bytes) {
        if (bytes > bytes_) {
            cudaFree(data_);
            data_ = nullptr, bytes_ = 0;
            check_cuda_call(cudaMalloc(&data_, bytes), "memory for the exchange of processes");
            bytes_ = bytes;
        }
        return static_cast<std::byte*>(data_);
    }

private:
    void* data_ = nullptr;
    std::size_t bytes_ = 0;
};

/// Looks on while a call of NCCL's may wait for other processes. (Calls that return at once, and
/// could be given up, are handed to a thread of NCCL's each time: three times the time of a small
/// exchange.)
class Watch {
public:
    /// check(seconds) throws an Error when a call has taken too long; give_up(error) ends the
    /// process.
    Watch(std::function<void(double)> check, std::function<void(const Error&)> give_up)
        : check_(std::move(check)), give_up_(std::move(give_up)), thread_([this] { look_on(); }) {}
    ~Watch() {
        {
            const std::lock_guard lock(mutex_);
            over_ = true;
        }
        wake_.notify_one();
        thread_.join();
    }

    template <class Call>
    ncclResult_t operator()(const Call& call) {
        note(Clock::now());
        const struct Over {
            Watch& watch;
            ~Over() { watch.note({}); }
        } over{*this};
        return call();
    }

private:
    void note(Clock::time_point begin) {
        const std::lock_guard lock(mutex_);
        begin_ = begin;
    }

    void look_on() {
        std::unique_lock lock(mutex_);
        while (!over_) {
            wake_.wait_for(lock, std::chrono::milliseconds(100));
            if (begin_ == Clock::time_point{}) continue;
            try {
                check_(seconds_since(begin_));
            } catch (const Error& error) {
                give_up_(error);
            }
        }
    }

    std::function<void(double)> check_;
    std::function<void(const Error&)> give_up_;
    std::mutex mutex_;
    std::condition_variable wake_;
    Clock::time_point begin_{};  // of the call under way; else none
    bool over_ = false;
    std::thread thread_;  // last: it uses the others
};

class NcclCommunicator final : public Communicator {
public:
    NcclCommunicator(const Launch& launch,
                     const CommOptions& options,
                     std::unique_ptr<Communicator> mpi)
        : mpi_(std::move(mpi)), rank_(launch.rank), size_(launch.size) {
        set_limit(kMeeting);
        switch_multicast_off();
        const std::string file = mpi_ ? "" : rendezvous_file(launch, options);
        const ncclUniqueId id = meet(file);
        check_cuda_call(cudaStreamCreateWithFlags(&stream_, cudaStreamNonBlocking), "a stream");
        settle(watch_([&] { return ncclCommInitRank(&comm_, size_, id, rank_); }), "start");
        std::error_code code;
        if (rank_ == 0 && !file.empty()) std::filesystem::remove(file, code);
        find_neighbours();
        set_limit(options.timeout);
    }

    int rank() const override { return rank_; }
    int size() const override { return size_; }
    int local_rank() const override { return local_rank_; }
    int local_size() const override { return local_size_; }

    [[noreturn]] void abort(int code) override {
        // Not waited for: whatever hangs would hang here, too.
        if (mpi_) mpi_->abort(code);
        std::_Exit(code);
    }

    void leave() override {
        wait_for_all("end");
        settle(watch_([&] { return ncclCommFinalize(comm_); }), "end");
        ncclCommDestroy(comm_);
        if (mpi_) mpi_->leave();
    }

private:
    /// The id by which all find each other: by MPI, or by a file.
    ncclUniqueId meet(const std::string& file) {
        ncclUniqueId id{};
        if (rank_ == 0)
            if (const ncclResult_t code = ncclGetUniqueId(&id); code != ncclSuccess)
                fail(code, "start");
        if (mpi_) {
            mpi_->broadcast("NCCL's id", &id, sizeof id, 0);
        } else if (rank_ == 0) {
            publish(file, {id.internal, sizeof id.internal});
        } else {
            const std::string text = await_text(file, sizeof id.internal, [&](double seconds) {
                if (seconds > kMeeting)
                    throw Error(ExitCode::peer,
                                str("rank ", rank_, " of ", size_, " has waited ", kMeeting,
                                    " s for rank 0, which writes ", file,
                                    "; expected it to run, and both to see that file "
                                    "(comm.rendezvous)"));
            });
            std::memcpy(id.internal, text.data(), text.size());
        }
        return id;
    }

    void find_neighbours() {
        char name[64] = {};
        ::gethostname(name, sizeof name - 1);
        std::vector<std::byte> all;
        all_gather_v("hosts", name, sizeof name, all);
        local_size_ = 0;
        for (int r = 0; r < size_; ++r) {
            const bool here = std::memcmp(all.data() + static_cast<std::size_t>(r) * sizeof name,
                                          name, sizeof name) == 0;
            local_size_ += here;
            if (here && r < rank_) ++local_rank_;
        }
    }

    void gather(const void* part, const Begins& begins, void* all, bool calm) override {
        const auto own = static_cast<std::size_t>(rank_);
        const std::size_t bytes = begins[own + 1] - begins[own];
        std::byte* const to = staging_.of(begins.back());
        // In its place already.
        check_cuda_call(
            cudaMemcpyAsync(to + begins[own], part, bytes, cudaMemcpyHostToDevice, stream_),
            "exchange");
        exchange({{to + begins[own], begins, to}}, calm, [] {});
        check_cuda_call(cudaMemcpy(all, to, begins.back(), cudaMemcpyDeviceToHost), "exchange");
    }

    bool reaches_gpu() const override { return true; }
    void gather_on_gpu(const std::vector<Gather>& gathers,
                       const std::function<void()>& meanwhile) override {
        synchronize(Cuda{});  // what makes the parts runs on another stream
        const auto own = static_cast<std::size_t>(rank_);
        for (const Gather& g : gathers)
            if (std::byte* const place = static_cast<std::byte*>(g.all) + g.begins[own];
                place != g.part)
                check_cuda_call(cudaMemcpyAsync(place, g.part, g.begins[own + 1] - g.begins[own],
                                                cudaMemcpyDeviceToDevice, stream_),
                                "exchange");
        exchange(gathers, false, meanwhile);
    }

    void deal(const void* parts, const Begins& to, void* got, const Begins& from) override {
        // One piece of memory for both, each part as aligned as it was.
        const std::size_t sent = (to.back() + 255) / 256 * 256;
        std::byte* const at = staging_.of(sent + from.back());
        check_cuda_call(cudaMemcpy(at, parts, to.back(), cudaMemcpyHostToDevice), "exchange");
        deal_on_gpu(at, to, at + sent, from);
        check_cuda_call(cudaMemcpy(got, at + sent, from.back(), cudaMemcpyDeviceToHost),
                        "exchange");
    }
    void deal_on_gpu(const void* parts, const Begins& to, void* got, const Begins& from) override {
        synchronize(Cuda{});  // what makes the parts runs on another stream
        ncclGroupStart();
        for (int r = 0; r < size_; ++r) {  // to itself, too
            const auto at = static_cast<std::size_t>(r);
            if (const std::size_t bytes = to[at + 1] - to[at]; bytes > 0)
                ncclSend(static_cast<const std::byte*>(parts) + to[at], bytes, ncclInt8, r, comm_,
                         stream_);
            if (const std::size_t bytes = from[at + 1] - from[at]; bytes > 0)
                ncclRecv(static_cast<std::byte*>(got) + from[at], bytes, ncclInt8, r, comm_,
                         stream_);
        }
        finish_group(false);
    }

    /// Everybody's parts to everybody else.
    void exchange(const std::vector<Gather>& gathers,
                  bool calm,
                  const std::function<void()>& meanwhile) {
        ncclGroupStart();
        for (const Gather& g : gathers)
            for (int r = 0; r < size_; ++r) {
                const auto at = static_cast<std::size_t>(r), own = static_cast<std::size_t>(rank_);
                if (r == rank_) continue;
                if (const std::size_t mine = g.begins[own + 1] - g.begins[own]; mine > 0)
                    ncclSend(g.part, mine, ncclInt8, r, comm_, stream_);
                if (const std::size_t theirs = g.begins[at + 1] - g.begins[at]; theirs > 0)
                    ncclRecv(static_cast<std::byte*>(g.all) + g.begins[at], theirs, ncclInt8, r,
                             comm_, stream_);
            }
        finish_group(calm, meanwhile);
    }

    /// Ends a group of calls and waits until their bytes are there.
    void finish_group(
        bool calm, const std::function<void()>& meanwhile = [] {}) {
        guarded([&] {
            settle(watch_([] { return ncclGroupEnd(); }), "exchange");
            // Watched, as work for the device may wait for what it has been given before.
            watch_([&] {
                meanwhile();
                return ncclSuccess;
            });
        });
        wait(
            [&] {
                const cudaError_t code = cudaStreamQuery(stream_);
                if (code != cudaErrorNotReady) check_cuda_call(code, "exchange");
                return code == cudaSuccess;
            },
            calm);
    }

    static void settle(ncclResult_t code, const char* what) {
        if (code != ncclSuccess) fail(code, what);
    }

    template <class Done>
    void wait(const Done& done, bool calm) {
        const Clock::time_point begin = Clock::now();
        guarded([&] {
            while (!done()) {
                ncclResult_t state = ncclSuccess;
                ncclCommGetAsyncError(comm_, &state);
                settle(state, "exchange");
                keep_waiting(seconds_since(begin));
                if (seconds_since(begin) > 0.01)
                    std::this_thread::sleep_for(std::chrono::microseconds(calm ? 2000 : 50));
                else
                    std::this_thread::yield();
            }
        });
    }

    /// What is under way is given up before an Error goes on.
    template <class Run>
    void guarded(const Run& run) {
        try {
            run();
        } catch (const Error& error) {
            if (!give_up()) end_with(error);
            throw;
        }
    }

    /// A kernel that waits for a peer in vain holds the GPU, and whoever frees memory there waits
    /// for it; so it is ended before anything is cleaned up. False: it does not end, and nothing
    /// can be cleaned up. By a thread, as NCCL may wait for the peer there, too.
    bool give_up() {
        const auto ended = std::make_shared<std::atomic<bool>>(false);
        std::thread([ended, comm = std::exchange(comm_, nullptr)] {
            ncclCommAbort(comm);
            *ended = true;
        }).detach();
        for (const Clock::time_point begin = Clock::now(); !*ended;) {
            if (seconds_since(begin) > kEnding) return false;
            std::this_thread::sleep_for(std::chrono::milliseconds(10));
        }
        return true;
    }

    [[noreturn]] void end_with(const Error& error) {
        std::fprintf(stderr, "error: %s\n", error.what());
        abort(static_cast<int>(error.code()));
    }

    std::unique_ptr<Communicator> mpi_;  // null: by the environment
    int rank_, size_, local_rank_ = 0, local_size_ = 1;
    ncclComm_t comm_ = nullptr;
    cudaStream_t stream_ = nullptr;
    Staging staging_;
    Watch watch_{[this](double seconds) { keep_waiting(seconds); },
                 [this](const Error& error) { end_with(error); }};
};

}  // namespace

bool has_nccl() {
    return true;
}

std::unique_ptr<Communicator> join_by_nccl(const Launch& launch,
                                           const CommOptions& options,
                                           std::unique_ptr<Communicator> mpi) {
    return std::make_unique<NcclCommunicator>(launch, options, std::move(mpi));
}

}  // namespace tvsgs
