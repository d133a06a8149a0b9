// State of a training as named arrays on the host. Checkpoints store it.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <type_traits>
#include <vector>

#include "core/scene/gaussians.h"

namespace tvsgs {

/// One named array.
struct StateArray {
    std::string name;
    std::uint32_t element_bytes = 1;
    bool real = false;  // the elements consist of floats
    Buffer<std::byte, Cpu> bytes;

    std::size_t count() const { return bytes.size() / element_bytes; }
};

/// All arrays of a training.
struct State {
    std::vector<StateArray> arrays;

    /// Null if there is no such array.
    const StateArray* find(std::string_view name) const;

    /// Throws Error(ExitCode::input) if the array is missing or has elements of another size.
    const StateArray& get(std::string_view name, std::size_t element_bytes) const;

    /// As above; also throws unless the array has exactly one element.
    const StateArray& get_one(std::string_view name, std::size_t element_bytes) const;

    /// Adds an array; the caller fills its bytes.
    StateArray& add(std::string name, std::size_t element_bytes, std::size_t count, bool real);
};

/// Position of a number that is not finite.
struct NotFinite {
    std::string array;
    std::size_t element;
};
/// The first such number in arrays of floats.
std::optional<NotFinite> find_not_finite(const State& state);

/// Saves or loads with one list: each object with a state passes its arrays to the visitor, which
/// copies them out or restores them.
template <class Device>
class StateVisitor {
public:
    explicit StateVisitor(State& to) : to_(&to) {}
    explicit StateVisitor(const State& from) : from_(&from) {}

    bool loading() const { return from_ != nullptr; }

    template <class T>
    void operator()(const std::string& name, Buffer<T, Device>& values) {
        if (loading()) {
            const StateArray& array = from_->get(name, sizeof(T));
            values.resize(array.count());
            detail::copy(Cpu{}, array.bytes.data(), Device{}, values.data(), array.bytes.size());
        } else {
            StateArray& array = to_->add(name, sizeof(T), values.size(), is_real<T>());
            detail::copy(Device{}, values.data(), Cpu{}, array.bytes.data(), array.bytes.size());
        }
    }

    /// As above, but leaves an array unchanged if the state lacks it: a resumed run may add a loss.
    template <class T>
    void optional(const std::string& name, Buffer<T, Device>& values) {
        if (!loading() || from_->find(name) != nullptr) (*this)(name, values);
    }

    /// A small value on the host.
    template <class T>
    void value(const std::string& name, T& value) {
        static_assert(std::is_trivially_copyable_v<T>);
        if (loading()) {
            detail::copy(Cpu{}, from_->get_one(name, sizeof(T)).bytes.data(), Cpu{}, &value,
                         sizeof(T));
        } else {
            detail::copy(Cpu{}, &value, Cpu{}, to_->add(name, sizeof(T), 1, false).bytes.data(),
                         sizeof(T));
        }
    }

    bool has(const std::string& name) const { return from_->find(name) != nullptr; }

private:
    template <class T>
    static constexpr bool is_real() {
        return !std::is_integral_v<T> && !std::is_enum_v<T> && !std::is_same_v<T, double>;
    }

    State* to_ = nullptr;
    const State* from_ = nullptr;
};

/// Visits the arrays of the Gaussians; names begin with `prefix`.
template <class Device>
void visit_state(StateVisitor<Device>& visit, const std::string& prefix, Gaussians<Device>& g) {
    if (visit.loading()) visit.value(prefix + "sh_degree", g.sh_degree);
    for_each_array(
        [&](const SplatArray& array, auto& values) {
            const std::string name = prefix + array.name;
            if (!array.optional || (visit.loading() ? visit.has(name) : !values.empty()))
                visit(name, values);
        },
        g);
    if (!visit.loading()) visit.value(prefix + "sh_degree", g.sh_degree);
}

}  // namespace tvsgs
