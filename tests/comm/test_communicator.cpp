// What all backends have in common, on threads.
#include <gtest/gtest.h>

#include <cstring>
#include <numeric>

#include "support/thread_ranks.h"

namespace tvsgs {
namespace {

using test::on_ranks;
using test::ThreadRank;

TEST(Communicator, PartsComeInTheOrderOfTheRanks) {
    for (const int size : {2, 3, 4})
        on_ranks(size, [size](ThreadRank* peers) {
            // Rank 1 has nothing to say, the others each as many numbers as their rank says.
            const int mine = peers->rank() == 1 ? 0 : peers->rank() + 1;
            Buffer<float, Cpu> part, all;
            copy(std::vector<float>(static_cast<std::size_t>(mine),
                                    0.5f + static_cast<float>(peers->rank())),
                 part);
            const auto begins = peers->all_gather_v("parts", part, part.size(), all);
            ASSERT_EQ(begins.size(), static_cast<std::size_t>(size) + 1);
            for (int r = 0; r < size; ++r) {
                const std::size_t begin = begins[static_cast<std::size_t>(r)],
                                  end = begins[static_cast<std::size_t>(r) + 1];
                EXPECT_EQ(end - begin, r == 1 ? 0u : static_cast<std::size_t>(r) + 1);
                for (std::size_t i = begin; i < end; ++i)
                    EXPECT_EQ(all[i], 0.5f + static_cast<float>(r));
            }
            part.resize(0);
            EXPECT_EQ(peers->all_gather_v("nothing", part, 0, all).back(), 0u);
            EXPECT_TRUE(all.empty());
        });
}

TEST(Parts, AreWholeGrainsInOrder) {
    for (const int count : {0, 1, 31, 32, 33, 100, 1000, 4097})
        for (const int ranks : {1, 2, 3, 4, 7}) {
            int end = 0, most = 0, least = count;
            for (int r = 0; r < ranks; ++r) {
                const Part part = part_of(count, r, ranks);
                EXPECT_EQ(part.begin, end);
                EXPECT_TRUE(part.begin % kPartGrain == 0 || part.size() == 0);
                end = part.end;
                most = std::max(most, part.size()), least = std::min(least, part.size());
            }
            EXPECT_EQ(end, count);
            EXPECT_LE(most - least, 2 * kPartGrain - 1);
        }
    EXPECT_EQ(part_of(40000000, 2, 4).begin, 20000000);
}

TEST(Communicator, EachSharesItsPartOfAnArray) {
    for (const int size : {2, 3, 4})
        for (const int count : {1, 40, 130, 1000})
            on_ranks(size, [&](ThreadRank* peers) {
                constexpr int kPlanes = 3;
                const auto expected = [](int i) { return 1.5f * static_cast<float>(i); };
                std::vector<float> values(static_cast<std::size_t>(kPlanes * count), -1);
                const Part own = own_part(peers, count);
                for (int p = 0; p < kPlanes; ++p)
                    for (int i = own.begin; i < own.end; ++i)
                        values[static_cast<std::size_t>(p * count + i)] = expected(p * count + i);
                share_parts(
                    peers, "array", Cpu{},
                    std::vector<Communicator::Planes>{{values.data(), sizeof(float), kPlanes}},
                    count);
                for (int i = 0; i < kPlanes * count; ++i)
                    ASSERT_EQ(values[static_cast<std::size_t>(i)], expected(i)) << count;
            });
    on_ranks(2, [](ThreadRank* peers) {  // which of them is wrong, nobody knows
        std::vector<int> values(200);
        EXPECT_THROW(
            share_parts(peers, "array", Cpu{}, values.data(), peers->rank() == 0 ? 200 : 100),
            Error);
    });
}

TEST(Communicator, OtherWorkIsDoneOnceMeanwhile) {
    for (const int size : {1, 2, 3})
        for (const int count : {0, 100})
            on_ranks(size, [&](ThreadRank* peers) {
                std::vector<int> values(static_cast<std::size_t>(count), rank_of(peers));
                int done = 0;
                share_parts(peers, "array", Cpu{},
                            std::vector<Communicator::Planes>{{values.data(), sizeof(int)}}, count,
                            [&] { ++done; });
                EXPECT_EQ(done, 1);
                if (count > 0) {
                    EXPECT_EQ(values.back(), size - 1);
                }
            });
}

TEST(Communicator, WhatAllKnowIsDealtWithoutAWord) {
    on_ranks(3, [](ThreadRank* peers) {
        const int own = peers->rank();
        SentCounts counts;
        for (int r = 0; r < 3; ++r) counts.push_back({r, r + 1, r + 2});
        std::vector<int> sent;
        std::vector<std::size_t> to{0};
        for (int o = 0; o < 3; ++o) {
            sent.insert(sent.end(), static_cast<std::size_t>(2 * (own + o)), 10 * own + o);
            to.push_back(sent.size());
        }
        Buffer<int, Cpu> parts, got;
        copy(sent, parts);
        const std::vector<std::size_t> from = received_begins(counts, own, 2);
        peers->deal_known("known", parts, to, got, from);
        EXPECT_EQ(peers->gathers, 0);
        ASSERT_EQ(got.size(), static_cast<std::size_t>(2 * (3 + 3 * own)));
        for (std::size_t r = 0; r < 3; ++r)
            for (std::size_t i = from[r]; i < from[r + 1]; ++i)
                EXPECT_EQ(got[i], 10 * static_cast<int>(r) + own);
        EXPECT_EQ(most_of_a_rank(counts), 9);
    });
}

TEST(Communicator, SeveralArraysAreSharedInOneCall) {
    on_ranks(3, [](ThreadRank* peers) {
        constexpr int kCount = 100;
        std::vector<double> doubles(kCount, -1);
        std::vector<std::int16_t> shorts(2 * kCount, -1);
        const Part own = own_part(peers, kCount);
        for (int i = own.begin; i < own.end; ++i) {
            doubles[static_cast<std::size_t>(i)] = 0.5 * i;
            for (int p = 0; p < 2; ++p)
                shorts[static_cast<std::size_t>(p * kCount + i)] =
                    static_cast<std::int16_t>(1000 * p + i);
        }
        share_parts(peers, "arrays", Cpu{},
                    {{doubles.data(), sizeof(double)}, {shorts.data(), sizeof(std::int16_t), 2}},
                    kCount);
        for (int i = 0; i < kCount; ++i) {
            ASSERT_EQ(doubles[static_cast<std::size_t>(i)], 0.5 * i);
            for (int p = 0; p < 2; ++p)
                ASSERT_EQ(shorts[static_cast<std::size_t>(p * kCount + i)], 1000 * p + i);
        }
        EXPECT_EQ(peers->gathers, 1 + 3) << "what is said before, and each plane";
    });
}

TEST(Communicator, ShortPartsComeWithWhatIsSaidBefore) {
    constexpr std::size_t kShort = 208;
    for (const std::size_t first : {std::size_t{0}, std::size_t{1}, kShort, kShort + 1})
        for (const std::size_t second : {std::size_t{0}, kShort - 1, kShort, std::size_t{5000}})
            on_ranks(2, [&](ThreadRank* peers) {
                const auto byte = [](std::size_t rank, std::size_t i) {
                    return static_cast<std::byte>(rank * 100 + i % 97);
                };
                const std::size_t counts[] = {first, second};
                const auto rank = static_cast<std::size_t>(peers->rank());
                std::vector<std::byte> mine, all;
                for (std::size_t i = 0; i < counts[rank]; ++i) mine.push_back(byte(rank, i));
                const auto begins = peers->all_gather_v("parts", mine.data(), mine.size(), all);
                EXPECT_EQ(peers->gathers, first > kShort || second > kShort ? 2 : 1);
                ASSERT_EQ(all.size(), first + second);
                for (std::size_t r = 0; r < 2; ++r)
                    for (std::size_t i = 0; i < counts[r]; ++i)
                        ASSERT_EQ(all[begins[r] + i], byte(r, i)) << first << " " << second;
            });
}

TEST(Communicator, EachSendsEachItsOwn) {
    for (const int size : {2, 3, 4})
        on_ranks(size, [size](ThreadRank* peers) {
            // For rank r as many numbers as the ranks' product says, none for the next one.
            const auto count = [size](int from, int to) {
                return to == (from + 1) % size ? 0 : 1 + from * to;
            };
            const int own = peers->rank();
            std::vector<int> sent;
            std::vector<std::size_t> begins{0};
            for (int to = 0; to < size; ++to) {
                for (int i = 0; i < count(own, to); ++i) sent.push_back(100 * own + 10 * to + i);
                begins.push_back(sent.size());
            }
            Buffer<int, Cpu> parts, got;
            copy(sent, parts);
            const auto came = peers->all_to_all_v("own", parts, begins, got);
            ASSERT_EQ(came.size(), static_cast<std::size_t>(size) + 1);
            for (int from = 0; from < size; ++from) {
                const std::size_t begin = came[static_cast<std::size_t>(from)];
                ASSERT_EQ(came[static_cast<std::size_t>(from) + 1] - begin,
                          static_cast<std::size_t>(count(from, own)));
                for (int i = 0; i < count(from, own); ++i)
                    EXPECT_EQ(got[begin + static_cast<std::size_t>(i)], 100 * from + 10 * own + i);
            }
        });
}

TEST(Communicator, BroadcastsAndReduces) {
    on_ranks(3, [](ThreadRank* peers) {
        const int rank = peers->rank();
        int number = 10 * rank;
        peers->broadcast("number", &number, sizeof number, 2);
        EXPECT_EQ(number, 20);
        EXPECT_EQ(peers->broadcast("text", rank == 1 ? "one" : "another", 1), "one");
        EXPECT_EQ(peers->broadcast("text", std::string(), 0), "");
        const std::int64_t large = std::int64_t{1} << 60;
        using enum Communicator::Reduce;
        std::vector<std::int64_t> values{rank, -rank, large};
        auto sums = values, least = values, most = values;
        peers->all_reduce("sum", sum, sums);
        peers->all_reduce("min", min, least);
        peers->all_reduce("max", max, most);
        EXPECT_EQ(sums, (std::vector<std::int64_t>{3, -3, 3 * large}));
        EXPECT_EQ(least, (std::vector<std::int64_t>{0, -2, large}));
        EXPECT_EQ(most, (std::vector<std::int64_t>{2, 0, large}));
        Buffer<int, Cpu> counts;
        copy(std::vector<int>{1, rank}, counts);
        sum_over_ranks(peers, "counts", counts);
        EXPECT_EQ(to_host(counts), (std::vector<int>{3, 3}));
    });
    Buffer<int, Cpu> alone;
    copy(std::vector<int>{7}, alone);
    sum_over_ranks(nullptr, "counts", alone);
    EXPECT_EQ(alone[0], 7);
}

TEST(Communicator, RanksThatDoNotDoTheSameAreFoundOut) {
    on_ranks(2, [](ThreadRank* peers) {
        try {
            int number = 1;
            if (peers->rank() == 0)
                peers->broadcast("number", &number, sizeof number, 0);
            else
                peers->wait_for_all("end");
            ADD_FAILURE();
        } catch (const Error& error) {
            EXPECT_EQ(error.code(), ExitCode::peer);
            EXPECT_NE(std::string(error.what()).find("number"), std::string::npos);
            EXPECT_NE(std::string(error.what()).find("end"), std::string::npos);
        }
    });
}

/// A backend whose peers never come.
class Lonely final : public Communicator {
public:
    int rank() const override { return 1; }
    int size() const override { return 2; }
    int local_rank() const override { return 1; }
    int local_size() const override { return 2; }
    [[noreturn]] void abort(int code) override { std::_Exit(code); }
    void leave() override {}

    double waited = 0;

private:
    void gather(const void* part, const Begins& begins, void* all, bool) override {
        for (waited = 0; waited < 1000; waited += 0.5) keep_waiting(waited);
        for (std::size_t r = 0; r < 2; ++r)  // late, but the same
            std::memcpy(static_cast<char*>(all) + begins[r], part, begins[r + 1] - begins[r]);
    }
    void deal(const void*, const Begins&, void*, const Begins&) override {}
};

std::string why_it_ends(Lonely& peers) {
    try {
        std::vector<std::byte> all;
        peers.all_gather_v("gradients", nullptr, 0, all);
    } catch (const Error& error) {
        EXPECT_EQ(error.code(), ExitCode::peer);
        return error.what();
    }
    return "";
}

TEST(Communicator, WaitingEnds) {
    Lonely peers;
    peers.set_limit(30);
    peers.set_iteration(4711);
    const std::string limit = why_it_ends(peers);
    EXPECT_NEAR(peers.waited, 30, 1);
    for (const char* part : {"rank 1 of 2", "30 s", "gradients", "4711", "--resume"})
        EXPECT_NE(limit.find(part), std::string::npos) << limit;
    // Asked to end after 5 s.
    peers.set_asked_to_end([&] { return peers.waited >= 5; });
    EXPECT_NE(why_it_ends(peers).find("asked to end"), std::string::npos);
    EXPECT_NEAR(peers.waited, 15, 1);
    // For one that works alone, as long as it takes.
    peers.wait_for_all("evaluation");
    EXPECT_GE(peers.waited, 1000);
}

}  // namespace
}  // namespace tvsgs
