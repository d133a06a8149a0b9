"""Adds votes to a training with gsplat. Your own trainer needs only VoteLoss.

DefaultStrategy reorders every tensor in its state with the splats, so an index per splat tells the parents.
MCMCStrategy does not: pass {} as `state`.
"""
import torch
from gsplat import DefaultStrategy, rasterization
from tvsgs import Votes, normal_loss, position_loss


class VoteLoss:
    """Both voting losses, with the weights of configs/tv_sgs_votes.json. Call it once per step."""

    def __init__(self, device='cuda'):
        self.votes, self.results = Votes(device), None

    def __call__(self, splats, state, step):
        shape = splats['means'], splats['scales'], splats['quats']
        same = torch.arange(len(shape[0]), device=shape[0].device)
        parents = state.pop('parents', same)
        grown = not torch.equal(parents, same)
        changed = grown or self.results is None or len(self.results.flags) != len(same)
        if changed or step % 100 == 0:
            self.votes.refresh(*shape, parents=parents.int() if grown else None)
        if changed or step % 10 == 0:
            self.results = self.votes.vote(*shape)
        state['parents'] = same
        return 0.5 * normal_loss(*shape[1:], self.results) + position_loss(shape[0], self.results)


def train(splats, optimizers, views, steps, device='cuda'):
    """splats, optimizers: as gsplat's examples make them. views: (viewmat [4, 4], K [3, 3], photo [H, W, 3])."""
    strategy, vote_loss = DefaultStrategy(), VoteLoss(device)
    strategy.check_sanity(splats, optimizers)
    state = strategy.initialize_state()
    for step in range(steps):
        viewmat, K, photo = views[step % len(views)]
        image, _, info = rasterization(
            splats['means'], splats['quats'], splats['scales'].exp(), splats['opacities'].sigmoid(), splats['sh'],
            viewmat[None], K[None], photo.shape[1], photo.shape[0], sh_degree=3, packed=False)
        strategy.step_pre_backward(splats, optimizers, state, step, info)
        loss = (image[0] - photo).abs().mean() + vote_loss(splats, state, step)
        loss.backward()
        for optimizer in optimizers.values():
            optimizer.step()
            optimizer.zero_grad(set_to_none=True)
        strategy.step_post_backward(splats, optimizers, state, step, info, packed=False)
