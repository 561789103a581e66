"""Hostile meshes, scans, images, archives, bags and campaign folders: negative and huge counts, pipes, bombs, wrong checksums.

python -m tests.hostile.attacks --verbose
"""

import bz2
import io
import json
import lzma
import os
import shutil
import socket
import struct
import zipfile
import zlib
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np

from .campaign import campaign, parser
from .case import Case
from .changes import Change, Data, both, bytes_of, content, instead, sparse, unchanged

Build = Callable[[Path], object]
TABLE = b"time_s,wx,wy,wz\n" + b"".join(b"%.1f,1,%.2f,0.3\n" % (0.1 * k, 0.1 * k) for k in range(20))
CUBE = [(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)]
FACES = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
LONG = "0." + "0" * 40 + "1"


def attack_cases() -> list[Case]:
    """All of them."""
    return [*_meshes(), *_scans(), *_images(), *_archives(), *_bags(), *_campaigns(), *_texts()]


# Meshes and scans


def _scan_of(name: str) -> tuple[str, ...]:
    return ("lidar", "scan", "{in}/" + name, "-o", "{out}/scan", "--rays", "8", "8")


def _meshes() -> Iterator[Case]:
    for name, data in {**_plys(), **_stls(), **_objs()}.items():
        file = f"x.{name.split(':')[0]}"
        yield Case(f"mesh {name}", "gyro", content(file, data), _scan_of(file))
    for suffix in ("ply", "stl", "obj", "tab", "txt"):
        for what, build in no_files().items():
            yield Case(
                f"mesh {suffix} is {what}", "gyro", instead(f"x.{suffix}", build), _scan_of(f"x.{suffix}")
            )


def no_files() -> dict[str, Build]:
    return {
        "a pipe": os.mkfifo,
        "a socket": _socket,
        "endless": lambda path: path.symlink_to("/dev/zero"),
        "a folder": Path.mkdir,
        "a loop of links": lambda path: path.symlink_to(path.name),
        "of 3 GB": sparse(3 << 30),
        "of 60 MB of zeros": sparse(60 << 20),
        "empty": Path.touch,
    }


def _socket(path: Path) -> None:
    with socket.socket(socket.AF_UNIX) as server:
        here = os.getcwd()
        os.chdir(path.parent)  # paths of sockets are short
        try:
            server.bind(path.name)
        finally:
            os.chdir(here)


def _ply(
    vertices: int = 8,
    faces: int = 6,
    list_type: str = "uchar int",
    body: bytes | None = None,
    form: str = "binary_little_endian",
    more: str = "",
) -> bytes:
    head = (
        f"ply\nformat {form} 1.0\n{more}element vertex {vertices}\nproperty float x\nproperty float y\nproperty float z\n"
        f"element face {faces}\nproperty list {list_type} vertex_indices\nend_header\n"
    )
    return head.encode() + (_ply_body(list_type) if body is None else body)


def _ply_body(list_type: str = "uchar int", count: int = 4, first: int = 0) -> bytes:
    letters = {"uchar": "B", "char": "b", "int": "i", "float": "f", "uint": "I", "double": "d"}
    size, item = (letters[word] for word in list_type.split())
    rows = [struct.pack(f"<{size}4{item}", count, face[0] + first, *face[1:]) for face in FACES]
    return np.array(CUBE, "<f4").tobytes() + b"".join(rows)


def _ascii_ply(corner: str = "1", face: str = "4 0 1 3 2", vertices: int = 8, end: str = "\n") -> bytes:
    rows = [f"{corner if k == 7 else x} {y} {z}" for k, (x, y, z) in enumerate(CUBE)]
    rows += [face, *(" ".join(map(str, (4, *each))) for each in FACES[1:])]
    return (
        _ply(vertices, form="ascii", body=b"").replace(b"\n", end.encode()) + end.join([*rows, ""]).encode()
    )


def _plys() -> dict[str, bytes]:
    points = np.array(CUBE, "<f4").tobytes()
    minus = struct.pack("<i", -1)
    return {
        "ply: a list of -1": _ply(faces=10_000, list_type="int int", body=points + minus * 10_000),
        "ply: lists of -1 in 40 kB": _ply(faces=40_000, list_type="char int", body=points + b"\xff" * 40_000),
        "ply: a list of 4e9": _ply(list_type="uint int", body=points + b"\xff" * 400),
        "ply: a list of NaN": _ply(list_type="float int", body=points + struct.pack("<f", np.nan) * 99),
        "ply: a list of 1e30": _ply(list_type="float int", body=points + struct.pack("<f", 1e30) * 99),
        "ply: an index of NaN": _ply(
            list_type="uchar float", body=points + struct.pack("<B4f", 4, np.nan, 1, 2, 3) * 6
        ),
        "ply: an index of 1e30": _ply(
            list_type="uchar float", body=points + struct.pack("<B4f", 4, 1e30, 1, 2, 3) * 6
        ),
        "ply: an index of -5": _ply(body=_ply_body(first=-5)),
        "ply: an index of 2^31": _ply(list_type="uchar uint", body=_ply_body("uchar uint", first=2**31)),
        "ply: -1 vertices": _ply(vertices=-1),
        "ply: 1e18 vertices": _ply(vertices=10**18),
        "ply: vertices of 5000 digits": _ply(vertices=10**4000),
        "ply: more faces than there are": _ply(faces=200),
        "ply: truncated": _ply()[:-3],
        "ply: a format that is none": _ply(form="binary_middle_endian"),
        "ply: no format": _ply().replace(b"format binary_little_endian 1.0\n", b""),
        "ply: a property twice": _ply(more="").replace(b"float y", b"float x"),
        "ply: a property before any element": _ply(more="property float w\n"),
        "ply: an element without a number": _ply().replace(b"element face 6", b"element face"),
        "ply: an element without properties": _ply(more="element nothing 300\n"),
        "ply: a property of an unknown type": _ply().replace(b"float z", b"quad z"),
        "ply: a header without end": b"ply\nformat ascii 1.0\n" + b"comment x\n" * 200_000,
        "ply: only a header": _ply(body=b""),
        "ply: a number of 41 digits": _ascii_ply(corner=f"1{'0' * 40}e-40"),
        "ply: a number of 5000 digits": _ascii_ply(corner="9" * 5000),
        "ply: a NaN": _ascii_ply(corner="nan"),
        "ply: a number with underscores": _ascii_ply(corner="1_0"),
        "ply: other digits": _ascii_ply(corner="١"),
        "ply: an ASCII list of -1": _ascii_ply(face="-1 0 1 3 2"),
        "ply: an ASCII list of 1e9": _ascii_ply(face="1000000000 0 1 3 2"),
        "ply: an ASCII list too short": _ascii_ply(face="9 0 1 3 2"),
        "ply: an ASCII index of 1.5": _ascii_ply(face="4 0 1.5 3 2"),
        "ply: an ASCII index of 2^70": _ascii_ply(face=f"4 0 {2**70} 3 2"),
        "ply: old line ends": _ascii_ply(end="\r"),
        "ply: line ends of DOS": _ascii_ply(end="\r\n"),
        "ply: a byte order mark": b"\xef\xbb\xbf" + _ascii_ply(),
    }


def _stl(count: int = 12, body: bytes | None = None) -> bytes:
    triangles = [corner for a, b, c, d in FACES for corner in ((a, b, c), (a, c, d))]
    facets = b"".join(
        bytes(12) + np.array([CUBE[k] for k in corners], "<f4").tobytes() + bytes(2) for corners in triangles
    )
    return bytes(80) + struct.pack("<I", count) + (facets if body is None else body)


def _ascii_stl(number: str) -> bytes:
    rows = [
        "facet normal 0 0 0\nouter loop\n"
        + "".join(f"vertex {number} {y} {z}\n" for _, y, z in (CUBE[a], CUBE[b], CUBE[c]))
        + "endloop\nendfacet\n"
        for a, b, c, _ in FACES
    ]
    return f"solid x\n{''.join(rows)}endsolid x\n".encode()


def _stls() -> dict[str, bytes]:
    return {
        "stl: 2^32 - 1 triangles": _stl(count=2**32 - 1),
        "stl: no triangle": _stl(count=0, body=b""),
        "stl: truncated": _stl()[:-20],
        "stl: of NaN": _stl(count=1, body=b"\xff" * 50),
        "stl: ASCII with a number of 5000 digits": _ascii_stl("9" * 5000),
        "stl: ASCII with words": _ascii_stl("x"),
        "stl: ASCII with underscores": _ascii_stl("1_0"),
        "stl: a solid of blanks": b"solid facet vertex" + b" " * 2_000_000,
        "stl: a solid without end": b"solid x\n" + b"facet normal 0 0 0\n" * 50_000,
    }


def _obj(corner: str = "1", face: str = "1 2 4 3") -> bytes:
    rows = [f"v {corner if k == 7 else x} {y} {z}" for k, (x, y, z) in enumerate(CUBE)]
    rows += [f"f {face}", *("f " + " ".join(str(k + 1) for k in each) for each in FACES[1:])]
    return "\n".join([*rows, ""]).encode()


def _objs() -> dict[str, bytes]:
    counted = "8 12\n" + "\n".join(" ".join(map(str, corner)) for corner in CUBE)
    return {
        "obj: an index of 2^63": _obj(face=f"1 2 {2**63} 3"),
        "obj: an index of 2^64 below the last": _obj(face=f"1 2 -{2**64} 3"),
        "obj: an index of 5000 digits": _obj(face=f"1 2 {'9' * 5000} 3"),
        "obj: an index of 0": _obj(face="1 0 4 3"),
        "obj: an index that is not there": _obj(face="1 2 400 3"),
        "obj: an index of 1.5": _obj(face="1 2.5 4 3"),
        "obj: a coordinate of 5000 digits": _obj(corner="9" * 5000),
        "obj: a coordinate of 1e999": _obj(corner="1e999"),
        "obj: a NaN": _obj(corner="nan"),
        "obj: a face of a million corners": _obj(face=" ".join(["1"] * 1_000_000)),
        "obj: not UTF-8": _obj() + b"\xff\xfe\n",
        "obj: NUL bytes": _obj(corner="1\0"),
        "obj: in UTF-16": _obj().decode().encode("utf-16"),
        "obj: one endless line": b"v " + b"1 " * 3_000_000,
        "tab: an index of 2^63": _obj(face=f"1 2 {2**63} 3"),
        "tab: a face without end": b"f" + b" 1" * 500_000,
        "txt: 1e18 vertices": f"{10**18} 12\n".encode() + counted.encode(),
        "txt: -1 vertices": b"-1 12\n" + counted.encode(),
        "txt: more faces than there are": (counted + "\n1 2 3\n").encode(),
        "txt: an index of 2^70": f"8 1\n{counted[5:]}\n1 2 {2**70}\n".encode(),
        "txt: an index of 5000 digits": f"8 1\n{counted[5:]}\n1 2 {'9' * 5000}\n".encode(),
    }


def _scans() -> Iterator[Case]:
    """A data set of scans, which the first command of each case registers."""
    arguments = ("compare", "{in}/set", "-o", "{out}/run", "--estimators", "mekf")
    toml = content("set/dataset.toml", 'kind = "lidar-scans"\n')
    files: dict[str, Change] = {
        "none": unchanged,
        "a list of -1": content("set/scans/0.ply", _plys()["ply: a list of -1"]),
        "of points alone": content("set/scans/0.ply", _ply(faces=0)),
        "a name of 300 digits": content(f"set/scans/{'9' * 200}.ply", _ply()),
        "a pipe": both(content("set/scans/1.ply", _ply()), instead("set/scans/0.ply", os.mkfifo)),
        "of NaN": content("set/scans/0.ply", _ply(body=b"\xff" * 400, faces=0)),
        "metadata nested without end": content(
            "set/scans/0.ply", _ply(more=f"comment spinfilters-lidar {'[' * 50_000}\n")
        ),
    }
    for what, change in files.items():
        yield Case(f"scans: {what}", "gyro", both(toml, change), arguments)


# Images


def _png(width: int, height: int, data: bytes | None = None, bits: int = 8) -> bytes:
    def chunk(kind: bytes, body: bytes) -> bytes:
        return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))

    raw = zlib.compress(bytes((width * bits // 8 + 1) * height)) if data is None else data
    head = struct.pack(">IIBBBBB", width, height, bits, 0, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", raw) + chunk(b"IEND", b"")


def _jpeg() -> bytes:
    import cv2

    grey = np.random.default_rng(0).integers(0, 255, (120, 160)).astype(np.uint8)
    return cv2.imencode(".jpg", grey)[1].tobytes()


def _pictures() -> dict[str, Data]:
    jpeg, png = _jpeg(), _png(160, 120)
    start = jpeg.index(b"\xff\xc0")
    wide = jpeg[: start + 5] + struct.pack(">HH", 65_500, 65_500) + jpeg[start + 9 :]
    other = jpeg[: start + 5] + struct.pack(">HH", 1200, 1600) + jpeg[start + 9 :]
    noisy = bytearray(jpeg)
    noisy[len(jpeg) // 2 : len(jpeg) // 2 + 60] = b"\xff\x00" * 30
    return {
        "PNG of 1e5 x 1e5": _png(100_000, 100_000, zlib.compress(bytes(1000))),
        "PNG of 0 x 0": _png(0, 0, b""),
        "PNG of 2^31 x 1": _png(2**31 - 1, 1, zlib.compress(bytes(1000))),
        "PNG cut short": png[:-30],
        "PNG with too little data": _png(160, 120, zlib.compress(bytes(50))),
        "PNG with corrupt data": _png(160, 120, b"\x78\x9c" + bytes(50)),
        "PNG with a wrong checksum": png[:-5] + b"\0" + png[-4:],
        "PNG with a chunk of 4 GB": png[:33] + b"\xff\xff\xff\xff" + png[37:],
        "PNG bomb": lambda: _png(9_000, 9_000),
        "JPEG of 65500 x 65500": wide,
        "JPEG of another size": other,
        "JPEG cut short": jpeg[: len(jpeg) // 2] + b"\xff\xd9",
        "JPEG with corrupt data": bytes(noisy),
        "JPEG of a header alone": b"\xff\xd8\xff\xd9",
        "BMP of -2^31 x 1": b"BM" + bytes(12) + struct.pack("<IiiHH", 40, 1, -(2**31), 1, 8) + bytes(60),
        "PGM of 99999 x 99999": b"P5 99999 99999 255\n" + bytes(100),
        "PGM cut short": b"P5 160 120 255\n" + bytes(100),
        "TIFF whose directory is nowhere": b"II*\0\xff\xff\xff\xff" + bytes(60),
        "TIFF whose directory is itself": b"II*\0\x08\0\0\0\xff\xff" + bytes(60),
        "GIF": b"GIF89a\xff\xff\xff\xff\0\0\0,\0\0\0\0\xff\xff\xff\xff\0;",
        "EXR": b"\x76\x2f\x31\x01\x02\0\0\0" + bytes(100),
        "Radiance of 99999 x 99999": b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 99999 +X 99999\n" + bytes(50),
        "WebP": b"RIFF\xff\xff\0\0WEBPVP8L\xff\xff\0\0\x2f\xff\xff\xff\xff" + bytes(50),
        "JPEG 2000": b"\0\0\0\x0cjP  \r\n\x87\n" + bytes(100),
        "text": b"<html>404</html>",
        "of zeros": bytes(1000),
    }


def _images() -> Iterator[Case]:
    calibrate = ("calibrate", "{in}/b", "--corners", "9x6", "--square", "0.025", "-o", "{out}/rig", "--check")
    track = ("track", "{in}/t", "-o", "{out}/tracks")
    good = _jpeg()
    boards = both(
        *(content(f"b/{side}{k}.png", good) for side in ("left", "right") for k in range(4)),
    )
    sensor = (
        "sensor_type: camera\nT_BS:\n  cols: 4\n  rows: 4\n"
        "  data: [1.0,0.0,0.0,{},0.0,1.0,0.0,0.0,0.0,0.0,1.0,0.0,0.0,0.0,0.0,1.0]\n"
        "resolution: [160, 120]\ncamera_model: pinhole\nintrinsics: [150.0, 150.0, 80.0, 60.0]\n"
    )
    images = both(
        *(content(f"t/cam{k}/sensor.yaml", sensor.format(0.1 * k)) for k in (0, 1)),
        *(content(f"t/cam{k}/data/{stamp}000000000.png", good) for k in (0, 1) for stamp in range(1, 5)),
    )
    makes: dict[str, Build] = {what: _written(data) for what, data in _pictures().items()}
    makes |= {
        f"that is {what}": build for what, build in no_files().items() if what != "of 60 MB of zeros"
    } | {"that is a broken link": lambda path: path.symlink_to("nowhere")}
    for what, build in makes.items():
        yield Case(f"board: {what}", "gyro", both(boards, instead("b/left1.png", build)), calibrate)
        place = "t/cam0/data/2000000000.png"
        yield Case(f"image: {what}", "gyro", both(images, instead(place, build)), track)
    for what, build in no_files().items():
        place = "t/cam0/data.csv"
        yield Case(f"list of images: {what}", "gyro", both(images, instead(place, build)), track)
        place = "t/cam1/sensor.yaml"
        yield Case(f"camera of images: {what}", "gyro", both(images, instead(place, build)), track)


def _written(data: Data) -> Build:
    return lambda path: content(path.name, data)(path.parent)


# Archives


def _zip(*members: tuple[str, bytes], packing: int = zipfile.ZIP_STORED) -> bytes:
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", packing) as archive:
        for name, data in members:
            archive.writestr(zipfile.ZipInfo(name), data, packing)
    return stream.getvalue()


def _corrupt(archive: bytes, packed: bytes) -> bytes:
    """The archive with damaged bytes in the middle of what a member packs."""
    place = archive.index(b"gyro.csv") + len(b"gyro.csv") + len(packed) // 2
    return archive[:place] + bytes(255 - byte for byte in archive[place : place + 12]) + archive[place + 12 :]


def _zips() -> dict[str, Data]:
    whole = _zip(("gyro.csv", TABLE))
    end = whole.rindex(b"PK\x05\x06")
    return {
        "whole": whole,
        "truncated": whole[:-30],
        "cut in the middle": whole[: len(whole) // 2],
        "a member whose name has NUL": whole.replace(b"gyro.csv", b"gy\0o.csv"),
        "a member whose name ends in NUL": whole.replace(b"gyro.csv", b"gyr.csv\0"),
        "a member of the name NUL": whole.replace(b"gyro.csv", b"\0\0\0\0.csv"),
        "a name that differs within": whole.replace(b"gyro.csv", b"gyr0.csv", 1),
        "an absolute name": _zip(("/tmp/gyro.csv", TABLE)),
        "a name with ..": _zip(("../../gyro.csv", TABLE)),
        "a name with backslashes": _zip(("..\\gyro.csv", TABLE)),
        "a name of 5000 letters": _zip(("g" * 5000 + ".csv", TABLE)),
        "a name that is not UTF-8": whole.replace(b"gyro.csv", b"g\xff\xferr.c"[:4] + b".csv"),
        "a name with line feeds": _zip(("a\nb.csv", TABLE)),
        "a name twice": _zip(("gyro.csv", TABLE), ("x/../gyro.csv", TABLE), ("gyro.csv ", TABLE)),
        "a file that is a folder too": _zip(("a/b.csv", TABLE), ("a/b.csv/c.csv", TABLE)),
        "10000 members": lambda: _zip(*((f"{k}.csv", b"") for k in range(10_000))),
        "a bomb": lambda: _zip(
            ("gyro.csv", b"time_s,wx,wy,wz\n" + b"0" * (100 << 20)), packing=zipfile.ZIP_DEFLATED
        ),
        "a member larger than it states": whole.replace(
            struct.pack("<II", len(TABLE), len(TABLE)), struct.pack("<II", len(TABLE), 9)
        ),
        "a member of 4 GB": whole.replace(
            struct.pack("<II", len(TABLE), len(TABLE)), b"\xf0\xff\xff\xff" * 2
        ),
        "a wrong checksum": whole.replace(struct.pack("<I", zlib.crc32(TABLE)), b"abcd"),
        "corrupt deflate": _corrupt(
            _zip(("gyro.csv", TABLE), packing=zipfile.ZIP_DEFLATED), zlib.compress(TABLE)
        ),
        "corrupt LZMA": _corrupt(_zip(("gyro.csv", TABLE), packing=zipfile.ZIP_LZMA), lzma.compress(TABLE)),
        "corrupt bzip2": _corrupt(_zip(("gyro.csv", TABLE), packing=zipfile.ZIP_BZIP2), bz2.compress(TABLE)),
        "an unknown packing": whole.replace(
            b"PK\x03\x04\x14\0\0\0\0\0", b"PK\x03\x04\x14\0\0\0\x63\0"
        ).replace(b"\x14\0\0\0\0\0", b"\x14\0\0\0\x63\0"),
        "encrypted": whole.replace(b"\x14\0\0\0\0\0", b"\x14\0\x01\0\0\0"),
        "65535 members that are not there": whole[: end + 8] + b"\xff" * 4 + whole[end + 12 :],
        "a directory at 4 GB": whole[: end + 16] + b"\xfe\xff\xff\xff" + whole[end + 20 :],
        "an archive in itself": _zip(("gyro.zip", whole)),
        "only a folder": _zip(("gyro/", b"")),
        "no member": _zip(),
        "a table with NUL": _zip(("gyro.csv", TABLE.replace(b"0.3", b"0\x003"))),
        "a TOML nested without end": _zip(("gyro.csv", TABLE), ("dataset.toml", b"a = " + b"[" * 200_000)),
    }


def _archives() -> Iterator[Case]:
    arguments = ("compare", "{in}/x.zip", "-o", "{out}/run", "--estimators", "mekf")
    for what, data in _zips().items():
        yield Case(f"zip: {what}", "gyro", content("x.zip", data), arguments)
    for what, build in no_files().items():
        yield Case(f"zip is {what}", "gyro", instead("x.zip", build), arguments)


# Bags of ROS


def _bags() -> Iterator[Case]:
    bag = _mcap()
    damaged = {"nothing": b"", "zeros": bytes(4096), "a magic alone": b"\x89MCAP0\r\n"}
    if bag:
        middle = len(bag) // 2
        flipped = bag[:middle] + bytes([bag[middle] ^ 1]) + bag[middle + 1 :]
        damaged |= {
            "truncated": bag[:middle],
            "without its end": bag[:-30],
            "a flipped bit": flipped,
            "a record of 2^63 bytes": bag[:9] + b"\xff" * 7 + b"\x7f" + bag[17:],
            "a wrong checksum": bag.replace(b"\x0f\x04" + bytes(11), b"\x0f\x04" + bytes(7) + b"abcd"),
            "zeros in the middle": bag[:middle] + bytes(64) + bag[middle + 64 :],
        }
    for what, data in damaged.items():
        arguments = ("compare", "{in}/x.mcap", "-o", "{out}/run", "--estimators", "mekf", "--topic", "/imu")
        yield Case(f"mcap: {what}", "gyro", content("x.mcap", data), arguments)
    record = struct.pack("<I", 2**31 - 1) + b"op=\x03" + bytes(40)
    for suffix, data in {
        "bag": {
            "of a header alone": b"#ROSBAG V2.0\n",
            "a record of 2 GB": b"#ROSBAG V2.0\n" + record,
            "text": b"#ROSBAG V9.9\n" + b"x" * 100,
        },
        "db3": {
            "text": b"SQLite format 3\0" + bytes(100),
            "zeros": bytes(4096),
        },
    }.items():
        for what, raw in data.items():
            arguments = ("compare", "{in}/x." + suffix, "-o", "{out}/run", "--estimators", "mekf")
            yield Case(f"{suffix}: {what}", "gyro", content(f"x.{suffix}", raw), arguments)
    for suffix in ("bag", "mcap", "db3"):
        for what, build in no_files().items():
            if what != "of 60 MB of zeros":
                arguments = ("compare", "{in}/x." + suffix, "-o", "{out}/run", "--estimators", "mekf")
                yield Case(f"{suffix} is {what}", "gyro", instead(f"x.{suffix}", build), arguments)


def _mcap() -> bytes:
    """A bag of twenty messages of a gyro; nothing without the package."""
    try:
        from rosbags.rosbag2 import StoragePlugin, Writer  # pyright: ignore[reportMissingImports]
        from rosbags.typesys import Stores, get_typestore  # pyright: ignore[reportMissingImports]
    except ImportError:
        return b""
    from tempfile import TemporaryDirectory

    store = get_typestore(Stores.ROS2_HUMBLE)
    types, zeros = store.types, np.zeros(9)
    vector = types["geometry_msgs/msg/Vector3"]
    with TemporaryDirectory() as scratch:
        folder = Path(scratch) / "bag"
        with Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
            topic = writer.add_connection("/imu", "sensor_msgs/msg/Imu", typestore=store)
            for k in range(20):
                header = types["std_msgs/msg/Header"](
                    types["builtin_interfaces/msg/Time"](1000, k * 40_000_000), "imu"
                )
                turn = types["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0)
                rate, force = vector(1.0, 0.1 * k, 0.3), vector(0.0, 0.0, 0.0)
                message = types["sensor_msgs/msg/Imu"](header, turn, zeros, rate, zeros, force, zeros)
                writer.write(topic, k * 40_000_000, store.serialize_cdr(message, "sensor_msgs/msg/Imu"))
        return next(folder.glob("*.mcap")).read_bytes()


# Campaigns


def _campaigns() -> Iterator[Case]:
    """Damaged folders of a campaign, resumed and reported; its own study lies beside it."""
    document = {
        "study": {"name": "gyros", "seeds": 1, "bound": "none"},
        "factors": {"estimator": ["mekf"]},
        "motion": {"base": {"rate_rpm": [4.0, 9.0, 3.0], "epochs": 30}},
        "sensor": {"base": {"kind": "gyro"}},
    }
    from spinfilters.campaigns.campaign_folder import begun
    from spinfilters.campaigns.runner import ended
    from spinfilters.campaigns.study import study_from
    from spinfilters.io.output_files import write_json, write_toml

    study = study_from(document, "study")
    row = ended(study, 0, "killed", "for a test", 0.1)

    def folder(path: Path) -> None:
        (path / "c/rows").mkdir(parents=True)
        write_toml(path / "study.toml", document)
        write_toml(path / "c/campaign.toml", document)
        write_json(path / "c/campaign.json", begun(study))

    rows = {
        "run -1": json.dumps(row | {"run": -1}),
        "run true": json.dumps(row | {"run": True}),
        "run 2^70": json.dumps(row | {"run": 2**70}),
        "run 999": json.dumps(row | {"run": 999}),
        "a text for a number": json.dumps(row | {"nees": "x"}),
        "a number for a text": json.dumps(row | {"reason": 3}),
        "nested without end": "[" * 100_000,
        "half a surrogate": json.dumps(row | {"reason": "\ud800"}),
        "zeros": "\0" * 400,
        "a whole row and a damaged one": json.dumps(row) + "\n" + json.dumps(row | {"cell": 7}),
    }
    for what, line in rows.items():
        change = both(folder, content("c/rows/000001.jsonl", line + "\n"))
        yield Case(
            f"campaign resumed: {what}",
            "gyro",
            both(change, _moved_out),
            ("campaign", "{in}/study.toml", "-o", "{out}/c", "--resume", "--workers", "1"),
        )
        yield Case(
            f"campaign reported: {what}", "gyro", both(change, _moved_out), ("campaign", "report", "{out}/c")
        )
    files: dict[str, Change] = {
        "a part of text": content("c/rows/000001.parquet", b"PAR1 x PAR1"),
        "a part that is a pipe": instead("c/rows/000001.parquet", os.mkfifo),
        "a journal that is a pipe": instead("c/rows/000001.jsonl", os.mkfifo),
        "a journal that is a folder": instead("c/rows/000001.jsonl", Path.mkdir),
        "a study that is a pipe": instead("c/campaign.toml", os.mkfifo),
        "a begin nested without end": content("c/campaign.json", b"[" * 100_000),
        "a begin of another shape": content("c/campaign.json", b"[1]"),
        "rows that are a file": both(lambda path: shutil.rmtree(path / "c/rows"), content("c/rows", b"x")),
    }
    for what, change in files.items():
        yield Case(
            f"campaign with {what}",
            "gyro",
            both(folder, change, _moved_out),
            ("campaign", "report", "{out}/c"),
        )
    for address in ("word", "", "tcp://", "a b:1", "http://x:1", "x:99999", "tcp://[::", "9" * 400):
        yield Case(
            f"scheduler {address[:20]!r}",
            "gyro",
            both(folder, _moved_out),
            ("campaign", "{in}/study.toml", "-o", "{out}/new", "--scheduler", address),
        )


def _moved_out(folder: Path) -> None:
    """Put the campaign where commands may write."""
    shutil.move(folder / "c", folder.parent / "out" / "c")


# Texts


def _texts() -> Iterator[Case]:
    """Settings, calibrations and tables that are small and grow."""
    arguments = ("compare", "{in}", "-o", "{out}/run", "--estimators", "mekf")
    toml = {
        "a dotted key without end": "a" + ".a" * 50_000 + " = 1",
        "a key twice": 'kind = "gyro"\nkind = "pose"',
        "a number of 5000 digits": f'kind = "gyro"\ngyro_noise_std = {"9" * 5000}',
        "inline tables nested": "a = " + "{b = " * 5000,
        "a byte order mark": '\ufeffkind = "gyro"',
    }
    for what, text in toml.items():
        yield Case(f"toml: {what}", "gyro", content("dataset.toml", text), arguments)
    numbers = {
        "of 60 digits": LONG + "e41",
        "of 5000 digits": "0." + "3" * 5000,
        "of 5000 zeros": "0" * 5000 + "1",
    }
    for what, text in numbers.items():
        table = TABLE.replace(b"0.3", text.encode(), 1)
        yield Case(f"csv: a number {what}", "gyro", content("gyro.csv", table), arguments)
        yield Case(
            f"tum: a number {what}",
            "pose",
            bytes_of("poses.tum", lambda data, text=text: data.replace(b" 0.", b" " + text.encode(), 1)),
            arguments,
        )


def main(arguments: Sequence[str] | None = None) -> int:
    """Try them all; exit code 1 where one did what it must not."""
    assert __doc__ is not None
    return campaign("tests.hostile.attacks", attack_cases(), parser(__doc__).parse_args(arguments))


if __name__ == "__main__":
    raise SystemExit(main())
