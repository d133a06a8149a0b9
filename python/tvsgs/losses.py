"""The voting losses of tvsgs in PyTorch. src/optim/losses/loss_tv.h has the same formulas for tvsgs-train.

results: of Votes.vote(). visible: [N] bool, splats to use, or None for all.
"""
from tvsgs.votes import NORMAL_VALID, POSITION_VALID


def normal_loss(log_scales, quats, results, visible=None):
    """Mean of 1 - |n . voted normal|; n is the axis of the smallest scale. Derivatives by `quats` only."""
    import torch
    part = _part(results, NORMAL_VALID, visible)
    quats = torch.nn.functional.normalize(quats[part], dim=1)
    axis = torch.eye(3).to(quats)[log_scales[part].argmin(1)]
    turned = 2 * torch.linalg.cross(quats[:, 1:], axis)
    normals = axis + quats[:, :1] * turned + torch.linalg.cross(quats[:, 1:], turned)
    return (1 - (normals * results.normals[part]).sum(1).abs()).sum() / max(len(normals), 1)


def position_loss(means, results, visible=None):
    """Mean of |mean - target| in the L1 norm, world units. Derivatives by `means`."""
    part = _part(results, POSITION_VALID, visible)
    return (means[part] - results.targets[part]).abs().sum() / max(int(part.sum()), 1)


def _part(results, flag, visible):
    part = (results.flags & flag) != 0
    return part if visible is None else part & visible
