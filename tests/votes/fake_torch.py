"""The part of PyTorch that the losses and the example use, on NumPy, for machines without PyTorch."""
import sys
import types

import numpy as np


class Tensor(np.ndarray):
    device = 'cpu'

    def __new__(cls, values):
        return np.asarray(values).view(cls)

    def __array_wrap__(self, array, context=None):
        return np.asarray(array).view(Tensor)  # also of one number

    def sum(self, *axis):
        return Tensor(np.asarray(self).sum(*axis))

    def mean(self):
        return Tensor(np.asarray(self).mean())

    def to(self, other):
        return self.astype(other.dtype)

    def int(self):
        return self.astype(np.int32)

    def abs(self):
        return np.abs(self)

    def exp(self):
        return np.exp(self)

    def sigmoid(self):
        return 1 / (1 + np.exp(-self))

    def backward(self):
        Tensor.steps_back += 1


def normalize(values, dim):
    return values / np.maximum(np.sqrt((np.asarray(values)**2).sum(dim, keepdims=True)), 1e-12)


def install():
    torch = types.ModuleType('torch')
    torch.nn = types.SimpleNamespace(functional=types.SimpleNamespace(normalize=normalize))
    torch.linalg = types.SimpleNamespace(cross=lambda a, b: np.cross(a, b).view(Tensor))
    torch.eye = lambda n: Tensor(np.eye(n, dtype=np.float32))
    torch.arange = lambda n, device: Tensor(np.arange(n))
    torch.equal = np.array_equal
    sys.modules['torch'] = torch
    return torch
