// Arithmetic on several packs side by side. In a long formula each step waits for the step before;
// interleaving several packs fills these waits.
#pragma once

#include "core/math/pack.h"

namespace tvsgs {

#if defined(__CUDACC__)
template <class Lane, int kCount>
struct Abreast;  // CPU only
#else
template <class Lane, int kCount>
struct Abreast {
    static constexpr int kSize = kCount * Lane::kSize;
    Lane v[kCount];
    struct Mask {
        typename Lane::Mask m[kCount];
        friend Mask both(const Mask& a, const Mask& b) {
            return each_mask([&](int i) { return both(a.m[i], b.m[i]); });
        }
        friend bool all(const Mask& a) {
            bool are = true;
            for (const auto& mask : a.m) are = are && all(mask);
            return are;
        }
    };

    Abreast() = default;
    explicit Abreast(const Lane& x) {
        for (Lane& lane : v) lane = x;
    }
    template <class U>
    requires std::is_arithmetic_v<U> Abreast(U x) : Abreast(Lane(x)) {}

    auto operator[](int i) const { return v[i / Lane::kSize][i % Lane::kSize]; }
    template <class T>
    void set(int i, T x) {
        v[i / Lane::kSize].set(i % Lane::kSize, x);
    }

    /// Packs operation(0), operation(1), ...
    template <class Operation>
    static Abreast each(const Operation& operation) {
        Abreast out;
        for (int i = 0; i < kCount; ++i) out.v[i] = operation(i);
        return out;
    }
    template <class Operation>
    static Mask each_mask(const Operation& operation) {
        Mask out;
        for (int i = 0; i < kCount; ++i) out.m[i] = operation(i);
        return out;
    }

    friend Abreast operator+(const Abreast& a, const Abreast& b) {
        return each([&](int i) { return a.v[i] + b.v[i]; });
    }
    friend Abreast operator-(const Abreast& a, const Abreast& b) {
        return each([&](int i) { return a.v[i] - b.v[i]; });
    }
    friend Abreast operator*(const Abreast& a, const Abreast& b) {
        return each([&](int i) { return a.v[i] * b.v[i]; });
    }
    friend Abreast operator/(const Abreast& a, const Abreast& b) {
        return each([&](int i) { return a.v[i] / b.v[i]; });
    }
    Abreast& operator+=(const Abreast& b) { return *this = *this + b; }
    friend Abreast operator-(const Abreast& a) {
        return each([&](int i) { return -a.v[i]; });
    }
    Abreast& operator-=(const Abreast& b) { return *this = *this - b; }
    friend Mask operator==(const Abreast& a, const Abreast& b) {
        return each_mask([&](int i) { return a.v[i] == b.v[i]; });
    }
    friend Mask operator>(const Abreast& a, const Abreast& b) {
        return each_mask([&](int i) { return a.v[i] > b.v[i]; });
    }
    friend Mask operator<(const Abreast& a, const Abreast& b) {
        return each_mask([&](int i) { return a.v[i] < b.v[i]; });
    }
    friend Mask operator<=(const Abreast& a, const Abreast& b) {
        return each_mask([&](int i) { return a.v[i] <= b.v[i]; });
    }
    friend Mask operator>=(const Abreast& a, const Abreast& b) {
        return each_mask([&](int i) { return a.v[i] >= b.v[i]; });
    }
    friend Abreast minimum(const Abreast& a, const Abreast& b) {
        return each([&](int i) { return minimum(a.v[i], b.v[i]); });
    }
    friend Abreast maximum(const Abreast& a, const Abreast& b) {
        return each([&](int i) { return maximum(a.v[i], b.v[i]); });
    }
    friend Abreast sqrt(const Abreast& a) {
        return each([&](int i) { return sqrt(a.v[i]); });
    }
    friend Abreast abs(const Abreast& a) {
        return each([&](int i) { return abs(a.v[i]); });
    }
    friend Abreast atan2(const Abreast& y, const Abreast& x) {
        return each([&](int i) { return atan2(y.v[i], x.v[i]); });
    }
    friend Abreast select(const Mask& condition, const Abreast& a, const Abreast& b) {
        return each([&](int i) { return select(condition.m[i], a.v[i], b.v[i]); });
    }
    friend Abreast times_power_of_two(const Abreast& p, const Abreast& rounded) {
        return each([&](int i) { return times_power_of_two(p.v[i], rounded.v[i]); });
    }
};
template <class Lane, int kCount>
inline constexpr bool kIsDouble<Abreast<Lane, kCount>> = kIsDouble<Lane>;
#endif

}  // namespace tvsgs
