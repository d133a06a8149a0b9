#!/usr/bin/env python3
"""Draws a torus with noise and as many outliers: as it is, after statistical outlier removal, and after tvsgs-vote.

    scripts/vote_picture.py FILE.ppm [BIN]     BIN: folder of tvsgs-vote [build/cpu/bin]

Needs NumPy and SciPy. The first two panels have the normals of planes through the neighbours. Colours are normals.
"""
import os
import sys
import tempfile

import numpy as np
from vote_normals import cloud, not_outlying, pca, vote

SIZE, DOT = 480, 1


def panel(points, normals):
    """The points from obliquely above, the nearest last."""
    eye = np.array([0, -0.6, 0.8])
    axes = np.array([[1, 0, 0], np.cross(eye, [1, 0, 0]), eye])
    view = points @ axes.T
    facing = normals * np.where(normals @ eye < 0, -1, 1)[:, None]
    image = np.full((SIZE, SIZE, 3), 255, np.uint8)
    column, row = (SIZE / 2 + view[:, :2] * [1, -1] * SIZE / 3.6).astype(int).T
    colour = (127.5 + 127.5 * facing @ axes.T).astype(np.uint8)
    for i in np.argsort(view[:, 2]):
        if DOT <= row[i] < SIZE - DOT and DOT <= column[i] < SIZE - DOT:
            image[row[i] - DOT:row[i] + DOT + 1, column[i] - DOT:column[i] + DOT + 1] = colour[i]
    return image


def main():
    binary = os.path.abspath(sys.argv[2] if len(sys.argv) > 2 else 'build/cpu/bin')
    p = cloud('torus', 0.5, 1, 0, np.random.default_rng(3))[0]
    with tempfile.TemporaryDirectory() as folder:
        voted = vote(p, folder, binary, '--reject', '--refine', '3')
    kept = p[not_outlying(p)]
    picture = np.hstack([panel(p, pca(p)), panel(kept, pca(kept)), panel(voted[:, :3], voted[:, 3:6])])
    with open(sys.argv[1], 'wb') as out:
        out.write(b'P6 %d %d 255\n' % (picture.shape[1], picture.shape[0]) + picture.tobytes())


if __name__ == '__main__':
    main()
