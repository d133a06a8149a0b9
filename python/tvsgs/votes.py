"""Votes between splats."""
import ctypes
import sys
import typing
import weakref

from tvsgs import arrays, library

HAS_TENSOR, NORMAL_VALID, POSITION_VALID = 1, 2, 4


class Results(typing.NamedTuple):
    """Results of one vote, constants for the losses. Arrays of the library of `means`, NumPy's for others than
    NumPy, PyTorch, CuPy and JAX."""
    normals: typing.Any      # [N, 3] float32, unit, of either sign
    targets: typing.Any      # [N, 3] float32, voted places, world units
    eigenvalues: typing.Any  # [N, 3] float32, descending
    flags: typing.Any        # [N] uint8: HAS_TENSOR, NORMAL_VALID, POSITION_VALID

    @property
    def surface(self):
        """[N] saliency of a surface."""
        return self.eigenvalues[:, 1] - self.eigenvalues[:, 2]

    @property
    def curve(self):
        """[N] saliency of a curve."""
        return self.eigenvalues[:, 0] - self.eigenvalues[:, 1]

    @property
    def point(self):
        """[N] saliency of a point."""
        return self.eigenvalues[:, 2]


class Votes:
    """Tensor voting between the splats of a trainer.

    device: 'cpu', 'cuda', 'cuda:N' or 'auto'. options: tv.* keys of tvsgs-train, for example k=64.
    Arrays are float32 and contiguous: means [N, 3], log_scales [N, 3], quats [N, 4] as (w, x, y, z).
    """

    def __init__(self, device='cpu', **options):
        self._library = library.load()
        text = ' '.join(f'{key}={str(value).lower() if isinstance(value, bool) else value}'
                        for key, value in options.items())
        handle = ctypes.c_void_p()
        library.check(self._library.tvsgs_votes_create(str(device).encode(), text.encode(), ctypes.byref(handle)))
        self._handle = handle
        self._gpu = self._library.tvsgs_votes_gpu(handle)
        weakref.finalize(self, self._library.tvsgs_votes_destroy, handle)

    def refresh(self, means, log_scales, quats, parents=None):
        """Searches neighbours. Call it before the first vote, after splats were added, removed or reordered, and about
        every 100 iterations.

        parents: [N] int32, index of each splat at the last refresh, -1: new. Without it the splats are the same, or
        all new if their number differs.
        """
        splats, views, stream = self._splats(means, log_scales, quats)
        if parents is not None:
            parents = arrays.View('parents', parents, (splats.count,), arrays.INT32, self._gpu, stream)
        library.check(self._library.tvsgs_votes_refresh(
            self._handle, splats, parents and parents.address, stream), self._handle)

    def vote(self, means, log_scales, quats):
        """Runs a voting event on the splats of the last refresh; returns Results."""
        splats, views, stream = self._splats(means, log_scales, quats)
        library.check(self._library.tvsgs_votes_vote(self._handle, splats, stream), self._handle)
        results = [arrays.empty_like(means, (splats.count, 3), 'float32') for _ in range(3)]
        results.append(arrays.empty_like(means, (splats.count,), 'uint8'))
        pointers = library.ResultPointers(splats.count, *map(arrays.address_of, results))
        library.check(self._library.tvsgs_votes_read(self._handle, pointers, stream), self._handle)
        if arrays.package_of(means) == 'jax':
            jax = sys.modules['jax']
            results = [jax.device_put(a, next(iter(means.devices()))) for a in results]
        return Results(*results)

    def _splats(self, means, log_scales, quats):
        """The arrays for the library, views that keep them alive during the call, the stream."""
        stream = arrays.stream_of(means)
        views = [arrays.View('means', means, (-1, 3), arrays.FLOAT32, self._gpu, stream)]
        count = views[0].shape[0]
        for name, array, columns in (('log_scales', log_scales, 3), ('quats', quats, 4)):
            views.append(arrays.View(name, array, (count, columns), arrays.FLOAT32, self._gpu, stream))
        return library.Splats(count, *(view.address for view in views)), views, stream
