// The training views on the device; photographs that do not fit come from the host in time.
#pragma once

#include <algorithm>
#include <vector>

#include "core/copy_lane.h"
#include "core/scene.h"
#include "optim/loss.h"
#include "optim/loss_normal.h"

namespace tvsgs {

/// How many views one iteration and the next look at.
inline int views_at_hand(const LossNeeds& needs) {
    return 2 * (1 + needs.other_views);
}

/// With `budget` bytes for all photographs, or no budget (0), they stay on the device. Else
/// views_at_hand() have theirs there.
template <class Device>
class DeviceViews {
public:
    /// `views` have to outlive this.
    DeviceViews(const std::vector<View>& views, const LossNeeds& needs, std::int64_t budget)
        : hosts_(views.size()), views_(views.size()) {
        std::size_t bytes = 0, most_photo = 0, most_grey = 0;
        for (std::size_t i = 0; i < views.size(); ++i) {
            describe(views[i], needs, views_[i], hosts_[i]);
            bytes += hosts_[i].photo->size() + hosts_[i].grey->size();
            most_photo = std::max(most_photo, hosts_[i].photo->size());
            most_grey = std::max(most_grey, hosts_[i].grey->size());
            views_[i].index = static_cast<int>(i);
        }
        if (budget <= 0 || bytes <= static_cast<std::size_t>(budget) ||
            views.size() <= static_cast<std::size_t>(views_at_hand(needs))) {
            for (std::size_t i = 0; i < views.size(); ++i)
                copy(*hosts_[i].photo, views_[i].photo), copy(*hosts_[i].grey, views_[i].grey);
            hosts_.clear();
            return;
        }
        for (int s = 0; s < views_at_hand(needs); ++s) {
            slots_.push_back({CopyLane<Device>(most_photo), CopyLane<Device>(most_grey), {}, {}});
            slots_.back().photo.resize(most_photo), slots_.back().grey.resize(most_grey);
        }
    }
    DeviceViews(const DeviceViews&) = delete;
    DeviceViews& operator=(const DeviceViews&) = delete;

    bool all_resident() const { return slots_.empty(); }

    /// Their cameras; photographs may be missing.
    const std::vector<DeviceView<Device>>& views() const { return views_; }

    /// With its photographs; they go when as many others as there are at hand have been asked for.
    const DeviceView<Device>& get(int view) {
        if (!all_resident()) {
            Slot& slot = bring(view);
            slot.photo_lane.wait(), slot.grey_lane.wait();
        }
        return views_[static_cast<std::size_t>(view)];
    }

    /// get(view) will follow; its photographs come while the device works.
    void prefetch(int view) {
        if (!all_resident()) bring(view);
    }

private:
    struct Host {
        const std::vector<std::uint8_t>*photo, *grey;
        std::vector<std::uint8_t> own_grey;
    };
    struct Slot {
        CopyLane<Device> photo_lane, grey_lane;
        Buffer<std::uint8_t, Device> photo, grey;  // with the view while it has one
        int view = -1;
        std::int64_t asked = 0;
    };

    static void describe(const View& from,
                         const LossNeeds& needs,
                         DeviceView<Device>& to,
                         Host& host) {
        const ImageU8& photo = from.photo;
        to.camera = from.camera;
        host.photo = &photo.pixels, host.grey = &host.own_grey;
        if (needs.edges) {
            float low = 1, high = 0;
            for (int y = 1; y + 1 < photo.height; ++y)
                for (int x = 1; x + 1 < photo.width; ++x) {
                    const float e = edge_strength(photo.pixels.data(), photo.width, x, y);
                    low = std::min(low, e), high = std::max(high, e);
                }
            to.edge_min = low, to.edge_max = std::max(low, high);
        }
        if (!needs.grey) return;
        const bool given = !from.grey.empty();
        ImageU8 made = given ? ImageU8{} : grey_of(photo);
        const ImageU8& grey = given ? from.grey : made;
        to.grey_width = grey.width, to.grey_height = grey.height;
        if (!given) host.own_grey = std::move(made.pixels);
        if (given) host.grey = &from.grey.pixels;
    }

    /// The slot that has the view or is about to: else the one that was asked for longest ago.
    Slot& bring(int view) {
        auto slot = std::find_if(slots_.begin(), slots_.end(),
                                 [view](const Slot& s) { return s.view == view; });
        if (slot == slots_.end()) {
            slot = std::min_element(slots_.begin(), slots_.end(),
                                    [](const Slot& a, const Slot& b) { return a.asked < b.asked; });
            if (slot->view >= 0) exchange(*slot);
            slot->view = view;
            exchange(*slot);
            const Host& host = hosts_[static_cast<std::size_t>(view)];
            DeviceView<Device>& to = views_[static_cast<std::size_t>(view)];
            // Shrinking keeps the memory, and no view is larger than it.
            to.photo.resize(host.photo->size()), to.grey.resize(host.grey->size());
            slot->photo_lane.start(host.photo->data(), to.photo.data(), to.photo.size());
            slot->grey_lane.start(host.grey->data(), to.grey.data(), to.grey.size());
        }
        slot->asked = ++asked_;
        return *slot;
    }

    void exchange(Slot& slot) {
        DeviceView<Device>& view = views_[static_cast<std::size_t>(slot.view)];
        slot.photo.swap(view.photo), slot.grey.swap(view.grey);
    }

    std::vector<Host> hosts_;
    std::vector<DeviceView<Device>> views_;
    std::vector<Slot> slots_;  // empty: all photographs are on the device
    std::int64_t asked_ = 0;
};

}  // namespace tvsgs
