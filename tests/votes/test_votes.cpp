// The C interface of votes, compared with TensorVoter bit by bit, and its errors.
#include <tvsgs_votes.h>

#include <numeric>
#include <thread>

#include "votes/votes_case.h"

namespace tvsgs::test {
namespace {

template <class Device>
class VotesInterface : public ::testing::Test {};
TYPED_TEST_SUITE(VotesInterface, Devices);

using Handle = std::unique_ptr<tvsgs_votes, decltype(&tvsgs_votes_destroy)>;

template <class Device>
Handle create(const char* options = "k=20") {
    tvsgs_votes* votes = nullptr;
    const int code =
        tvsgs_votes_create(std::is_same_v<Device, Cuda> ? "cuda" : "cpu", options, &votes);
    EXPECT_EQ(code, 0) << tvsgs_votes_error(nullptr);
    return {votes, tvsgs_votes_destroy};
}

tvsgs_votes_splats pointers_to(const auto& g) {
    const auto floats = [](const auto& values) {
        return reinterpret_cast<const float*>(values.data());
    };
    return {g.size(), floats(g.means), floats(g.log_scales), floats(g.quats)};
}

FieldOnHost results_of(tvsgs_votes* votes, std::size_t count) {
    FieldOnHost field;
    field.normals.resize(count), field.targets.resize(count);
    field.eigenvalues.resize(count), field.flags.resize(count);
    const auto floats = [](auto& values) { return reinterpret_cast<float*>(values.data()); };
    const tvsgs_votes_results to{std::int64_t(count), floats(field.normals), floats(field.targets),
                                 floats(field.eigenvalues), field.flags.data()};
    EXPECT_EQ(tvsgs_votes_read(votes, &to, nullptr), 0) << tvsgs_votes_error(votes);
    return field;
}

template <class T>
bool same_bytes(const std::vector<T>& a, const std::vector<T>& b) {
    return a.size() == b.size() &&
           (a.empty() || std::memcmp(a.data(), b.data(), a.size() * sizeof(T)) == 0);
}

void expect_same(const FieldOnHost& found, const FieldOnHost& expected) {
    EXPECT_TRUE(same_bytes(found.normals, expected.normals));
    EXPECT_TRUE(same_bytes(found.targets, expected.targets));
    EXPECT_TRUE(same_bytes(found.eigenvalues, expected.eigenvalues));
    EXPECT_EQ(found.flags, expected.flags);
}

TYPED_TEST(VotesInterface, HasTheBitsOfTheVoter) {
    TVSGS_SKIP_WITHOUT_DEVICE(TypeParam);
    const std::vector<VotesEvent> events = votes_events();
    const std::vector<FieldOnHost> expected = votes_results<TypeParam>(events);
    EXPECT_EQ(expected[1].flags[10] & (kNormalValid | kPositionValid), 0);
    EXPECT_GT(std::count(expected[4].flags.begin(), expected[4].flags.end(), 7), 200);
    const Handle votes = create<TypeParam>();
    EXPECT_EQ(tvsgs_votes_gpu(votes.get()), (std::is_same_v<TypeParam, Cuda> ? 0 : -1));
    for (std::size_t i = 0; i < events.size(); ++i) {
        SCOPED_TRACE(i);
        const auto on_device = to_gaussians<TypeParam>(events[i].splats);
        const auto on_host = to_gaussians<Cpu>(events[i].splats);
        // Both kinds of memory, where there are two.
        const tvsgs_votes_splats splats =
            i % 2 == 0 ? pointers_to(on_device) : pointers_to(on_host);
        const std::vector<int>& parents = events[i].parents;
        if (events[i].refresh) {
            ASSERT_EQ(tvsgs_votes_refresh(votes.get(), &splats,
                                          parents.empty() ? nullptr : parents.data(), nullptr),
                      0)
                << tvsgs_votes_error(votes.get());
        }
        ASSERT_EQ(tvsgs_votes_vote(votes.get(), &splats, nullptr), 0)
            << tvsgs_votes_error(votes.get());
        expect_same(results_of(votes.get(), std::size_t(splats.count)), expected[i]);
    }
}

// Its vote was with fewer splats than the parents name.
TYPED_TEST(VotesInterface, InheritsNothingFromARefreshWithoutVote) {
    TVSGS_SKIP_WITHOUT_DEVICE(TypeParam);
    const auto few = to_gaussians<TypeParam>(sphere(50, 5, 0.03f));
    const auto many = to_gaussians<TypeParam>(sphere(4000, 6, 0.03f));
    const Handle votes = create<TypeParam>(), fresh = create<TypeParam>();
    const tvsgs_votes_splats first = pointers_to(few), splats = pointers_to(many);
    ASSERT_EQ(tvsgs_votes_refresh(votes.get(), &first, nullptr, nullptr), 0);
    ASSERT_EQ(tvsgs_votes_vote(votes.get(), &first, nullptr), 0);
    std::vector<int> parents(4000);
    std::iota(parents.begin(), parents.end(), 0);
    ASSERT_EQ(tvsgs_votes_refresh(votes.get(), &splats, nullptr, nullptr), 0);
    for (const Handle* handle : {&votes, &fresh}) {
        const int* const of = handle == &votes ? parents.data() : nullptr;
        ASSERT_EQ(tvsgs_votes_refresh(handle->get(), &splats, of, nullptr), 0);
        ASSERT_EQ(tvsgs_votes_vote(handle->get(), &splats, nullptr), 0);
    }
    expect_same(results_of(votes.get(), 4000), results_of(fresh.get(), 4000));
}

TYPED_TEST(VotesInterface, TakesTheOptions) {
    TVSGS_SKIP_WITHOUT_DEVICE(TypeParam);
    const auto g = to_gaussians<TypeParam>(sphere(200, 5, 0.03f));
    TvOptions options = options_with(12);
    options.targets = Targets::anchor;
    options.whiten = false;
    options.virtual_range = 0.5f;
    TensorVoter<TypeParam> voter(options);
    TensorField<TypeParam> field;
    voter.vote(1, g, field);
    const Handle votes = create<TypeParam>(" k=12  whiten=false targets=anchor virtual_range=0.5");
    const tvsgs_votes_splats splats = pointers_to(g);
    ASSERT_EQ(tvsgs_votes_refresh(votes.get(), &splats, nullptr, nullptr), 0);
    ASSERT_EQ(tvsgs_votes_vote(votes.get(), &splats, nullptr), 0);
    expect_same(results_of(votes.get(), 200), read(field, voter));
}

void expect_error(int code, const tvsgs_votes* votes, const std::string& text) {
    EXPECT_EQ(code, 2) << text;
    EXPECT_NE(std::string(tvsgs_votes_error(votes)).find(text), std::string::npos)
        << tvsgs_votes_error(votes);
}

TYPED_TEST(VotesInterface, NamesErrorsAndGoesOn) {
    TVSGS_SKIP_WITHOUT_DEVICE(TypeParam);
    const auto g = to_gaussians<Cpu>(sphere(50, 5, 0.03f));
    tvsgs_votes_splats splats = pointers_to(g);
    tvsgs_votes_results results{50, nullptr, nullptr, nullptr, nullptr};
    const Handle handle = create<TypeParam>();
    tvsgs_votes* const votes = handle.get();
    expect_error(tvsgs_votes_vote(votes, &splats, nullptr), votes, "call refresh first");
    expect_error(tvsgs_votes_read(votes, &results, nullptr), votes, "call vote first");
    expect_error(tvsgs_votes_refresh(votes, nullptr, nullptr, nullptr), votes, "NULL");
    splats.count = -1;
    expect_error(tvsgs_votes_refresh(votes, &splats, nullptr, nullptr), votes, "-1 splats");
    splats.count = std::int64_t(1) << 31;
    expect_error(tvsgs_votes_refresh(votes, &splats, nullptr, nullptr), votes, "2147483648");
    splats = pointers_to(g);
    splats.quats = nullptr;
    expect_error(tvsgs_votes_refresh(votes, &splats, nullptr, nullptr), votes, "quats is NULL");
    splats = pointers_to(g);
    std::vector<int> parents(50, -1);
    EXPECT_EQ(tvsgs_votes_refresh(votes, &splats, parents.data(), nullptr), 0);
    parents[7] = 50;
    expect_error(tvsgs_votes_refresh(votes, &splats, parents.data(), nullptr), votes,
                 "parent 50 of splat 7");
    parents[7] = -2;
    expect_error(tvsgs_votes_refresh(votes, &splats, parents.data(), nullptr), votes, "parent -2");

    // The handle keeps its splats after these errors.
    EXPECT_EQ(tvsgs_votes_vote(votes, &splats, nullptr), 0) << tvsgs_votes_error(votes);
    EXPECT_STREQ(tvsgs_votes_error(votes), "");
    splats.count = 49;
    expect_error(tvsgs_votes_vote(votes, &splats, nullptr), votes, "49 splats, but the last");
    results.count = 51;
    expect_error(tvsgs_votes_read(votes, &results, nullptr), votes, "room for 51 splats");
    results.count = 50;
    EXPECT_EQ(tvsgs_votes_read(votes, &results, nullptr), 0);
    splats.count = 50;
    EXPECT_EQ(tvsgs_votes_refresh(votes, &splats, nullptr, nullptr), 0);
    expect_error(tvsgs_votes_read(votes, &results, nullptr), votes, "call vote first");
}

TEST(VotesWithoutHandle, NameTheirErrors) {
    tvsgs_votes* votes = nullptr;
    const auto fails = [&](const char* device, const char* options, const char* text) {
        int mark = 0;
        votes = reinterpret_cast<tvsgs_votes*>(&mark);
        expect_error(tvsgs_votes_create(device, options, &votes), nullptr, text);
        EXPECT_EQ(votes, nullptr) << text;
    };
    fails("cpu", "kk=20", "option 'kk': unknown; did you mean 'k'?");
    fails("cpu", "refresh_every=5", "option 'refresh_every': unknown");
    fails("cpu", "k", "option 'k': ''; expected a number, 1 to 512");
    for (const char* value : {"k=0", "k=513", "k=nan", "k=2.5", "k=2x", "k=", "k=99999999999"})
        fails("cpu", value, "expected a number, 1 to 512");
    fails("cpu", "virtual_range=nan", "option 'virtual_range': 'nan'");
    fails("cpu", "whiten=maybe", "expected false or true");
    fails("cpu", "targets=best", "expected votes or anchor");
    fails("tpu", "", "expected auto, cpu, cuda or cuda:N");
    fails(nullptr, nullptr, "device is NULL");
    expect_error(tvsgs_votes_create("cpu", "", nullptr), nullptr, "new handle is NULL");

    const tvsgs_votes_splats splats{};
    const tvsgs_votes_results results{};
    expect_error(tvsgs_votes_refresh(nullptr, &splats, nullptr, nullptr), nullptr, "is NULL");
    expect_error(tvsgs_votes_vote(nullptr, &splats, nullptr), nullptr, "is NULL");
    expect_error(tvsgs_votes_read(nullptr, &results, nullptr), nullptr, "is NULL");
    std::thread([] { EXPECT_STREQ(tvsgs_votes_error(nullptr), ""); }).join();
    tvsgs_votes_destroy(nullptr);
    if (!kHasCuda) {
        EXPECT_EQ(tvsgs_votes_create("cuda", nullptr, &votes), 5);
    }
    EXPECT_EQ(tvsgs_votes_create("auto", nullptr, &votes), 0);
    tvsgs_votes_destroy(votes);
    EXPECT_EQ(tvsgs_votes_interface(), TVSGS_VOTES_INTERFACE);
}

}  // namespace
}  // namespace tvsgs::test
