#!/usr/bin/env python3
"""A long scene out of a short one, to see what grows with the photographs.

    long_scene.py FROM TO TILES STEP [--no-masks]

FROM is a scene of tvsgs-synth (COLMAP's text). TO has its cameras and points TILES times, on a square of that many tiles
STEP world units apart; the pictures are hard links.
"""
import math
import os
import sys


def rotation(w, x, y, z):
    return [[1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)]]


def records(path):
    with open(path) as file:
        return [line.split() for line in file if not line.startswith("#")]


def link(source, target, kind, name, to):
    os.makedirs(f"{target}/{kind}", exist_ok=True)
    if not os.path.lexists(f"{target}/{kind}/{to}"):
        os.link(f"{source}/{kind}/{name}", f"{target}/{kind}/{to}")


def main(source, target, tiles, step, kinds):
    model = f"{target}/sparse/0"
    os.makedirs(model, exist_ok=True)
    lines = records(f"{source}/sparse/0/images.txt")
    images = list(zip(lines[::2], lines[1::2]))
    points = records(f"{source}/sparse/0/points3D.txt")
    with open(f"{source}/sparse/0/cameras.txt") as file, open(f"{model}/cameras.txt", "w") as out:
        out.write(file.read())
    side = math.ceil(math.sqrt(tiles))
    with open(f"{model}/images.txt", "w") as out, open(f"{model}/points3D.txt", "w") as cloud:
        for tile in range(tiles):
            offset = [step * (tile % side), step * (tile // side), 0]
            for head, seen in images:
                R = rotation(*map(float, head[1:5]))
                t = [float(head[5 + r]) - sum(R[r][c] * offset[c] for c in range(3)) for r in range(3)]
                name = f"t{tile:03d}_{head[9]}"
                for kind in kinds:
                    link(source, target, kind, head[9], name)
                seen = list(seen)
                seen[2::3] = [str(int(p) + tile * len(points)) if p != "-1" else p for p in seen[2::3]]
                first = [str(int(head[0]) + tile * len(images))] + head[1:5] + [repr(v) for v in t] + [head[8], name]
                out.write(" ".join(first) + "\n" + " ".join(seen) + "\n")
            for point in points:
                place = [repr(float(point[1 + c]) + offset[c]) for c in range(3)]
                track = point[8:]
                track[0::2] = [str(int(i) + tile * len(images)) for i in track[0::2]]
                cloud.write(" ".join([str(int(point[0]) + tile * len(points))] + place + point[4:8] + track) + "\n")


if __name__ == "__main__":
    arguments = [a for a in sys.argv[1:] if a != "--no-masks"]
    if len(arguments) != 4:
        sys.exit(__doc__)
    wanted = ["images"] + ["masks"] * ("--no-masks" not in sys.argv and os.path.isdir(arguments[0] + "/masks"))
    main(arguments[0], arguments[1], int(arguments[2]), float(arguments[3]), wanted)
