"""Tensor voting between Gaussian splats, for any trainer. docs/guide/python.md has examples."""
from tvsgs.losses import normal_loss, position_loss
from tvsgs.votes import HAS_TENSOR, NORMAL_VALID, POSITION_VALID, Results, Votes

__version__ = '0.1.0'
__all__ = ['HAS_TENSOR', 'NORMAL_VALID', 'POSITION_VALID', 'Results', 'Votes', 'normal_loss', 'position_loss']
