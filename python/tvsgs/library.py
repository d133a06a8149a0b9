"""Finds libtvsgs_votes and declares the functions of tvsgs_votes.h."""
import ctypes
import functools
import os
import pathlib

INTERFACE = 1
NAME = f'libtvsgs_votes.so.{INTERFACE}'


class Splats(ctypes.Structure):
    _fields_ = [('count', ctypes.c_int64)] + [(name, ctypes.c_void_p) for name in ('means', 'log_scales', 'quats')]


class ResultPointers(ctypes.Structure):
    _fields_ = [('count', ctypes.c_int64)] + [
        (name, ctypes.c_void_p) for name in ('normals', 'targets', 'eigenvalues', 'flags')]


@functools.lru_cache(maxsize=None)
def load():
    """The library: TVSGS_VOTES_LIBRARY, else beside this package, else where the system's loader finds it."""
    named = os.environ.get('TVSGS_VOTES_LIBRARY')
    beside = pathlib.Path(__file__).with_name(NAME)
    path = named or (str(beside) if beside.exists() else NAME)
    try:
        library = ctypes.CDLL(path)
    except OSError as error:
        advice = 'correct TVSGS_VOTES_LIBRARY' if named else f'install tvsgs, or set TVSGS_VOTES_LIBRARY to {NAME}'
        raise OSError(f'{error}; {advice}') from None
    try:
        found = library.tvsgs_votes_interface()
    except AttributeError:
        raise OSError(f'{path} is not libtvsgs_votes; correct TVSGS_VOTES_LIBRARY') from None
    if found != INTERFACE:
        raise OSError(f'{path} has interface {found}, this package needs {INTERFACE}; install both from one version')
    handle, stream, text = ctypes.c_void_p, ctypes.c_void_p, ctypes.c_char_p
    for name, result, *arguments in (
            ('version', text),
            ('create', ctypes.c_int, text, text, ctypes.POINTER(handle)),
            ('destroy', None, handle),
            ('refresh', ctypes.c_int, handle, ctypes.POINTER(Splats), ctypes.c_void_p, stream),
            ('vote', ctypes.c_int, handle, ctypes.POINTER(Splats), stream),
            ('read', ctypes.c_int, handle, ctypes.POINTER(ResultPointers), stream),
            ('gpu', ctypes.c_int, handle),
            ('error', text, handle)):
        function = getattr(library, f'tvsgs_votes_{name}')
        function.restype, function.argtypes = result, arguments
    return library


def check(code, handle=None):
    """Raises the error of a call that returned `code`."""
    if code != 0:
        text = load().tvsgs_votes_error(handle).decode(errors='replace')
        raise {2: ValueError, 4: MemoryError}.get(code, RuntimeError)(text)
