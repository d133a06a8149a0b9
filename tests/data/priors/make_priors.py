#!/usr/bin/env python3
"""Tiny priors in every format that tvsgs reads, byte by byte from the formats' descriptions.

    python3 tests/data/priors/make_priors.py

Writes beside itself, a folder per program. Views are 0001 and 0002, maps 8 x 6 unless said
otherwise. The number at column x and row y of view v is 100 v + 10 y + x + 1, in the unit of the
format; what that stands for is in tests/io/test_priors.cpp. Standard library only.
"""
import json
import pathlib
import struct
import zlib

HERE = pathlib.Path(__file__).parent
WIDTH, HEIGHT, VIEWS = 8, 6, (1, 2)


def number(view, x, y):
    return 100 * view + 10 * y + x + 1


def rows(view, width=WIDTH, height=HEIGHT):
    return [[number(view, x, y) for x in range(width)] for y in range(height)]


def flat(table):
    return [value for row in table for value in row]


def save(name, data):
    path = HERE / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(data.encode() if isinstance(data, str) else data)


def npy(descr, shape, values, version=1, fortran=False):
    kind = {"f2": "e", "f4": "f", "f8": "d", "u1": "B", "u2": "H"}[descr[1:]]
    order = descr[0] if descr[0] in "<>" else "<"
    text = f"{{'descr': '{descr}', 'fortran_order': {fortran}, 'shape': {shape}, }}"
    start = 10 if version == 1 else 12
    text += " " * (-(start + len(text) + 1) % 64) + "\n"
    size = struct.pack("<H" if version == 1 else "<I", len(text))
    return (b"\x93NUMPY" + bytes([version, 0]) + size + text.encode()
            + struct.pack(f"{order}{len(values)}{kind}", *values))


def png(table, bits, color=0):
    def chunk(kind, data):
        return (struct.pack(">I", len(data)) + kind + data
                + struct.pack(">I", zlib.crc32(kind + data)))
    pixel = ">H" if bits == 16 else ">B"
    lines = b"".join(b"\0" + b"".join(struct.pack(pixel, c) for value in row
                                      for c in (value if color == 2 else [value]))
                     for row in table)
    return (b"\x89PNG\r\n\x1a\n"
            + chunk(b"IHDR", struct.pack(">IIBBBBB", len(table[0]), len(table), bits, color, 0, 0, 0))
            + chunk(b"IDAT", zlib.compress(lines)) + chunk(b"IEND", b""))


def pfm(table, order="<"):
    upwards = flat(reversed(table))
    return (f"Pf\n{len(table[0])} {len(table)}\n{-1.0 if order == '<' else 1.0}\n".encode()
            + struct.pack(f"{order}{len(upwards)}f", *upwards))


def colmap(planes):
    width, height = len(planes[0][0]), len(planes[0])
    values = [v for plane in planes for v in flat(plane)]
    return f"{width}&{height}&{len(planes)}&".encode() + struct.pack(f"<{len(values)}f", *values)


def dmb(planes):
    width, height = len(planes[0][0]), len(planes[0])
    values = [plane[y][x] for y in range(height) for x in range(width) for plane in planes]
    return (struct.pack("<4i", 1, height, width, len(planes))
            + struct.pack(f"<{len(values)}f", *values))


def plane_of(value):
    return [[value] * WIDTH for _ in range(HEIGHT)]


FACING = [plane_of(0.6), plane_of(0.0), plane_of(-0.8)]
SHAPE = f"({HEIGHT}, {WIDTH})"

for v in VIEWS:
    stem, table = f"{v:04d}", rows(v)
    # VGGT: z in its own scale; confidences are 1 + exp(...)
    save(f"vggt/depth_vggt/{stem}_pred.npy", npy("<f4", SHAPE, flat(table)))
    save(f"vggt/depth_vggt/{stem}_conf.npy", npy("<f4", SHAPE, [4.0] * WIDTH * HEIGHT))
    save(f"vggt/normal/{stem}_normal.npy",
         npy("<f4", f"({HEIGHT}, {WIDTH}, 3)", [0.6, 0.0, -0.8] * WIDTH * HEIGHT))
    # Marigold: half precision; the numbers of the first view are exact in it
    save(f"marigold/depth_npy/{stem}_pred.npy", npy("<f2", SHAPE, flat(table)))
    save(f"marigold_png/depth_bw/{stem}_depth.png", png(table, 16))
    # Depth Anything: 8 bits, grey in three channels; the second view's numbers would not fit
    save(f"depth_anything/vis_depth/{stem}.png",
         png([[[n - 100 * v] * 3 for n in row] for row in table], 8, 2))
    save(f"depth_anything_npy/depth_npy/{stem}.npy",
         npy(">f8", f"(1, {HEIGHT}, {WIDTH})", flat(table), version=2))
    save(f"3dgs/depths/{stem}.png", png(table, 16))
    save(f"colmap/stereo/depth_maps/{stem}.png.geometric.bin", colmap([table]))
    save(f"colmap/stereo/depth_maps/{stem}.png.photometric.bin", colmap([plane_of(9.0)]))
    save(f"colmap/stereo/normal_maps/{stem}.png.geometric.bin", colmap(FACING))
    save(f"pgsr/renders_depth/{stem}.npy",
         npy("<f4", SHAPE, [table[y][x] for x in range(WIDTH) for y in range(HEIGHT)], fortran=True))
    save(f"mvsnet/depth_est/{v:08d}.pfm", pfm(table, "<" if v == 1 else ">"))
    save(f"mvsnet/confidence/{v:08d}.pfm", pfm(plane_of(0.75)))
    save(f"midas/midas/{stem}-dpt_large_384.pfm", pfm(table))
    save(f"metric3d/metric3d/{stem}.png", png(table, 16))
    save(f"acmm/ACMM/2333_{v:08d}/depths_geom.dmb", dmb([table]))
    save(f"acmm/ACMM/2333_{v:08d}/depths.dmb", dmb([plane_of(9.0)]))
    save(f"acmm/ACMM/2333_{v:08d}/normals.dmb", dmb(FACING))
    # Omnidata for MonoSDF: the middle square, normals as (n + 1) / 2, channels first
    save(f"omnidata/{stem}_depth.npy", npy("<f4", "(1, 6, 6)", flat(rows(v, 6, 6))))
    save(f"omnidata/{stem}_normal.npy",
         npy("<f4", "(3, 6, 6)", [0.8] * 36 + [0.5] * 36 + [0.1] * 36))
    # The neutral folder
    save(f"neutral/priors/z/{stem}.pfm", pfm(table))
    save(f"neutral/priors/n/{stem}.png", png([[[204, 128, 26]] * WIDTH] * HEIGHT, 8, 2))
    save(f"neutral/priors/sky/{stem}.png", png([[255] * WIDTH] + [[0] * WIDTH] * (HEIGHT - 1), 8))
    save(f"neutral/priors/features/{stem}.npy",
         npy("<f4", "(2, 3, 4)", [float(c * 100 + 10 * y + x)
                                  for c in range(2) for y in range(3) for x in range(4)]))
    save(f"neutral/priors/confidence/{stem}.npy", npy("|u1", SHAPE, [1] * WIDTH * HEIGHT))

save("3dgs/sparse/0/depth_params.json",
     json.dumps({"0001": {"scale": 2.0, "offset": 0.25}, "0002": {"scale": 3.0, "offset": -0.5}}))
save("nerfstudio/transforms.json", json.dumps({
    "fl_x": 9, "frames": [
        {"file_path": "./images/0001.png", "depth_file_path": "./d/one.png"},
        {"file_path": "./images/0002.png", "depth_file_path": "d/two.npy"}]}))
save("nerfstudio/d/one.png", png(rows(1), 16))
save("nerfstudio/d/two.npy", npy("<u2", f"({HEIGHT}, {WIDTH}, 1)", flat(rows(2))))
save("neutral/priors/priors.json", json.dumps({
    "version": 1,
    "depth": {"dir": "z", "encoding": "pfm", "quantity": "log_depth", "geometry": "ray",
              "alignment": "scale", "png_scale": 0.5, "invalid": [111], "producer": "by hand",
              "per_image": {"0002": {"scale": 3, "shift": -1, "crop": [2, 0, 4, 3]}}},
    "confidence": {"dir": "confidence", "encoding": "npy", "range": "unit"},
    "normal": {"dir": "n", "encoding": "png8", "frame": "camera_opengl", "facing": "away",
               "range": "unit"},
    "features": {"dir": "features", "encoding": "npy", "layout": "chw", "stride": [1, 2],
                 "l2_normalised": True},
    "sky": {"dir": "sky"},
    "pairs": "pair.txt"}, indent=1))
