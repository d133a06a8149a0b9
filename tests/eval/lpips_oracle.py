"""Computes the expected numbers of test_lpips.cpp: LPIPS of generated images and weights, with NumPy in
double precision. Run: python3 lpips_oracle.py"""
import numpy as np

VGG = [(0, 3, 64), (2, 64, 64), (5, 64, 128), (7, 128, 128), (10, 128, 256), (12, 256, 256), (14, 256, 256),
       (17, 256, 512), (19, 512, 512), (21, 512, 512), (24, 512, 512), (26, 512, 512), (28, 512, 512)]
NETS = {  # index, in, out, kernel, stride, padding, pool before
    "vgg": ([(i, a, b, 3, 1, 1, 2 if i in (5, 10, 17, 24) else 0) for i, a, b in VGG], {2, 7, 14, 21, 28}),
    "alex": ([(0, 3, 64, 11, 4, 2, 0), (3, 64, 192, 5, 1, 2, 3), (6, 192, 384, 3, 1, 1, 3),
              (8, 384, 256, 3, 1, 1, 0), (10, 256, 256, 3, 1, 1, 0)], {0, 3, 6, 8, 10})}


def uniform(seed, count):
    """In [-1, 1), by SplitMix64 of seed * 2^32 + index, the upper 24 bits: exact in float."""
    with np.errstate(over="ignore"):
        z = np.arange(count, dtype=np.uint64) + np.uint64(seed << 32)
        z = (z + np.uint64(1)) * np.uint64(0x9E3779B97F4A7C15)
        z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
        z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
        z = z ^ (z >> np.uint64(31))
    return (z >> np.uint64(40)).astype(np.float64) * 2.0**-23 - 1


def single(values):
    return values.astype(np.float32).astype(np.float64)


def convolve(x, w, b, stride, pad):
    c, h, width = x.shape
    padded = np.zeros((c, h + 2 * pad, width + 2 * pad))
    padded[:, pad:pad + h, pad:pad + width] = x
    k = w.shape[2]
    oh, ow = (h + 2 * pad - k) // stride + 1, (width + 2 * pad - k) // stride + 1
    out = np.zeros((w.shape[0], oh, ow)) + b[:, None, None]
    for dy in range(k):
        for dx in range(k):
            part = padded[:, dy:dy + stride * (oh - 1) + 1:stride, dx:dx + stride * (ow - 1) + 1:stride]
            out += np.tensordot(w[:, :, dy, dx], part, 1)
    return np.maximum(out, 0)


def pool(x, k):
    oh, ow = (x.shape[1] - k) // 2 + 1, (x.shape[2] - k) // 2 + 1
    return np.max([x[:, dy:dy + 2 * oh - 1:2, dx:dx + 2 * ow - 1:2] for dy in range(k) for dx in range(k)], axis=0)


def lpips(net, a, b, minus_one_one):
    layers, taps = NETS[net]
    shift, scale = np.array([-.030, -.088, -.188]), np.array([.458, .448, .450])
    x = [((2 * im - 1 if minus_one_one else im) - shift[:, None, None]) / scale[:, None, None] for im in (a, b)]
    total, tap = 0, 0
    for i, n_in, n_out, k, stride, pad, edge in layers:
        bound = np.float32(np.sqrt(6.0 / (n_in * k * k)))
        w = single(single(uniform(100 + i, n_out * n_in * k * k)) * np.float64(bound)).reshape(n_out, n_in, k, k)
        bias = single(uniform(200 + i, n_out) * 0.0625)
        x = [convolve(pool(v, edge) if edge else v, w, bias, stride, pad) for v in x]
        if i in taps:
            lin = single(0.5 * uniform(300 + tap, n_out) + 0.5)
            unit = [v / (np.sqrt((v**2).sum(0)) + 1e-10) for v in x]
            total += ((unit[0] - unit[1])**2 * lin[:, None, None]).sum(0).mean()
            tap += 1
    return total


def image(seed, height, width):
    """Interleaved colours, as the program stores them."""
    return single(0.5 * uniform(seed, height * width * 3) + 0.5).reshape(height, width, 3).transpose(2, 0, 1)


if __name__ == "__main__":
    for net, height, width in (("vgg", 37, 45), ("alex", 70, 51)):
        a, b = image(1, height, width), image(2, height, width)
        for signed in (False, True):
            print(net, height, width, "-11" if signed else "01", repr(float(lpips(net, a, b, signed))))
