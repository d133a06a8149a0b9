// The list of losses; included by one file per device.
#pragma once

#include "optim/loss_flatten.h"
#include "optim/loss_multiview_geometry.h"
#include "optim/loss_multiview_ncc.h"
#include "optim/loss_normal.h"
#include "optim/loss_photometric.h"
#include "optim/loss_tv.h"

namespace tvsgs {

template <class Device>
std::vector<std::unique_ptr<Loss<Device>>> make_losses(LossOptions o, const LossContext& c) {
    o.flatten.weight /= c.length_unit;
    o.tv_position.weight /= c.length_unit;
    std::vector<std::unique_ptr<Loss<Device>>> losses;
    const auto add = [&](float weight, auto make) {
        if (weight > 0) losses.push_back(make());
    };
    add(o.photometric.weight,
        [&] { return std::make_unique<PhotometricLoss<Device>>(o.photometric, c.views); });
    add(o.flatten.weight, [&] { return std::make_unique<FlattenLoss<Device>>(o.flatten); });
    add(o.normal.weight, [&] { return std::make_unique<NormalLoss<Device>>(o.normal); });
    add(o.multi_view_geometry.weight,
        [&] { return std::make_unique<MultiViewGeometryLoss<Device>>(o.multi_view_geometry); });
    add(o.multi_view_ncc.weight, [&] {
        return std::make_unique<MultiViewNccLoss<Device>>(o.multi_view_ncc, o.multi_view.samples,
                                                          c.seed, c.pixel_center);
    });
    add(o.tv_normal.weight,
        [&] { return std::make_unique<TvLoss<Device, false>>(o.tv_normal, o.tv_reduction); });
    add(o.tv_position.weight,
        [&] { return std::make_unique<TvLoss<Device, true>>(o.tv_position, o.tv_reduction); });
    return losses;
}

}  // namespace tvsgs
