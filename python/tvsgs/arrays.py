"""Addresses of arrays without a copy, and new arrays of the same library."""
import ctypes
import sys

FLOAT32, INT32 = ('float32', '<f4', (2, 32, 1)), ('int32', '<i4', (0, 32, 1))  # name, NumPy's, DLPack's
ON_HOST, ON_CUDA = (1, 3), (2, 13)  # DLPack: CPU, pinned; CUDA, managed


class _DLTensor(ctypes.Structure):  # of dlpack.h
    _fields_ = [('data', ctypes.c_void_p), ('device_type', ctypes.c_int32), ('device_id', ctypes.c_int32),
                ('ndim', ctypes.c_int32), ('code', ctypes.c_uint8), ('bits', ctypes.c_uint8),
                ('lanes', ctypes.c_uint16), ('shape', ctypes.POINTER(ctypes.c_int64)),
                ('strides', ctypes.POINTER(ctypes.c_int64)), ('byte_offset', ctypes.c_uint64)]


_is_valid = ctypes.PYFUNCTYPE(ctypes.c_int, ctypes.py_object, ctypes.c_char_p)(('PyCapsule_IsValid', ctypes.pythonapi))
_pointer = ctypes.PYFUNCTYPE(ctypes.c_void_p, ctypes.py_object, ctypes.c_char_p)(
    ('PyCapsule_GetPointer', ctypes.pythonapi))


def package_of(array):
    """'numpy', 'torch', 'cupy', 'jax', or another."""
    root = type(array).__module__.partition('.')[0]
    return 'jax' if root == 'jaxlib' else root


def stream_of(array):
    """The current CUDA stream of the array's library; 0: the default stream."""
    package = package_of(array)
    if package == 'torch' and array.is_cuda:
        return sys.modules['torch'].cuda.current_stream(array.device).cuda_stream
    return sys.modules['cupy'].cuda.get_current_stream().ptr if package == 'cupy' else 0


def empty_like(array, shape, dtype):
    """Where the array is; NumPy's for a library without arrays that can be written."""
    package = package_of(array)
    if package == 'torch':
        torch = sys.modules['torch']
        return torch.empty(shape, dtype=getattr(torch, dtype), device=array.device)
    if package == 'cupy':
        return sys.modules['cupy'].empty(shape, dtype)
    import numpy
    return numpy.empty(shape, dtype)


def address_of(array):
    """Of an array of empty_like()."""
    if hasattr(array, 'data_ptr'):  # PyTorch
        return array.data_ptr()
    return array.ctypes.data if package_of(array) == 'numpy' else array.data.ptr


class View:
    """Address of contiguous elements. It keeps the array alive."""

    def __init__(self, name, array, shape, dtype, gpu, stream):
        """shape: -1: any length. gpu: of the votes, -1: CPU."""
        if package_of(array) == 'numpy':
            self._read_numpy(array, dtype)
        elif hasattr(array, '__dlpack__'):
            self._read_dlpack(name, array, dtype, gpu, stream)
        else:
            raise TypeError(f'{name}: {type(array).__name__}; expected a NumPy array or a tensor with __dlpack__')
        if self.dtype != dtype[0]:
            raise TypeError(f'{name}: {self.dtype}; expected {dtype[0]}')
        if len(self.shape) != len(shape) or any(n not in (m, -1) for m, n in zip(self.shape, shape)):
            wanted = str(tuple(shape)).replace('-1', 'N')
            raise ValueError(f'{name}: shape {self.shape}; expected {wanted}')
        if not self.contiguous:
            raise ValueError(f'{name}: not contiguous; pass {name}.contiguous() or numpy.ascontiguousarray({name})')

    def _read_numpy(self, array, dtype):
        interface = array.__array_interface__
        self.owner, self.address, self.shape = array, interface['data'][0], interface['shape']
        self.dtype = dtype[0] if interface['typestr'] == dtype[1] else str(array.dtype)
        self.contiguous = interface['strides'] is None

    def _read_dlpack(self, name, array, dtype, gpu, stream):
        if package_of(array) == 'torch':
            array = array.detach()  # torch gives no capsule of a tensor with gradients
        kind, index = array.__dlpack_device__()
        if kind not in (ON_HOST if gpu < 0 else ON_HOST + ON_CUDA) or (kind in ON_CUDA and index != gpu):
            raise ValueError(f'{name}: on device {index} of kind {int(kind)} of DLPack, but the votes are on '
                             f'{"the CPU" if gpu < 0 else f"cuda:{gpu}"}; move it, or pass device= to Votes')
        capsule = array.__dlpack__(stream=stream or 1) if kind in ON_CUDA else array.__dlpack__()
        if not _is_valid(capsule, b'dltensor'):
            raise TypeError(f'{name}: __dlpack__ gave no unused capsule; pass a tensor that can be exported again')
        tensor = _DLTensor.from_address(_pointer(capsule, b'dltensor'))
        self.owner = capsule, array  # the capsule's destructor releases the tensor
        self.address = (tensor.data or 0) + tensor.byte_offset
        self.shape = tuple(tensor.shape[:tensor.ndim])
        type_of = tensor.code, tensor.bits, tensor.lanes
        names = {0: 'int', 1: 'uint', 2: 'float', 4: 'bfloat', 5: 'complex', 6: 'bool'}
        self.dtype = dtype[0] if type_of == dtype[2] else f'{names.get(tensor.code, "type ")}{tensor.bits}'
        self.contiguous, step = True, 1
        for i in reversed(range(tensor.ndim)):
            if tensor.strides and self.shape[i] > 1:
                self.contiguous = self.contiguous and tensor.strides[i] == step
            step *= self.shape[i]
