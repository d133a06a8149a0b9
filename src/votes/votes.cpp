// The C interface of tensor voting.  [include/tvsgs_votes.h]
#include <tvsgs_votes.h>

#include <limits>
#include <memory>
#include <mutex>
#include <utility>

#include "core/device/device_choice.h"
#include "core/log.h"
#include "core/version.h"
#include "votes/caller_turn.h"
#include "votes/option_text.h"

namespace tvsgs {
namespace {

static_assert(TVSGS_VOTES_HAS_TENSOR == int(kHasTensor) &&
              TVSGS_VOTES_NORMAL_VALID == int(kNormalValid) &&
              TVSGS_VOTES_POSITION_VALID == int(kPositionValid));

Error wrong_use(const std::string& message) {
    return Error(ExitCode::usage, message);
}

class SplatVotes {
public:
    virtual ~SplatVotes() = default;
    virtual void refresh(const tvsgs_votes_splats& splats,
                         const std::int32_t* parents,
                         void* stream) = 0;
    virtual void vote(const tvsgs_votes_splats& splats, void* stream) = 0;
    virtual void read(const tvsgs_votes_results& results, void* stream) = 0;
};

template <class Device>
class SplatVotesOn final : public SplatVotes {
public:
    SplatVotesOn(const TvOptions& options, int gpu) : voter_(options), gpu_(gpu) {}

    void refresh(const tvsgs_votes_splats& splats,
                 const std::int32_t* parents,
                 void* stream) override {
        check(splats);
        const CallerTurn<Device> turn(gpu_, stream);
        std::vector<int> inherited;
        if (parents != nullptr) inherited = checked_parents(turn, splats.count, parents);
        const std::int64_t before = std::exchange(listed_, -1);
        voted_ = -1;
        if (before < 0 || (parents == nullptr && splats.count != before)) field_ = {};
        copy_in(turn, splats);
        if (parents != nullptr) {
            copy(inherited, parents_);
            voter_.structure_changed(parents_.span(), field_);
        }
        voter_.restore({kStep, false}, gaussians_);
        listed_ = splats.count;
    }

    void vote(const tvsgs_votes_splats& splats, void* stream) override {
        check(splats);
        if (listed_ < 0) throw wrong_use("vote: no splats yet; call refresh first");
        if (splats.count != listed_)
            throw wrong_use(str("vote: ", splats.count, " splats, but the last refresh had ",
                                listed_, "; call refresh after splats were added or removed"));
        const CallerTurn<Device> turn(gpu_, stream);
        // After an error in the middle only a refresh leads on.
        const std::int64_t count = std::exchange(listed_, -1);
        voted_ = -1;
        copy_in(turn, splats);
        voter_.vote(kStep, gaussians_, field_);
        listed_ = voted_ = count;
    }

    void read(const tvsgs_votes_results& results, void* stream) override {
        if (voted_ < 0) throw wrong_use("read: no results; call vote first");
        if (results.count != voted_)
            throw wrong_use(
                str("read: room for ", results.count, " splats, but the last vote had ", voted_));
        const CallerTurn<Device> turn(gpu_, stream);
        const auto copy_out = [&](const auto& from, void* to) {
            if (to != nullptr) turn.copy(from.data(), to, from.size() * sizeof(*from.data()));
        };
        copy_out(field_.normals, results.normals);
        copy_out(field_.targets, results.targets);
        copy_out(field_.eigenvalues, results.eigenvalues);
        copy_out(field_.flags, results.flags);
    }

private:
    /// All events have one step, so that only refresh() searches.
    static constexpr int kStep = 1;

    static void check(const tvsgs_votes_splats& splats) {
        if (splats.count < 0 || splats.count > std::numeric_limits<int>::max())
            throw wrong_use(str(splats.count, " splats; expected 0 to 2147483647"));
        if (splats.count > 0 &&
            (splats.means == nullptr || splats.log_scales == nullptr || splats.quats == nullptr))
            throw wrong_use("means, log_scales or quats is NULL");
    }

    std::vector<int> checked_parents(const CallerTurn<Device>& turn,
                                     std::int64_t count,
                                     const std::int32_t* parents) const {
        std::vector<int> host(count);
        turn.copy(parents, host.data(), host.size() * sizeof(int));
        for (std::size_t i = 0; i < host.size(); ++i)
            if (host[i] < -1 || host[i] >= std::max<std::int64_t>(listed_, 0))
                throw wrong_use(str("refresh: parent ", host[i], " of splat ", i,
                                    "; the last refresh had ", std::max<std::int64_t>(listed_, 0),
                                    " splats, numbered from 0; -1: none"));
        return host;
    }

    void copy_in(const CallerTurn<Device>& turn, const tvsgs_votes_splats& splats) {
        const auto copy_one = [&](const float* from, auto& to) {
            to.resize(splats.count);
            turn.copy(from, to.data(), to.size() * sizeof(*to.data()));
        };
        copy_one(splats.means, gaussians_.means);
        copy_one(splats.log_scales, gaussians_.log_scales);
        copy_one(splats.quats, gaussians_.quats);
    }

    TensorVoter<Device> voter_;
    int gpu_;
    Gaussians<Device> gaussians_;  // the arrays that votes read; the others stay empty
    TensorField<Device> field_;    // empty, or of the splats of the last refresh
    Buffer<int, Device> parents_;
    // Splats of the last refresh and of the last vote; -1: none.
    std::int64_t listed_ = -1, voted_ = -1;
};

thread_local std::string error_without_handle;

/// Runs `action`. No exception leaves it: returns an exit code, and `error` gets the text.
template <class Action>
int guarded(std::string& error, const Action& action) noexcept {
    const auto failed = [&error](ExitCode code, const char* text) {
        try {
            error = text;
        } catch (...) {  // no memory for the text
        }
        return int(code);
    };
    try {
        error.clear();
        action();
        return int(ExitCode::done);
    } catch (const Error& e) {
        return failed(e.code(), e.what());
    } catch (const std::bad_alloc&) {
        return failed(ExitCode::memory, "out of memory");
    } catch (const std::exception& e) {
        return failed(ExitCode::internal, e.what());
    } catch (...) {
        return failed(ExitCode::internal, "unknown error");
    }
}

/// Runs action(votes, *argument) on a handle.
template <class Handle, class Argument, class Action>
int on_handle(Handle* handle, const Argument* argument, const Action& action) noexcept {
    if (handle == nullptr)
        return guarded(error_without_handle,
                       [] { throw wrong_use("the handle of the votes is NULL"); });
    const std::lock_guard lock(handle->mutex);
    return guarded(handle->error, [&] {
        if (argument == nullptr) throw wrong_use("the pointer to the arrays is NULL");
        action(*handle->votes, *argument);
    });
}

}  // namespace
}  // namespace tvsgs

struct tvsgs_votes {
    std::mutex mutex;
    std::string error;
    int gpu = -1;
    std::unique_ptr<tvsgs::SplatVotes> votes;
};

int tvsgs_votes_interface(void) {
    return TVSGS_VOTES_INTERFACE;
}

const char* tvsgs_votes_version(void) {
    return tvsgs::kVersion;
}

int tvsgs_votes_create(const char* device, const char* options, tvsgs_votes** votes) {
    using namespace tvsgs;
    return guarded(error_without_handle, [&] {
        if (votes == nullptr) throw wrong_use("the pointer to the new handle is NULL");
        *votes = nullptr;
        if (device == nullptr) throw wrong_use("the device is NULL; expected a name such as cpu");
        static std::once_flag log_ready;
        std::call_once(log_ready, init_log, Verbosity::normal);  // warnings to standard error
        TvOptions tv = options_from(options == nullptr ? "" : options);
        tv.refresh_every = std::numeric_limits<int>::max();
        const KeptGpu kept;
        const DeviceChoice choice = choose_device(device);
        auto made = std::make_unique<tvsgs_votes>();
        if constexpr (kHasCuda) made->gpu = choice.cuda ? current_gpu() : -1;
        on_device(choice, [&]<class Device>(Device) {
            made->votes = std::make_unique<SplatVotesOn<Device>>(tv, made->gpu);
        });
        *votes = made.release();
    });
}

void tvsgs_votes_destroy(tvsgs_votes* votes) {
    const tvsgs::KeptGpu kept;
    delete votes;
}

int tvsgs_votes_refresh(tvsgs_votes* votes,
                        const tvsgs_votes_splats* splats,
                        const int32_t* parents,
                        void* stream) {
    return tvsgs::on_handle(
        votes, splats, [&](tvsgs::SplatVotes& v, const auto& s) { v.refresh(s, parents, stream); });
}

int tvsgs_votes_vote(tvsgs_votes* votes, const tvsgs_votes_splats* splats, void* stream) {
    return tvsgs::on_handle(votes, splats,
                            [&](tvsgs::SplatVotes& v, const auto& s) { v.vote(s, stream); });
}

int tvsgs_votes_read(tvsgs_votes* votes, const tvsgs_votes_results* results, void* stream) {
    return tvsgs::on_handle(votes, results,
                            [&](tvsgs::SplatVotes& v, const auto& r) { v.read(r, stream); });
}

int tvsgs_votes_gpu(const tvsgs_votes* votes) {
    return votes == nullptr ? -1 : votes->gpu;
}

const char* tvsgs_votes_error(const tvsgs_votes* votes) {
    return votes == nullptr ? tvsgs::error_without_handle.c_str() : votes->error.c_str();
}
