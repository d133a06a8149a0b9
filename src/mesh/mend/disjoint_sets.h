// Disjoint sets of numbers, for several threads.
#pragma once

#include <atomic>
#include <numeric>
#include <utility>
#include <vector>

namespace tvsgs {

/// The smallest member represents a set. Threads may unite and find at the same time; the final
/// sets do not depend on the order of the calls.
class DisjointSets {
public:
    explicit DisjointSets(std::size_t count) : parent_(count) {
        std::iota(parent_.begin(), parent_.end(), 0);
    }
    int find(int i) {
        for (;;) {
            const int parent = get(i);
            if (parent == i) return i;
            const int next = get(parent);
            // Both are ancestors of i, whatever other threads have done since.
            if (next != parent) of(i).store(next, std::memory_order_relaxed);
            i = next;
        }
    }
    void unite(int a, int b) {
        for (;;) {
            a = find(a), b = find(b);
            if (a == b) return;
            if (a < b) std::swap(a, b);
            // Only roots get a parent, and only a smaller one.
            if (int root = a; of(a).compare_exchange_strong(root, b, std::memory_order_relaxed))
                return;
        }
    }

private:
    std::atomic_ref<int> of(int i) { return std::atomic_ref(parent_[i]); }
    int get(int i) { return of(i).load(std::memory_order_relaxed); }

    std::vector<int> parent_;
};

}  // namespace tvsgs
