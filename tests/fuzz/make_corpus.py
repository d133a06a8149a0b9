#!/usr/bin/env python3
"""Writes the seeds of the fuzz tests: small files of every kind that the readers accept or refuse.

    python3 tests/fuzz/make_corpus.py FOLDER

The readers have to read files named good_* without an error. tests/fuzz/corpus holds files that
broke a reader once, found_*; these are copied to FOLDER. Needs Python's standard library only.
"""
import gzip
import io
import json
import math
import pathlib
import shutil
import struct
import sys
import zipfile
import zlib

if len(sys.argv) != 2:
    sys.exit("usage: make_corpus.py FOLDER")
OUT = pathlib.Path(sys.argv[1])
shutil.copytree(pathlib.Path(__file__).parent / "corpus", OUT, dirs_exist_ok=True)


def seed(target, name, data):
    folder = OUT / target
    folder.mkdir(parents=True, exist_ok=True)
    (folder / name).write_bytes(data.encode() if isinstance(data, str) else data)


# COLMAP
def camera(i, model, params):
    return struct.pack("<IiQQ", i, model, 64, 48) + struct.pack(f"<{len(params)}d", *params)


def image(i, name, observations):
    return (struct.pack("<I7dI", i, 1, 0, 0, 0, 0.5 * i, 0, 0, 1) + name + b"\0"
            + struct.pack("<Q", observations) + observations * struct.pack("<ddQ", 3, 4, 1))


def point(i, track):
    return (struct.pack("<Q3d3Bd", i, 0.1 * i, 0.2, 3, 10, 20, 30, 0.5)
            + struct.pack("<Q", len(track)) + b"".join(struct.pack("<II", t, 0) for t in track))


seed("colmap_cameras_bin", "good_pinhole", struct.pack("<Q", 1) + camera(1, 1, [60, 60, 32, 24]))
seed("colmap_cameras_bin", "good_distorted", struct.pack("<Q", 2)
     + camera(1, 4, [60, 60, 32, 24, 0.1, 0.01, 0.001, 0.002])
     + camera(2, 5, [60, 60, 32, 24, 0.1, 0, 0, 0]))
seed("colmap_cameras_bin", "unknown_model", struct.pack("<Q", 1) + camera(1, 7, [60, 60, 32, 24, 1]))
seed("colmap_cameras_txt", "good_pinhole", "# cameras\n1 PINHOLE 64 48 60 60 32 24\n")
seed("colmap_cameras_txt", "good_bom_crlf",
     b"\xef\xbb\xbf# cameras\r\n1 FULL_OPENCV 64 48 60 60 32 24 .1 .01 0 0 1e-3 0 0 0\r\n")
seed("colmap_cameras_txt", "unknown_model", "1 EUCM 64 48 60 60 32 24 .5 1\n")
seed("colmap_images_bin", "good_two", struct.pack("<Q", 2) + image(1, b"a.png", 2)
     + image(2, b"sub/b c.png", 0))
seed("colmap_images_bin", "bad_name", struct.pack("<Q", 1) + image(1, b"../a.png", 1))
seed("colmap_images_txt", "good_two",
     "# images\n1 1 0 0 0 0 0 0 1 a.png\n1.5 2 7 3 4 -1\n2 .5 .5 .5 .5 1 2 3 1 b c.png\n\n")
seed("colmap_images_txt", "bad_pose", "1 0 0 0 0 nan 0 0 1 a.png\n\n")
seed("colmap_points_bin", "good_two",
     struct.pack("<Q", 2) + point(1, [1, 2]) + point(2, []))
seed("colmap_points_txt", "good_two",
     "# points\n1 0.1 0.2 3 10 20 30 0.5 1 0 2 0\n2 1e10 0 nan 0 0 0 0\n")

# PLY
SPLAT = (["x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2"]
         + [f"f_rest_{i}" for i in range(9)]
         + ["opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"])


def header(form, vertices, properties, extra=""):
    return (f"ply\nformat {form} 1.0\ncomment of a test\nelement vertex {vertices}\n"
            + "".join(f"property {p}\n" for p in properties) + extra + "end_header\n").encode()


row = [0.1, 0.2, 3, 0, 0, 0, 0.3, 0.2, 0.1] + 9 * [0.01] + [1.5, -3, -3.1, -5, 1, 0, 0, 0]
splat_properties = [f"float {p}" for p in SPLAT]
seed("ply_splats", "good_binary", header("binary_little_endian", 2, splat_properties)
     + struct.pack("<26f", *row) + struct.pack("<26f", *[2 * v for v in row]))
seed("ply_splats", "good_text", header("ascii", 1, splat_properties)
     + (" ".join(map(str, row)) + "\n").encode())
seed("ply_splats", "not_finite", header("binary_little_endian", 1, splat_properties)
     + struct.pack("<26f", *([math.nan] + row[1:])))
FACES = "element face 2\nproperty list uchar int vertex_indices\nproperty uchar flag\n"
corners = ["float x", "float y", "float z", "uchar red", "uchar green", "uchar blue"]
seed("ply_mesh", "good_text", header("ascii", 4, corners, FACES)
     + b"0 0 0 255 0 0\n1 0 0 0 255 0\n1 1 0 0 0 255\n0 1 0 9 9 9\n3 0 1 2 1\n4 0 1 2 3 0\n")
seed("ply_mesh", "good_big_endian",
     header("binary_big_endian", 3, ["double x", "double y", "double z", "float confidence"],
            "element face 1\nproperty list ushort uint vertex_index\n")
     + b"".join(struct.pack(">3df", i, i * i, 1, 0.5) for i in range(3))
     + struct.pack(">H3I", 3, 0, 1, 2))
seed("ply_mesh", "lists_first",
     b"ply\nformat ascii 1.0\nelement strips 1\nproperty list int int s\nelement vertex 1\n"
     b"property float x\nproperty float y\nproperty float z\nproperty double nx\n"
     b"property double ny\nproperty double nz\nend_header\n3 1 2 3\n0 0 1 0 0 1\n")
seed("ply_mesh", "bad_face", header("ascii", 1, corners[:3], FACES) + b"0 0 0\n3 0 1 9 1\n")


# NumPy
def npy(descr, shape, data, fortran=False, version=1):
    text = f"{{'descr': '{descr}', 'fortran_order': {fortran}, 'shape': {shape}, }}"
    start = 10 if version == 1 else 12
    text += " " * (-(start + len(text) + 1) % 64) + "\n"
    size = struct.pack("<H" if version == 1 else "<I", len(text))
    return b"\x93NUMPY" + bytes([version, 0]) + size + text.encode() + data


def npz(arrays, method):
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", method) as archive:
        for name, data in arrays.items():
            archive.writestr(zipfile.ZipInfo(name + ".npy"), data, method)
    return out.getvalue()


def matrix(values):
    return npy("<f8", "(4, 4)", struct.pack("<16d", *values))


seed("npy", "good_float32", npy("<f4", "(2, 3)", struct.pack("<6f", *range(6))))
seed("npy", "good_big_endian_fortran", npy(">i2", "(2, 2)", struct.pack(">4h", 1, 2, 3, 4), True, 2))
seed("npy", "good_text", npy("<U3", "()", "abc".encode("utf-32-le")))
seed("npy", "good_bool_empty", npy("|b1", "(0,)", b"", False, 3))
seed("npy", "objects", npy("|O", "(1,)", b"\x80\x03]q\x00."))
arrays = {"a": npy("<f4", "(2,)", struct.pack("<2f", 1, 2)), "b": npy("<i8", "()", bytes(8))}
seed("npz", "good_stored", npz(arrays, zipfile.ZIP_STORED))
seed("npz", "good_deflated", npz(arrays, zipfile.ZIP_DEFLATED))
world = [60, 0, 32, 10, 0, 60, 24, 20, 0, 0, 1, 3, 0, 0, 0, 1]
scale = [2, 0, 0, 1, 0, 2, 0, 1, 0, 0, 2, 1, 0, 0, 0, 1]
cameras = {f"{kind}_mat_{i}": matrix(m)
           for i in range(2) for kind, m in (("world", world), ("scale", scale))}
seed("npz_cameras", "good_two", npz(cameras, zipfile.ZIP_STORED))
seed("npz_cameras", "no_world", npz({"scale_mat_0": matrix(scale)}, zipfile.ZIP_STORED))


# safetensors
def safetensors(header, data):
    return struct.pack("<Q", len(header)) + header.encode() + data


half = '"dtype": "F16", "shape": [2, 1], "data_offsets": [0, 4]'
seed("safetensors", "good_two", safetensors(
    '{"__metadata__": {"a": "b"}, "x": {%s}, "y": {"dtype": "F64", "shape": [], '
    '"data_offsets": [4, 12]}}' % half, struct.pack("<2ed", 1, math.inf, 0.1)))
seed("safetensors", "overlap", safetensors('{"x": {%s}, "y": {%s}}' % (half, half), bytes(4)))

# MATLAB: version 4, then 5
def element(kind, data):
    return struct.pack("<II", kind, len(data)) + data + b"\0" * (-len(data) % 8)


mask = struct.pack("<4d", 1, 0, 1, 1)
seed("mat", "v4", struct.pack("<5i", 0, 2, 2, 0, 8) + b"ObsMask\0" + mask)
body = (element(6, struct.pack("<II", 6, 0)) + element(5, struct.pack("<2i", 2, 2))
        + element(1, b"ObsMask") + element(9, mask))
head = b"MATLAB 5.0 MAT-file".ljust(116, b" ") + bytes(8) + struct.pack("<H2s", 0x0100, b"IM")
seed("mat", "good_v5", head + element(14, body))
small = (element(6, struct.pack("<II", 0x209, 0)) + element(5, struct.pack("<2i", 2, 2))
         + element(1, b"ObsMask") + struct.pack("<I4B", 4 << 16 | 2, 1, 0, 1, 1))
other = (element(6, struct.pack("<II", 2, 0)) + element(5, struct.pack("<2i", 1, 1))
         + element(1, b"s") + struct.pack("<II", 4 << 16 | 5, 8) + element(1, b"field\0\0\0"))
seed("mat", "good_small_after_structure", head + element(14, other) + element(14, small))
big = (struct.pack(">4I", 6, 8, 6, 0) + struct.pack(">2I2i", 5, 8, 1, 2)
       + struct.pack(">II", 1, 7) + b"ObsMask\0" + struct.pack(">II2d", 9, 16, 3, math.pi))
seed("mat", "good_big_endian", head[:124] + b"\1\0MI" + struct.pack(">II", 14, len(big)) + big)
packed = zlib.compress(element(14, body))
seed("mat", "good_v5_compressed", head + struct.pack("<II", 15, len(packed)) + packed)

# Tanks and Temples
IDENTITY = "1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n"
seed("tnt_log", "good_two", "0 0 1\n" + IDENTITY + "1 -1 2\n" + IDENTITY)
seed("tnt_log", "cut", "0 0 1\n1 0 0 0\n0 1 0 0\n")
seed("tnt_trans", "good_matrix", "0.5 0 0 1e1\n0 5e-1 0 -2\n0 0 .5 3\n0 0 0 1\n")
seed("tnt_log", "good_bom_crlf", b"\xef\xbb\xbf" + ("0 0 1\n" + IDENTITY).replace("\n", "\r\n").encode())
seed("tnt_trans", "good_bom_crlf", b"\xef\xbb\xbf" + IDENTITY.replace("\n", "\r\n").encode())
seed("tnt_trans", "last_row", "1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 1 1\n")
seed("crop", "good_prism", json.dumps({
    "class_name": "SelectionPolygonVolume", "orthogonal_axis": "Y", "axis_min": -1, "axis_max": 2,
    "bounding_polygon": [[0, 0, 0], [1, 0, 0], [1, 0, 1]], "version_major": 1}))
seed("crop", "good_box", '{"box": [[-1, -1, -1], [1, 1, 1]]}')
seed("crop", "good_cylinder",
     '{"crop_cylinder": {"center_xy": [0, 1], "radius": 2, "z_min": 0, "z_max": 1}}')
seed("control_list", "good_named", "EPSG:32611\n1 2 3 4 5 a.jpg p1\n1 2 3 6 7 b.jpg p1\n# no point\n")
seed("control_list", "good_bom_crlf", b"\xef\xbb\xbfWGS84 UTM 32N\r\n1e6 5e6 -3\t4 5 a.jpg\r\n")
seed("control_list", "good_degrees", "+proj=longlat +datum=WGS84\n11.5 48.1 500 4 5 a.jpg p1 x\n")
seed("control_list", "columns", "EPSG:32611\n1 2 3 nan a.jpg\n")
seed("georeference", "good_utm", '{"projection": "EPSG:32611", "origin": [235264, 3811210.5, 0]}')
seed("georeference", "two_lines", '{"projection": "EPSG:\\n1", "origin": [1, 2]}')

# Scenes
frames = [{"file_path": f"images/{i}.png",
           "transform_matrix": [[1, 0, 0, i], [0, 1, 0, 0], [0, 0, 1, 4], [0, 0, 0, 1]]}
          for i in range(2)]
seed("nerfstudio", "good_pinhole", json.dumps(
    {"w": 64, "h": 48, "fl_x": 60, "fl_y": 61, "cx": 32, "cy": 24, "camera_model": "PINHOLE",
     "frames": frames, "train_filenames": ["images/0.png"], "ply_file_path": "sparse.ply"}))
seed("nerfstudio", "good_bom_crlf", b"\xef\xbb\xbf" + json.dumps(
    {"w": 64, "h": 48, "fl_x": 60, "frames": frames}, indent=1).replace("\n", "\r\n").encode())
seed("nerfstudio", "good_per_frame", json.dumps(
    {"frames": [dict(f, w=8, h=6, fl_x=9, k1=0.1, mask_path="masks/0.png") for f in frames]}))
seed("nerfstudio", "fisheye", json.dumps(
    {"w": 64, "h": 48, "camera_angle_x": 1.2, "camera_model": "OPENCV_FISHEYE", "k1": 0.01,
     "frames": frames}))
seed("blender", "good_angle", json.dumps(
    {"camera_angle_x": 0.7, "frames": [dict(f, file_path="./image") for f in frames[:1]]}))
MVSNET = ("extrinsic\n" + IDENTITY + "\nintrinsic\n60 0 4\n0 60 3\n0 0 1\n\n425 2.5 192 900\n")
seed("mvsnet", "good_camera", MVSNET)
seed("mvsnet", "good_bom_crlf", b"\xef\xbb\xbf" + MVSNET.replace("\n", "\r\n").encode())
seed("mvsnet", "no_intrinsic", "extrinsic\n" + IDENTITY)
seed("view_list", "good_names", "\ufeff# some\r\na/0.png\n c d\r\n")
seed("view_list", "ambiguous", "0\n0.png\n")
seed("lists", "good_lists", '{"train": ["a.png", "b"], "test": [3, 4], "other": {"x": 1}}')
seed("json", "good_report", '{"a": [1, 2.5e-3, null, true], "b": {"c": "\\u00e9\\n"}, "d": -0}')
seed("config", "good_nested",
     '{"comment": "x", "tv": {"k": 20, "whiten": false}, "loss.flatten.weight": 1e2, '
     '"densify": {"max_gaussians": 100}, "backbone": "ewa", "info": {"version": "1"}}')
seed("config", "unknown_key", '{"tv": {"kk": 20}}')
seed("config", "twice", '{"tv": {"k": 20}, "tv.k": 3}')


# Checkpoints
def checkpoint(entries):
    table, data = b"", b""
    for name, size, real, content in entries:
        table += (struct.pack("<I", len(name)) + name
                  + struct.pack("<IBQI", size, real, len(content), zlib.crc32(content)))
        data += content
    head = b"TVSGSCKP" + struct.pack("<IIQI", 1, len(table), 28 + len(table) + 4 + len(data),
                                     len(entries)) + table
    return head + struct.pack("<I", zlib.crc32(head)) + data


seed("checkpoint", "good_two", checkpoint([(b"means", 12, 1, struct.pack("<6f", *range(6))),
                                           (b"iterations", 4, 0, struct.pack("<i", 7))]))
seed("checkpoint", "good_none", checkpoint([]))


# Images
def png(width, height, depth, color, rows, extra=b""):
    def chunk(kind, data):
        return (struct.pack(">I", len(data)) + kind + data
                + struct.pack(">I", zlib.crc32(kind + data)))
    return (b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, depth,
                                                             color, 0, 0, 0))
            + extra + chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b""))


seed("image", "good_rgb", png(3, 2, 8, 2, 2 * (b"\0" + bytes(range(9)))))
seed("image", "good_grey16", png(2, 2, 16, 0, 2 * (b"\1" + bytes(4))))
seed("image", "good_alpha", png(1, 2, 8, 6, 2 * (b"\2" + bytes([9, 8, 7, 6]))))
seed("image", "claims_much", png(60000, 60000, 8, 2, b"\0"))
bmp = struct.pack("<2sIHHIIiiHHIIiiII", b"BM", 70, 0, 0, 54, 40, 2, 2, 1, 24, 0, 16, 1, 1, 0, 0)
seed("image", "good_bmp", bmp + bytes(range(16)))
seed("image", "jpeg_without_image", b"\xff\xd8\xff\xd9")
# A place: latitude, longitude and height.
place = (struct.pack("<4sI", b"II*\0", 8) + struct.pack("<HHHIII", 1, 0x8825, 4, 1, 26, 0)
         + struct.pack("<HHHI4sHHII", 6, 1, 2, 2, b"N", 2, 5, 3, 104)
         + struct.pack("<HHI4sHHII", 3, 2, 2, b"E", 4, 5, 3, 128)
         + struct.pack("<HHIIHHIII", 5, 1, 1, 0, 6, 5, 1, 152, 0)
         + struct.pack("<14I", 48, 1, 8, 1, 1425, 100, 11, 1, 34, 1, 305, 10, 1039, 2))
exif = b"Exif\0\0" + place
seed("exif", "good_place", b"\xff\xd8\xff\xe1" + struct.pack(">H", len(exif) + 2) + exif + b"\xff\xda")

# Priors
grid = [1, 2, 3, 4, 5, 6]
seed("map_pfm", "good_little", b"Pf\n3 2\n-1.0\n" + struct.pack("<6f", *grid))
seed("map_pfm", "good_big_endian", b"PF\n2 1\n1\n" + struct.pack(">6f", *grid))
seed("map_pfm", "claims_much", b"Pf\n30000 3000\n-1\n" + bytes(8))
seed("map_dmb", "good_depth", struct.pack("<4i6f", 1, 2, 3, 1, *grid))
seed("map_dmb", "good_normals", struct.pack("<4i6f", 1, 1, 2, 3, *grid))
seed("map_dmb", "negative", struct.pack("<4i6f", 1, -2, -3, 1, *grid))
seed("map_colmap", "good_depth", b"3&2&1&" + struct.pack("<6f", *grid))
seed("map_colmap", "good_normals", b"2&1&3&" + struct.pack("<6f", *grid))
seed("map_colmap", "claims_much", b"65535&65535&3&" + struct.pack("<6f", *grid))
seed("map_npy", "good_half", npy("<f2", "(1, 2, 3)", struct.pack("<6e", *grid)))
seed("map_npy", "good_normals", npy("<f4", "(2, 1, 3)", struct.pack("<6f", *grid)))
seed("map_npy", "empty", npy("<f4", "(0, 3)", b""))
seed("priors", "good_all", json.dumps({
    "version": 1,
    "depth": {"dir": "depth", "encoding": "pfm", "quantity": "inverse_depth", "geometry": "ray",
              "alignment": "affine", "png_scale": 0.001, "invalid": [0, -1], "producer": "x",
              "per_image": {"a/0002": {"scale": 2, "shift": 1, "crop": [0, 0, 8, 6]}}},
    "confidence": {"range": "ge1"}, "sky": {"dir": "sky"}, "features": {"layout": "chw"},
    "normal": {"encoding": "png8", "frame": "world", "facing": "away", "range": "unit"},
    "pairs": "pair.txt"}))
seed("priors", "good_least", '{"depth": {}}')
seed("priors", "wrong", '{"depth": {"dir": "../..", "quantity": 7}}')
seed("depth_params", "good_one", '{"0001": {"scale": 1.5, "offset": -0.25}}')
seed("depth_params", "none", '{"0002": {"scale": 1.5, "offset": -0.25}}')
seed("depth_paths", "good_two", json.dumps(
    {"depth_unit_scale_factor": 0.002,
     "frames": [{"file_path": "./0001.png", "depth_file_path": "./d/0001.png"},
                {"file_path": "images/0002", "depth_file_path": "d/0002.npy"}, {}]}))


# Meshes as GLB and OBJ
def glb(doc, binary):
    text = json.dumps(doc).encode()
    text += b" " * (-len(text) % 4)
    binary += bytes(-len(binary) % 4)
    return (b"glTF" + struct.pack("<II", 2, 28 + len(text) + len(binary)) + struct.pack("<I", len(text)) + b"JSON"
            + text + struct.pack("<I", len(binary)) + b"BIN\0" + binary)


def tiny_png():
    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
    return (b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">IIBBBBB", 2, 2, 8, 2, 0, 0, 0))
            + chunk(b"IDAT", zlib.compress(2 * (b"\0" + 6 * b"\x80"))) + chunk(b"IEND", b""))


PNG = tiny_png()
TRIANGLE = struct.pack("<9f", 0, 0, 0, 1, 0, 0, 0, 1, 0)
OURS = {"asset": {"version": "2.0", "generator": "tvsgs 0.1.0", "extras": {"origin": [1, 2, 3], "vertices": 3}},
        "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0, "matrix": [1, 0, 0, 0, 0, 0, 1, 0, 0, -1, 0, 0, 0, 0, 0, 1]}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0, "TEXCOORD_0": 1}, "indices": 2, "material": 0}]}],
        "materials": [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}],
        "textures": [{"source": 0}], "images": [{"bufferView": 3, "mimeType": "image/png"}],
        "buffers": [{"byteLength": 68 + len(PNG)}],
        "bufferViews": [{"buffer": 0, "byteLength": 36}, {"buffer": 0, "byteOffset": 36, "byteLength": 24},
                        {"buffer": 0, "byteOffset": 60, "byteLength": 6},
                        {"buffer": 0, "byteOffset": 68, "byteLength": len(PNG)}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "type": "VEC3", "count": 3},
                      {"bufferView": 1, "componentType": 5126, "type": "VEC2", "count": 3},
                      {"bufferView": 2, "componentType": 5123, "type": "SCALAR", "count": 3}]}
seed("mesh_glb", "good_ours", glb(OURS, TRIANGLE + struct.pack("<6f", 0, 0, 1, 0, 0, 1) + struct.pack("<4H", 0, 1, 2, 0) + PNG))
seed("mesh_glb", "good_nodes", glb(
    {"asset": {"version": "2.0"}, "scenes": [{"nodes": [0]}],
     "nodes": [{"children": [1], "rotation": [0, 0, 1, 0]}, {"mesh": 0, "scale": [2, 2, 2], "translation": [1, 0, 0]}],
     "meshes": [{"primitives": [{"attributes": {"POSITION": 0, "COLOR_0": 1}}]}], "buffers": [{"byteLength": 48}],
     "bufferViews": [{"buffer": 0, "byteLength": 36}, {"buffer": 0, "byteOffset": 36, "byteLength": 12, "byteStride": 4}],
     "accessors": [{"bufferView": 0, "componentType": 5126, "type": "VEC3", "count": 3},
                   {"bufferView": 1, "componentType": 5121, "type": "VEC4", "count": 3, "normalized": True}]},
    TRIANGLE + bytes(range(12))))
seed("mesh_obj", "good_textured", "# by hand\nmtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 .5\nvt 0 1\nf 1/1 2/1 3/1 4/1\nf -1 -2 -3\n")
seed("mesh_obj", "good_colours", "v 0 0 0 1 0 0\nv 1 0 0 0 1 0\nv 1e3 1 0 0 0 1\nf 1//1 2//1 3//1\n")


# SPZ: in gzip, and its content alone
def spz(version, degree, count, flags=0):
    rotation, rest = 3 if version == 2 else 4, (degree + 1) ** 2 - 1
    return (struct.pack("<4sIIBBBB", b"NGSP", version, count, degree, 12, flags, 0)
            + bytes(i % 251 for i in range(count * (9 + 1 + 3 + 3 + rotation + 3 * rest))))


seed("spz", "good_v2", gzip.compress(spz(2, 0, 2), mtime=0))
seed("spz", "good_v3", gzip.compress(spz(3, 3, 3) + b"more", mtime=0))
seed("spz", "inside_v2", spz(2, 3, 2))
seed("spz", "inside_v3", spz(3, 1, 3))
seed("spz", "inside_degree_4", spz(3, 4, 1, 1))
seed("spz", "inside_v4", spz(4, 0, 1))


def spz4(degree, count):
    """Version 4: a frame of zstd for each array, each of one block that is not packed."""
    rest = (degree + 1) ** 2 - 1
    sizes = [count * width for width in (9, 1, 3, 3, 4, 3 * rest) if width]
    frames = [b"\x28\xb5\x2f\xfd\xa0" + struct.pack("<I", n) + struct.pack("<I", n << 3 | 1)[:3]
              + bytes(i % 251 for i in range(n)) for n in sizes]
    head = struct.pack("<4sIIBBBBI12x", b"NGSP", 4, count, degree, 12, 0, len(sizes), 32)
    return head + b"".join(struct.pack("<QQ", len(f), n) for f, n in zip(frames, sizes)) + b"".join(frames)


seed("spz", "frames_v4", spz4(0, 2))
seed("spz", "frames_v4_degree_3", spz4(3, 2))


# Splats in GLB
def splat_glb(degree, extras):
    columns = [("POSITION", "VEC3", 3), ("KHR_gaussian_splatting:ROTATION", "VEC4", 4),
               ("KHR_gaussian_splatting:SCALE", "VEC3", 3), ("KHR_gaussian_splatting:OPACITY", "SCALAR", 1)]
    columns += [(f"KHR_gaussian_splatting:SH_DEGREE_{l}_COEF_{n}", "VEC3", 3)
                for l in range(degree + 1) for n in range(2 * l + 1)]
    binary, views, accessors = b"", [], []
    for i, (_, kind, width) in enumerate(columns):
        data = struct.pack(f"<{2 * width}f", *((j + i) % 7 / 8 for j in range(2 * width)))
        views.append({"buffer": 0, "byteOffset": len(binary), "byteLength": len(data)})
        accessors.append({"bufferView": i, "componentType": 5126, "type": kind, "count": 2})
        binary += data
    return glb({"asset": {"version": "2.0", **extras}, "nodes": [{"mesh": 0}],
                "extensionsUsed": ["KHR_gaussian_splatting"], "buffers": [{"byteLength": len(binary)}],
                "bufferViews": views, "accessors": accessors,
                "meshes": [{"primitives": [{
                    "attributes": {name: i for i, (name, _, _) in enumerate(columns)}, "mode": 0,
                    "extensions": {"KHR_gaussian_splatting": {"kernel": "ellipse"}}}]}]}, binary)


seed("splat_glb", "good_others", splat_glb(0, {}))
seed("splat_glb", "good_ours", splat_glb(
    1, {"generator": "tvsgs 0.1.0", "extras": {"origin": [1, 2, 3], "splats": 2}}))


# SOG, with pictures of one colour: lossless WebP whose codes have one symbol and take no bits
def one_color(width, height, red, green, blue, alpha):
    value, bits = 0, 0

    def put(number, count):
        nonlocal value, bits
        value |= number << bits
        bits += count

    put(0x2f, 8), put(width - 1, 14), put(height - 1, 14), put(1, 1), put(0, 3)
    put(0, 1), put(0, 1), put(0, 1)  # no transform, no cache of colours, one group of codes
    for symbol in (green, red, blue, alpha, 0):
        put(1, 1), put(0, 1), put(1, 1), put(symbol, 8)
    data = value.to_bytes(bits // 8 + 1, "little")
    data += b"\0" * (len(data) % 2)
    chunk = b"WEBPVP8L" + struct.pack("<I", len(data)) + data
    return b"RIFF" + struct.pack("<I", len(chunk)) + chunk


def sog_meta(names):
    codebook = [i / 256 for i in range(256)]
    return {"version": 2, "count": 3, "means": {"mins": [0, 0, 0], "maxs": [1, 1, 2], "files": names[:2]},
            "scales": {"codebook": codebook, "files": names[2:3]}, "quats": {"files": names[3:4]},
            "sh0": {"codebook": codebook, "files": names[4:5]},
            "shN": {"count": 2, "bands": 1, "codebook": codebook, "files": names[5:]}}


def sog(meta, pictures):
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_STORED) as archive:
        for name, content in [("meta.json", json.dumps(meta))] + pictures:
            archive.writestr(zipfile.ZipInfo(name, (1980, 1, 1, 0, 0, 0)), content)
    return out.getvalue()


SMALL, WIDE = one_color(4, 4, 1, 2, 3, 253), one_color(192, 1, 9, 8, 7, 255)
NAMES = ["means_l", "means_u", "scales", "quats", "sh0", "centroids", "labels"]
PICTURES = [(name, WIDE if name == "centroids" else SMALL) for name in NAMES]
seed("sog", "good_one_colour", sog(sog_meta(NAMES), PICTURES))
seed("sog", "no_pictures", sog(sog_meta(NAMES), PICTURES[:3]))
seed("sog", "inside_meta", json.dumps(sog_meta(7 * ["a.webp"])))
