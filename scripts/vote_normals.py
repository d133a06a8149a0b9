#!/usr/bin/env python3
"""Mean angle of normals in degrees on made surfaces: tvsgs-vote against planes through the same k neighbours (PCA); and
what --reject keeps, against statistical outlier removal with as many neighbours.

    scripts/vote_normals.py [BIN]     BIN: folder of tvsgs-vote [build/cpu/bin]

Needs NumPy and SciPy. Prints the table of docs/guide/vote.md. Noise and distances are in spacings, the root of the
surface's area per point; outliers are a share of the points, in a box 1.2 times as large. They have no true normal.
"""
import os
import subprocess
import sys
import tempfile

import numpy as np
from scipy.spatial import cKDTree

K, POINTS = 30, 10000


def surface(name, n, rng):
    """Points, normals, area."""
    if name == 'plane':
        return np.c_[rng.random((n, 2)), np.zeros(n)], np.tile([0, 0, 1.0], (n, 1)), 1.0
    if name == 'sphere':
        v = rng.normal(size=(n, 3))
        v /= np.linalg.norm(v, axis=1)[:, None]
        return v, v, 4 * np.pi
    if name == 'box':
        axis, side = rng.integers(0, 3, n), rng.choice([-1.0, 1.0], n)
        p, normals = 2 * rng.random((n, 3)) - 1, np.zeros((n, 3))
        p[np.arange(n), axis] = normals[np.arange(n), axis] = side
        return p, normals, 24.0
    big, small = 1.0, 0.4
    u, v = 2 * np.pi * rng.random((2, 3 * n))
    keep = np.flatnonzero(rng.random(3 * n) * (big + small) < big + small * np.cos(v))[:n]
    u, v = u[keep], v[keep]
    normals = np.c_[np.cos(u) * np.cos(v), np.sin(u) * np.cos(v), np.sin(v)]
    return normals * small + big * np.c_[np.cos(u), np.sin(u), 0 * u], normals, 4 * np.pi**2 * big * small


def distances(name, p):
    """Exact distances of points to the surface; a plane without bounds."""
    if name == 'plane':
        return np.abs(p[:, 2])
    if name == 'sphere':
        return np.abs(np.linalg.norm(p, axis=1) - 1)
    if name == 'box':
        q = np.abs(p) - 1
        return np.abs(np.linalg.norm(np.maximum(q, 0), axis=1) + np.minimum(q.max(1), 0))
    return np.abs(np.hypot(np.hypot(p[:, 0], p[:, 1]) - 1.0, p[:, 2]) - 0.4)


def cloud(name, noise, outliers, uneven, rng):
    """Points with the outliers last, normals of the others, noise-free points, spacing."""
    p, normals, area = surface(name, POINTS * 4 if uneven else POINTS, rng)
    if uneven:  # density falls to a twelfth along x
        weight = np.exp(-2.5 * (p[:, 0] - p[:, 0].min()) / np.ptp(p[:, 0]))
        keep = rng.random(len(p)) < weight * POINTS / weight.sum()
        p, normals = p[keep], normals[keep]
    spacing = np.sqrt(area / len(p))
    noisy = p + noise * spacing * rng.normal(size=p.shape)
    count = round(outliers * len(p))
    centre, half = (p.min(0) + p.max(0)) / 2, np.maximum(np.ptp(p, axis=0), np.ptp(p, axis=0).max() / 4) / 2 * 1.2
    far = centre + half * (2 * rng.random((count, 3)) - 1)
    return np.r_[noisy, far].astype('<f4'), normals, p, spacing


def pca(p):
    q = p[cKDTree(p).query(p, K + 1)[1]].astype(float)  # the point and its K neighbours
    q -= q.mean(1, keepdims=True)
    return np.linalg.eigh(np.einsum('nki,nkj->nij', q, q))[1][:, :, 0]


def not_outlying(p):
    """Statistical outlier removal: the mean distance to the neighbours is at most two deviations above the mean."""
    d = cKDTree(p).query(p, K + 1)[0][:, 1:].mean(1)
    return d <= d.mean() + 2 * d.std()


def vote(p, folder, binary, *flags):
    """Rows of the written PLY: x y z nx ny nz confidence surface curve point."""
    with open(folder + '/in.ply', 'wb') as out:
        out.write(b'ply\nformat binary_little_endian 1.0\nelement vertex %d\n' % len(p))
        out.write(b'property float x\nproperty float y\nproperty float z\nend_header\n' + p.tobytes())
    subprocess.run([binary + '/tvsgs-vote', 'in.ply', 'out.ply', '--k', str(K), '--device', 'cpu', '--quiet', *flags],
                   cwd=folder, check=True)
    data = open(folder + '/out.ply', 'rb').read()
    return np.frombuffer(data[data.index(b'end_header\n') + 11:], '<f4').reshape(-1, 10)


def angle(a, b):
    return np.degrees(np.arccos(np.clip(np.abs((a * b).sum(1)), 0, 1))).mean()


def main():
    binary = sys.argv[1] if len(sys.argv) > 1 else 'build/cpu/bin'
    names = ('plane', 'sphere', 'box', 'torus')
    print('| noise, outliers | ' + ' | '.join(names) + ' |')
    print('| --- ' * (len(names) + 1) + '|')
    with tempfile.TemporaryDirectory() as folder:
        binary = os.path.abspath(binary)
        rows = [(0, 0, 0), (0.1, 0, 0), (0.25, 0, 0), (0.5, 0, 0), (1, 0, 0), (2, 0, 0), (0.25, 0, 1), (0.25, 0.1, 0),
                (0.25, 0.5, 0), (0.25, 1, 0)]
        for noise, outliers, uneven in rows:
            cells, kept, kept_by_distance, distance = [], [], [], []
            for seed, name in enumerate(names):
                p, normals, exact, spacing = cloud(name, noise, outliers, uneven, np.random.default_rng(seed))
                n = len(normals)
                out = vote(p, folder, binary)
                cells.append('%.1f / %.1f' % (angle(out[:n, 3:6], normals), angle(pca(p)[:n], normals)))
                out = vote(p, folder, binary, '--reject')
                index = {row.tobytes(): i for i, row in enumerate(p)}
                of = np.array([index[row.tobytes()] for row in out[:, :3]])
                off = cKDTree(exact).query(p[n:])[0] > 3 * spacing if outliers else np.zeros(0, bool)
                kept.append(((of < n).sum() / n, off[of[of >= n] - n].sum() / max(1, off.sum())))
                near = not_outlying(p)
                kept_by_distance.append((near[:n].mean(), near[n:][off].sum() / max(1, off.sum())))
                moved = vote(p, folder, binary, '--refine', '3')[:n, :3]
                distance.append([np.mean(distances(name, q)) / spacing for q in (p[:n], moved)])
            print('| %g, %g %%%s | ' % (noise, 100 * outliers, ', uneven' if uneven else '') + ' | '.join(cells) + ' |')
            print('   --reject keeps of the surface, of far outliers:', ', '.join('%.3f %.3f' % x for x in kept),
                  '; statistical removal:', ', '.join('%.3f %.3f' % x for x in kept_by_distance),
                  '; mean distance before, after --refine 3:', ', '.join('%.2f %.2f' % tuple(x) for x in distance),
                  file=sys.stderr, flush=True)


if __name__ == '__main__':
    main()
