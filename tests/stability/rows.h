// The list of rows.
#pragma once

#include "stability/rows_adam.h"
#include "stability/rows_geometry.h"
#include "stability/rows_render.h"
#include "stability/rows_tv.h"
#include "stability/sweep.h"

namespace tvsgs::stability {

template <class Device>
std::vector<StabilityCurve> measure() {
    std::vector<StabilityCurve> curves;
    sweep_all<Device, CentreFocal, CentreDepth, CentreScale, EllipseRatio, EllipseLength,
              EllipseSize, QuaternionNorm, StackDepth, StackOpacity, OpacityOfLogit,
              BackwardLogScales, BackwardRotation, BackwardPlace, BackwardSize, SsimContrast>(
        curves);
    sweep_all<Device, WhitenedRatio, WhitenedScale, WhitenedGiant, VoteRatio, VoteScale,
              VoteCoincident, VoteFar, EigenGap, EigenLowerGap, EigenScale, EigenNormal>(curves);
    sweep_all<Device, DepthGrazing, DepthDistance, DepthGradient, NormalFocal, ReprojectedFocal,
              ReprojectedScale, PatchFocal, PatchGrazing, PatchContrast, FusionDepth, FusionFocal,
              FusionScale, FusionViews, AdamCount, AdamGradient, FarMoved, FarAsGiven>(curves);
    return curves;
}

}  // namespace tvsgs::stability
