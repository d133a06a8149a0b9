"""The Python package against the C++ results, bit by bit, and against bad input. PyTorch is used if it is installed.

Environment: TVSGS_VOTES_LIBRARY, TVSGS_VOTES_CASE (the program write_votes_case).
"""
import ctypes
import gc
import importlib.util
import os
import pathlib
import subprocess
import sys
import tempfile
import types
import unittest

try:
    import numpy as np
except ImportError:
    print('skipped: no NumPy (Debian: python3-numpy)')
    sys.exit(77)

HERE = pathlib.Path(__file__).resolve().parent
sys.path[:0] = [str(HERE), str(HERE.parents[1] / 'python')]
REAL_TORCH = importlib.util.find_spec('torch') is not None
if REAL_TORCH:
    import torch
else:
    import fake_torch
    torch = fake_torch.install()
import tvsgs
from tvsgs import arrays

NAMES = ('normals', 'targets', 'eigenvalues', 'flags')
SHAPE = ('means', 'log_scales', 'quats')


def tensor(values):
    return torch.tensor(values) if REAL_TORCH else fake_torch.Tensor(values)


class Case:
    """Files of write_votes_case."""

    def __init__(self):
        with tempfile.TemporaryDirectory() as folder:
            subprocess.run([os.environ['TVSGS_VOTES_CASE'], folder], check=True)
            self.files = {path.name: path.read_bytes() for path in pathlib.Path(folder).iterdir()}

    def read(self, name, columns=0, dtype=np.float32):
        values = np.frombuffer(bytearray(self.files[name]), dtype)
        return values.reshape(-1, columns) if columns else values

    def shape(self, event):
        return [self.read(f'{name}_{event}', 4 if name == 'quats' else 3) for name in SHAPE]

    def results(self, event):
        return tvsgs.Results(*(self.read(f'{name}_{event}', 3) for name in NAMES[:3]),
                             self.read(f'flags_{event}', dtype=np.uint8))


CASE = Case()


class Managed(ctypes.Structure):  # DLManagedTensor
    _fields_ = [('tensor', arrays._DLTensor), ('context', ctypes.c_void_p), ('deleter', ctypes.c_void_p)]


class Exported:
    """A tensor of a library that has only DLPack; counts how often it was released."""
    TYPES = {'float32': (2, 32), 'float64': (2, 64), 'int32': (0, 32)}
    new = ctypes.PYFUNCTYPE(ctypes.py_object, ctypes.c_void_p, ctypes.c_char_p, ctypes.c_void_p)(
        ('PyCapsule_New', ctypes.pythonapi))
    rename = ctypes.PYFUNCTYPE(ctypes.c_int, ctypes.py_object, ctypes.c_char_p)(
        ('PyCapsule_SetName', ctypes.pythonapi))

    def __init__(self, array, device=(1, 0), offset=0, used=False):
        self.array, self.device, self.used, self.released = array, device, used, 0
        code, bits = self.TYPES[str(array.dtype)]
        self.extents = (ctypes.c_int64 * array.ndim)(*array.shape)
        self.steps = (ctypes.c_int64 * array.ndim)(*(s // array.itemsize for s in array.strides))
        self.managed = Managed(arrays._DLTensor(array.ctypes.data - offset, *device, array.ndim, code, bits, 1,
                                                self.extents, self.steps, offset))
        self.destroy = ctypes.PYFUNCTYPE(None, ctypes.c_void_p)(self._release)

    def _release(self, capsule):
        self.released += 1

    def __dlpack_device__(self):
        return self.device

    def __dlpack__(self, stream=None):
        capsule = self.new(ctypes.addressof(self.managed), b'dltensor', ctypes.cast(self.destroy, ctypes.c_void_p))
        if self.used:
            self.rename(capsule, b'used_dltensor')
        return capsule


class Bits(unittest.TestCase):
    def run_events(self, convert):
        votes = tvsgs.Votes(k=20)
        for event in range(8):
            shape = [convert(a) for a in CASE.shape(event)]
            if f'parents_{event}' in CASE.files:
                parents = CASE.read(f'parents_{event}', dtype=np.int32)
                votes.refresh(*shape, parents=convert(parents) if len(parents) else None)
            results = votes.vote(*shape)
            for name, found, expected in zip(NAMES, results, CASE.results(event)):
                self.assertEqual(np.asarray(found).tobytes(), expected.tobytes(), (event, name))
        return results

    def test_numpy(self):
        self.run_events(lambda a: a)

    def test_read_only_numpy(self):
        def convert(array):
            array.flags.writeable = False
            return array
        self.run_events(convert)

    def test_dlpack(self):
        exported = []

        def convert(array):
            exported.append(Exported(array, offset=64 * (len(exported) % 2)))
            return exported[-1]
        self.assertIsInstance(self.run_events(convert).normals, np.ndarray)
        gc.collect()
        self.assertGreater(len(exported), 20)
        for e in exported:  # once for each call that takes it
            self.assertIn(e.released, (1, 2))

    @unittest.skipUnless(REAL_TORCH, 'no PyTorch')
    def test_torch(self):
        def convert(array):
            return torch.from_numpy(array).requires_grad_(array.dtype == np.float32)
        self.assertIsInstance(self.run_events(convert).flags, torch.Tensor)

    def test_saliencies(self):
        results = tvsgs.Results(None, None, np.array([[7, 5, 1], [3, 2, 2]]), None)
        saliencies = [list(a) for a in (results.surface, results.curve, results.point)]
        self.assertEqual(saliencies, [[4, 0], [2, 1], [1, 2]])


class Hostile(unittest.TestCase):
    def setUp(self):
        self.votes = tvsgs.Votes(k=20)
        self.means, self.log_scales, self.quats = CASE.shape(0)

    def fails(self, error, text, means=None, log_scales=None, quats=None, **more):
        with self.assertRaisesRegex(error, text):
            self.votes.refresh(self.means if means is None else means,
                               self.log_scales if log_scales is None else log_scales,
                               self.quats if quats is None else quats, **more)

    def test_arrays(self):
        means, quats = self.means, self.quats
        self.fails(TypeError, 'means: float64; expected float32', means.astype(np.float64))
        self.fails(TypeError, 'means: >f4; expected float32', means.astype('>f4'))
        self.fails(TypeError, 'quats: int32; expected float32', quats=quats.astype(np.int32))
        self.fails(ValueError, r'means: not contiguous; pass means.contiguous\(\)', np.asfortranarray(means))
        self.fails(ValueError, 'means: not contiguous', means[::2])
        self.fails(ValueError, r'means: shape \(300, 2\); expected \(N, 3\)', means[:, :2])
        self.fails(ValueError, r'means: shape \(900,\); expected \(N, 3\)', means.reshape(-1))
        self.fails(ValueError, r'quats: shape \(299, 4\); expected \(300, 4\)', quats=quats[1:])
        self.fails(ValueError, r'log_scales: shape \(300, 4\); expected \(300, 3\)', log_scales=quats)
        self.fails(TypeError, 'means: list; expected a NumPy array or a tensor with __dlpack__', means.tolist())
        self.fails(TypeError, 'parents: int64; expected int32', parents=np.zeros(300, np.int64))
        self.fails(ValueError, r'parents: shape \(2,\); expected \(300,\)', parents=np.zeros(2, np.int32))
        self.fails(ValueError, 'parent 0 of splat 0', parents=np.zeros(300, np.int32))

    def test_dlpack(self):
        means = self.means
        self.fails(TypeError, 'means: float64; expected float32', Exported(means.astype(np.float64)))
        self.fails(ValueError, 'means: not contiguous', Exported(np.asfortranarray(means)))
        self.fails(ValueError, r'means: shape \(300, 2\)', Exported(means[:, :2]))
        for kind in (2, 10):  # CUDA, ROCm
            self.fails(ValueError, f'means: on device 0 of kind {kind} .* are on the CPU', Exported(means, (kind, 0)))
        used = Exported(means, used=True)
        self.fails(TypeError, 'means: __dlpack__ gave no unused capsule', used)
        none = types.SimpleNamespace(__dlpack__=lambda: None, __dlpack_device__=lambda: (1, 0))
        self.fails(TypeError, 'means: __dlpack__ gave no unused capsule', none)
        # A tensor is released also when a later one is refused.
        first = Exported(means)
        self.fails(TypeError, 'quats: float64', first, quats=Exported(self.quats.astype(np.float64)))
        gc.collect()
        self.assertEqual(first.released, 1)

    @unittest.skipUnless(REAL_TORCH, 'no PyTorch')
    def test_torch(self):
        means = torch.from_numpy(self.means)
        self.fails(TypeError, 'means: float64', means.double())
        self.fails(TypeError, 'means: bfloat16', means.bfloat16())
        self.fails(ValueError, 'means: not contiguous', torch.zeros(3, 300).T)

    def test_order(self):
        with self.assertRaisesRegex(ValueError, 'call refresh first'):
            self.votes.vote(self.means, self.log_scales, self.quats)
        self.votes.refresh(self.means, self.log_scales, self.quats)
        with self.assertRaisesRegex(ValueError, '200 splats, but the last refresh had 300'):
            self.votes.vote(self.means[:200], self.log_scales[:200], self.quats[:200])
        results = self.votes.vote(self.means, self.log_scales, self.quats)
        self.assertEqual(results.normals.tobytes(), CASE.results(0).normals.tobytes())

    def test_options(self):
        for options, text in (({'kk': 3}, "did you mean 'k'"), ({'k': 'nan'}, 'expected a number, 1 to 512'),
                              ({'device': 'tpu'}, 'expected auto, cpu')):
            with self.assertRaisesRegex(ValueError, text):
                tvsgs.Votes(**options)
        tvsgs.Votes(whiten=False, targets='anchor')

    def test_library(self):
        def load(path):
            return subprocess.run([sys.executable, '-c', 'import tvsgs; tvsgs.Votes()'], text=True, capture_output=True,
                                  env=os.environ | {'PYTHONPATH': sys.path[1], 'TVSGS_VOTES_LIBRARY': path}).stderr
        self.assertRegex(load('/none'), 'OSError: .*/none.*correct TVSGS_VOTES_LIBRARY')
        self.assertRegex(load('libm.so.6'), 'OSError: libm.so.6 is not libtvsgs_votes')
        self.assertEqual(load(os.environ['TVSGS_VOTES_LIBRARY']), '')

    def test_only_the_interface_is_exported(self):
        try:
            listed = subprocess.run(['nm', '-D', '--defined-only', os.environ['TVSGS_VOTES_LIBRARY']], text=True,
                                    capture_output=True, check=True).stdout
        except FileNotFoundError:
            self.skipTest('no nm')
        names = {line.split()[-1] for line in listed.splitlines()}
        self.assertEqual(len(names), 9)
        self.assertTrue(all(name.startswith('tvsgs_votes_') for name in names), names)


class Losses(unittest.TestCase):
    """Python's losses have the values and the derivatives of the C++."""

    def losses(self, shape, visible):
        results = tvsgs.Results(*(tensor(np.array(a)) for a in CASE.results(4)))
        return (tvsgs.normal_loss(shape[1], shape[2], results, visible),
                tvsgs.position_loss(shape[0], results, visible))

    def check(self, visible, suffix):
        shape = [np.array(a, np.float64) for a in CASE.shape(4)]
        found = [float(loss) for loss in self.losses([tensor(a) for a in shape], visible)]
        # The C++ is in single precision: one rounding of a cosine near 1, a few of a length.
        np.testing.assert_allclose(found, CASE.read(f'loss_{suffix}', dtype=np.float64), rtol=1e-6, atol=1.2e-7)
        self.assertGreater(min(found), 1e-3)
        for index, loss, name in ((2, 0, 'dL_dquats'), (0, 1, 'dL_dmeans')):
            expected = CASE.read(f'{name}_{suffix}', shape[index].shape[1])
            rows = slice(None, None, 1 if REAL_TORCH else 8)  # differences take long
            gradient = np.zeros_like(shape[index])
            if REAL_TORCH:
                leaves = [tensor(a).requires_grad_() for a in shape]
                self.losses(leaves, visible)[loss].backward()
                gradient = leaves[index].grad.numpy()
                self.assertEqual([a.grad is None for a in leaves], [i != index for i in range(3)])
            else:
                for at in np.ndindex(*gradient.shape):
                    if at[0] % rows.step:
                        continue
                    value = []
                    for h in (1e-6, -1e-6):
                        moved = [a.copy() for a in shape]
                        moved[index][at] += h
                        value.append(float(self.losses([tensor(a) for a in moved], visible)[loss]))
                    gradient[at] = (value[0] - value[1]) / 2e-6
            # A few roundings of single precision.
            np.testing.assert_allclose(gradient[rows], expected[rows], rtol=1e-4, atol=1e-6 * np.abs(expected).max())

    def test_of_all(self):
        self.check(None, 'all')

    def test_of_visible(self):
        self.check(tensor(CASE.read('visible', dtype=np.uint8) != 0), 'visible')

    def test_of_none(self):
        zero = [float(loss) for loss in self.losses([tensor(a) for a in CASE.shape(4)], tensor(np.zeros(330, bool)))]
        self.assertEqual(zero, [0, 0])


def rasterization(means, quats, scales, opacities, colors, viewmats, Ks, width, height, near_plane=0.01, far_plane=1e10,
                  radius_clip=0.0, eps2d=0.3, sh_degree=None, packed=True):
    """As gsplat's. The image is the mean of all splats."""
    assert quats.shape[1] == 4 and scales.shape == means.shape and colors.shape[1:] == (16, 3)
    assert viewmats.shape == (1, 4, 4) and Ks.shape == (1, 3, 3) and packed is False and sh_degree == 3
    assert len(opacities) == len(means)
    return means.mean() + tensor(np.zeros((1, height, width, 3), np.float32)), None, {'means2d': None}


class DefaultStrategy:
    """As gsplat's: reorders the splats and each tensor in its state at step 25."""

    def check_sanity(self, params, optimizers):
        assert set(params) == set(optimizers)

    def initialize_state(self, scene_scale=1.0):
        return {'grad2d': None, 'scene_scale': scene_scale}

    def step_pre_backward(self, params, optimizers, state, step, info):
        assert 'means2d' in info

    def step_post_backward(self, params, optimizers, state, step, info, packed=False):
        if step == 25:
            order = list(range(299, 9, -1)) + list(range(40))
            for values in (params, state):
                for name, value in values.items():
                    if hasattr(value, 'shape'):
                        values[name] = value[order]
                        if REAL_TORCH:
                            values[name] = values[name].detach().requires_grad_(value.requires_grad)


class GsplatExample(unittest.TestCase):
    def test_trains(self):
        sys.modules['gsplat'] = types.SimpleNamespace(rasterization=rasterization, DefaultStrategy=DefaultStrategy)
        spec = importlib.util.spec_from_file_location('gsplat_votes', HERE.parents[1] / 'examples/gsplat_votes.py')
        example = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(example)

        calls, seen = [], []

        class Spy(tvsgs.Votes):
            def refresh(self, *shape, parents=None):
                calls.append((step[0], len(shape[0]), None if parents is None else np.array(parents).tolist()))
                super().refresh(*shape, parents=parents)

            def vote(self, *shape):
                seen.append((step[0], super().vote(*shape)))
                return seen[-1][1]
        example.Votes = Spy
        splats = dict(zip(('means', 'scales', 'quats'), map(tensor, CASE.shape(0))))
        splats['opacities'] = tensor(np.zeros(300, np.float32))
        splats['sh'] = tensor(np.zeros((300, 16, 3), np.float32))
        if REAL_TORCH:
            for value in splats.values():
                value.requires_grad_()
        step = [0]
        stepped = types.SimpleNamespace(step=lambda: None, zero_grad=lambda set_to_none: None)

        class Counts:
            step = staticmethod(lambda: step.__setitem__(0, step[0] + 1))
            zero_grad = stepped.zero_grad
        optimizers = dict.fromkeys(splats, stepped)
        optimizers['means'] = Counts
        if not REAL_TORCH:
            fake_torch.Tensor.steps_back = 0
        view = [tensor(a.astype(np.float32)) for a in (np.eye(4), np.eye(3), np.zeros((4, 6, 3)))]
        example.train(splats, optimizers, [view], 111, device='cpu')
        order = list(range(299, 9, -1)) + list(range(40))
        self.assertEqual(calls, [(0, 300, None), (26, 330, order), (100, 330, None)])
        self.assertEqual([at for at, _ in seen], [0, 10, 20, 26] + list(range(30, 111, 10)))
        if REAL_TORCH:
            self.assertEqual(len(splats['means']), 330)
        else:
            self.assertEqual(fake_torch.Tensor.steps_back, 111)


if __name__ == '__main__':
    print('PyTorch', torch.__version__ if REAL_TORCH else 'is not installed: a stand-in is used')
    unittest.main(verbosity=1)
