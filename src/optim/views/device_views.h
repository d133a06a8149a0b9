// Training views in device memory; copies photographs from the host in time where not all fit.
#pragma once

#include <algorithm>
#include <utility>
#include <vector>

#include "core/device/copy_lane.h"
#include "core/device/parallel.h"
#include "core/scene/scene.h"
#include "optim/losses/loss.h"

namespace tvsgs {

/// Number of views that one iteration and the next use.
inline int views_in_use(const LossNeeds& needs) {
    return 2 * (1 + needs.neighbour_views);
}

namespace detail {

struct UnitFloatsBody {
    Span<const std::uint8_t> bytes;
    Span<float> out;
    TVSGS_HD void operator()(int i) const { out[i] = float(bytes[i]) / 255; }
};
struct GreyBody {
    Span<const std::uint8_t> rgb;
    Span<std::uint8_t> out;
    TVSGS_HD void operator()(int i) const { out[i] = grey_of(rgb.data + 3 * std::size_t(i)); }
};

}  // namespace detail

/// Holds all photographs and maps on the device if they fit into `budget` bytes, or if `budget` is
/// 0. Otherwise holds views_in_use() views at a time and replaces them as get() requires.
template <class Device>
class DeviceViews {
public:
    /// `views` have to outlive this.
    DeviceViews(const std::vector<View>& views, const LossNeeds& needs, std::int64_t budget)
        : hosts_(views.size()), views_(views.size()) {
        std::size_t bytes = 0;
        std::vector<std::size_t> most;  // of each array
        for (std::size_t i = 0; i < views.size(); ++i) {
            views_[i].index = int(i);
            describe(views[i], needs, views_[i], hosts_[i]);
            const Host& arrays = hosts_[i];
            most.resize(arrays.size());
            for (std::size_t a = 0; a < arrays.size(); ++a) {
                const std::size_t there = arrays[a].bytes_there();
                bytes += there, most[a] = std::max(most[a], there);
            }
        }
        if (budget <= 0 || bytes <= std::size_t(budget) ||
            views.size() <= std::size_t(views_in_use(needs))) {
            Buffer<std::uint8_t, Device> raw;
            for (std::size_t i = 0; i < views.size(); ++i)
                for_each_buffer(views_[i], [&](std::size_t a, auto& buffer) {
                    const Array& from = hosts_[i][a];
                    set_bytes(buffer, from.bytes_there());
                    if (from.how == How::as_is) {
                        detail::copy(Cpu{}, from.data, Device{}, buffer.data(), from.bytes);
                        return;
                    }
                    if (from.how == How::unit_floats) {
                        raw.resize(from.bytes);
                        detail::copy(Cpu{}, from.data, Device{}, raw.data(), from.bytes);
                    }
                    make(raw.span(), views_[i], buffer);
                });
            hosts_.clear();
            return;
        }
        uploads_.resize(views_in_use(needs));
        for (Upload& upload : uploads_) {
            upload.memory.maps.resize(needs.view_maps.size());
            std::size_t raw = 0;  // bytes of a mask
            for (const Host& host : hosts_)
                for (const Array& array : host)
                    if (array.how == How::unit_floats) raw = std::max(raw, array.bytes);
            upload.raw.resize(raw);
            for_each_buffer(upload.memory, [&](std::size_t a, auto& buffer) {
                upload.lanes.emplace_back(most[a]);
                set_bytes(buffer, most[a]);
            });
        }
    }
    DeviceViews(const DeviceViews&) = delete;
    DeviceViews& operator=(const DeviceViews&) = delete;

    bool all_resident() const { return uploads_.empty(); }

    /// Use only for cameras: photographs and maps are guaranteed only in the result of get().
    const std::vector<DeviceView<Device>>& views() const { return views_; }

    void set_cameras(const std::vector<Camera>& cameras) {
        for (std::size_t i = 0; i < views_.size(); ++i) views_[i].camera = cameras[i];
    }

    /// The view's photographs and maps stay valid until get() or prefetch() has been called for
    /// views_in_use() other views.
    const DeviceView<Device>& get(int view) {
        if (!all_resident()) {
            Upload& upload = bring(view);
            for (CopyLane<Device>& lane : upload.lanes) lane.wait();
            finish(upload);
        }
        return views_[view];
    }

    /// Announces get(view): its photographs are copied while the device works.
    void prefetch(int view) {
        if (!all_resident()) bring(view);
    }

private:
    /// Processing of an array on the device: bytes b to b / 255, or a photograph to grey levels.
    enum class How { as_is, unit_floats, grey };
    struct Array {
        const void* data = nullptr;
        std::size_t bytes = 0;
        How how = How::as_is;

        std::size_t bytes_there() const {
            return how == How::unit_floats ? bytes * sizeof(float)
                   : how == How::grey      ? bytes / 3
                                           : bytes;
        }
    };
    using Host = std::vector<Array>;  // in the order of for_each_buffer()
    struct Upload {
        DeviceView<Device> memory;  // swapped with the view while the view uses it
        std::vector<CopyLane<Device>> lanes;
        Buffer<std::uint8_t, Device> raw;  // the mask's bytes
        int view = -1;
        std::int64_t asked = 0;
        bool finished = true;  // arrays computed on the device are ready
    };

    /// Computes a mask from its bytes `raw`, or grey levels from the view's photograph.
    template <class T>
    static void make(Span<const std::uint8_t> raw,
                     const DeviceView<Device>& view,
                     Buffer<T, Device>& out) {
        const int count = int(out.size());
        if constexpr (std::is_same_v<T, float>)
            parallel_for(Device{}, count, detail::UnitFloatsBody{raw, out.span()});
        else
            parallel_for(Device{}, count, detail::GreyBody{view.photo.span(), out.span()});
    }

    /// Calls visit(number, buffer) for each buffer that is filled from the host.
    template <class Visit>
    static void for_each_buffer(DeviceView<Device>& view, const Visit& visit) {
        std::size_t a = 0;
        visit(a++, view.photo), visit(a++, view.grey);
        for (DeviceMap<Device>& map : view.maps) visit(a++, map.values);
    }
    template <class T>
    static void set_bytes(Buffer<T, Device>& buffer, std::size_t bytes) {
        buffer.resize(bytes / sizeof(T));
    }

    template <class Values>
    static Array array_of(const Values& values, How how = How::as_is) {
        return {values.data(), values.size() * sizeof(*values.data()), how};
    }

    static void describe(const View& from,
                         const LossNeeds& needs,
                         DeviceView<Device>& to,
                         Host& host) {
        const ImageU8& photo = from.photo;
        to.camera = from.camera;
        host.push_back(array_of(photo.pixels));
        if (needs.edges) {
            float low = 1, high = 0;
            for (int y = 1; y + 1 < photo.height; ++y)
                for (int x = 1; x + 1 < photo.width; ++x) {
                    const float e = edge_strength(photo.pixels.data(), photo.width, x, y);
                    low = std::min(low, e), high = std::max(high, e);
                }
            to.edge_min = low, to.edge_max = std::max(low, high);
        }
        Array grey;
        if (needs.grey) {
            const ImageU8& image = from.grey.empty() ? photo : from.grey;
            to.grey_width = image.width, to.grey_height = image.height;
            grey = array_of(image.pixels, from.grey.empty() ? How::grey : How::as_is);
        }
        host.push_back(grey);
        for (const std::string_view name : needs.view_maps)
            host.push_back(describe_map(from, name, to.maps.emplace_back()));
    }

    /// Returns an empty array where the view has no such map.
    static Array describe_map(const View& from, std::string_view name, DeviceMap<Device>& map) {
        map.name = name;
        if (name == "mask") {
            map.width_px = from.mask.width, map.height_px = from.mask.height;
            return array_of(from.mask.pixels, How::unit_floats);
        }
        const auto found = std::find_if(from.maps.begin(), from.maps.end(),
                                        [&](const ViewMap& m) { return m.name == name; });
        if (found == from.maps.end()) return {};
        map.width_px = found->width_px, map.height_px = found->height_px;
        map.channels = found->channels;
        return array_of(found->values);
    }

    /// Returns the upload of the view; if there is none, starts it in the least recently used one.
    Upload& bring(int view) {
        auto upload = std::find_if(uploads_.begin(), uploads_.end(),
                                   [view](const Upload& u) { return u.view == view; });
        if (upload == uploads_.end()) {
            upload = std::min_element(
                uploads_.begin(), uploads_.end(),
                [](const Upload& a, const Upload& b) { return a.asked < b.asked; });
            if (upload->view >= 0) exchange(*upload);
            upload->view = view;
            exchange(*upload);
            const Host& host = hosts_[view];
            for_each_buffer(views_[view], [&](std::size_t a, auto& buffer) {
                // Shrinking keeps the memory, and no view's array is larger.
                const Array& from = host[a];
                set_bytes(buffer, from.bytes_there());
                if (from.how == How::grey) return;
                void* const to =
                    from.how == How::as_is ? static_cast<void*>(buffer.data()) : upload->raw.data();
                upload->lanes[a].start(from.data, to, from.bytes);
            });
            upload->finished = false;
        }
        upload->asked = ++asked_;
        return *upload;
    }

    /// Computes arrays on the device, once their copies have arrived.
    void finish(Upload& upload) {
        if (std::exchange(upload.finished, true)) return;
        DeviceView<Device>& view = views_[upload.view];
        const Host& host = hosts_[upload.view];
        for_each_buffer(view, [&](std::size_t a, auto& buffer) {
            if (host[a].how != How::as_is) make(upload.raw.span(), view, buffer);
        });
    }

    void exchange(Upload& upload) {
        DeviceView<Device>&view = views_[upload.view], &memory = upload.memory;
        memory.photo.swap(view.photo), memory.grey.swap(view.grey);
        for (std::size_t m = 0; m < view.maps.size(); ++m)
            memory.maps[m].values.swap(view.maps[m].values);
    }

    std::vector<Host> hosts_;
    std::vector<DeviceView<Device>> views_;
    std::vector<Upload> uploads_;  // empty: all photographs and maps are on the device
    std::int64_t asked_ = 0;
};

}  // namespace tvsgs
