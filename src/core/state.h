// The state of a training as plain arrays by name, on the host: what a checkpoint holds.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <type_traits>
#include <utility>
#include <vector>

#include "core/gaussians.h"
#include "core/part.h"

namespace tvsgs {

struct StateArray {
    std::string name;
    std::uint32_t element_bytes = 1;
    bool real = false;  // elements are made of floats
    Buffer<std::byte, Cpu> bytes;
    /// Of the arrays of splats of a state in parts: so many planes, of each the own part; and
    /// elements in all.
    int planes = 0;
    std::size_t all = 0;

    std::size_t count() const { return bytes.size() / element_bytes; }
};

/// Of several processes each holds a part: of arrays of splats its own (part_of()), of others all.
struct State {
    std::vector<StateArray> arrays;
    bool in_parts = false;

    /// Null when there is none.
    const StateArray* find(std::string_view name) const;

    /// Throws Error(ExitCode::input) when it is missing or has other elements.
    const StateArray& get(std::string_view name, std::size_t element_bytes) const;

    /// As above; also throws when it has not one element.
    const StateArray& get_one(std::string_view name, std::size_t element_bytes) const;

    /// A new array; its bytes are to be filled in.
    StateArray& add(std::string name, std::size_t element_bytes, std::size_t count, bool real);
};

/// Where a number is that is not finite.
struct NotFinite {
    std::string array;
    std::size_t element;
};
std::optional<NotFinite> find_not_finite(const State& state);

/// Which part of a state is this process's, and how it comes by the others.
struct StateParts {
    int rank = 0, ranks = 1;
    /// All parts, in order; all processes call it.
    std::function<std::vector<std::byte>(const std::byte* part, std::size_t bytes)> gather{};

    Part of(std::size_t splats) const { return part_of(static_cast<int>(splats), rank, ranks); }
};

/// One list of what is saved serves both directions: each object that has a state shows its arrays
/// to the visitor, which copies them out or puts back what they were.
template <class Device>
class StateVisitor {
public:
    explicit StateVisitor(State& to, StateParts parts = {}) : to_(&to), parts_(std::move(parts)) {
        to.in_parts = parts_.ranks > 1;
    }
    explicit StateVisitor(const State& from, StateParts parts = {})
        : from_(&from), parts_(std::move(parts)) {}

    bool loading() const { return from_ != nullptr; }

    /// `planes` times an element for each splat, which all processes hold.
    template <class T>
    void splats(const std::string& name, Buffer<T, Device>& values, int planes = 1) {
        if (!(loading() ? from_->in_parts : to_->in_parts)) return (*this)(name, values);
        if (!loading()) {
            const std::size_t count = values.size() / static_cast<std::size_t>(planes);
            StateArray& array = add_part<T>(name, count, planes);
            const Part own = parts_.of(count);
            for_planes<T>(own, count, planes, [&](std::size_t part, std::size_t whole, auto bytes) {
                detail::copy(Device{}, values.data() + whole, Cpu{},
                             array.bytes.data() + part * sizeof(T), bytes);
            });
            return;
        }
        const StateArray& array = from_->get(name, sizeof(T));
        values.resize(array.all);
        const std::size_t count = array.all / static_cast<std::size_t>(planes);
        const auto part = static_cast<std::size_t>(parts_.of(count).size()) * sizeof(T);
        for (std::size_t p = 0; p < static_cast<std::size_t>(planes); ++p) {
            const std::vector<std::byte> whole = parts_.gather(array.bytes.data() + p * part, part);
            detail::copy(Cpu{}, whole.data(), Device{}, values.data() + p * count, whole.size());
        }
    }

    /// The same, of which this process holds its part of `count` splats; 0: there are none.
    template <class T>
    void part(const std::string& name, Buffer<T, Device>& values, int& count, int planes = 1) {
        if (!loading()) {
            (*this)(name, values);
            StateArray& array = to_->arrays.back();
            if (!to_->in_parts) return;
            array.planes = planes;
            array.all = static_cast<std::size_t>(count) * static_cast<std::size_t>(planes);
            return;
        }
        const StateArray& array = from_->get(name, sizeof(T));
        const std::size_t all =
            (from_->in_parts ? array.all : array.count()) / static_cast<std::size_t>(planes);
        count = static_cast<int>(all);
        if (from_->in_parts || parts_.ranks == 1) return (*this)(name, values);
        const Part own = parts_.of(all);
        values.resize(static_cast<std::size_t>(own.size()) * static_cast<std::size_t>(planes));
        for_planes<T>(own, all, planes, [&](std::size_t part, std::size_t whole, auto bytes) {
            detail::copy(Cpu{}, array.bytes.data() + whole * sizeof(T), Device{},
                         values.data() + part, bytes);
        });
    }

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

    /// As above, but what is not there is left as it is: a term that a resumed run has added.
    template <class T>
    void optional(const std::string& name, Buffer<T, Device>& values) {
        if (!loading() || from_->find(name) != nullptr) (*this)(name, values);
    }

    /// Something small on the host.
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
    StateArray& add_part(const std::string& name, std::size_t count, int planes) {
        const auto each = static_cast<std::size_t>(planes);
        StateArray& array =
            to_->add(name, sizeof(T), each * static_cast<std::size_t>(parts_.of(count).size()),
                     is_real<T>());
        array.planes = planes, array.all = each * count;
        return array;
    }

    /// copy_plane(first element in the part, first one in the whole, bytes) of each plane.
    template <class T, class CopyPlane>
    static void for_planes(Part own, std::size_t count, int planes, const CopyPlane& copy_plane) {
        const auto begin = static_cast<std::size_t>(own.begin),
                   size = static_cast<std::size_t>(own.size());
        for (std::size_t p = 0; p < static_cast<std::size_t>(planes); ++p)
            copy_plane(p * size, p * count + begin, size * sizeof(T));
    }

    template <class T>
    static constexpr bool is_real() {
        return !std::is_integral_v<T> && !std::is_enum_v<T> && !std::is_same_v<T, double>;
    }

    State* to_ = nullptr;
    const State* from_ = nullptr;
    StateParts parts_;
};

template <class Device>
void visit_state(StateVisitor<Device>& visit, const std::string& prefix, Gaussians<Device>& g) {
    if (visit.loading()) visit.value(prefix + "sh_degree", g.sh_degree);  // says how many planes
    for_each_array(
        [&](const SplatArray& array, auto& values) {
            const std::string name = prefix + array.name;
            if (!array.optional || (visit.loading() ? visit.has(name) : !values.empty()))
                visit.splats(name, values, array.planes);
        },
        g);
    if (!visit.loading()) visit.value(prefix + "sh_degree", g.sh_degree);
}

}  // namespace tvsgs
