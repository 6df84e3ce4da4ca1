"""PNG files made by hand (ISO/IEC 15948)."""

import struct
import zlib

import numpy as np


def chunk(name, body):
    return struct.pack(">I", len(body)) + name + body + struct.pack(">I", zlib.crc32(name + body))


def png(values, depth, *chunks):
    """A grey PNG of 1 to 16 bits, with further chunks as (name, body)."""
    if depth == 16:
        packed = [row.astype(">u2").tobytes() for row in values]
    else:
        bits = (values[..., None] >> np.arange(depth)[::-1]) & 1
        packed = [np.packbits(row.ravel()).tobytes() for row in bits.astype(np.uint8)]
    header = struct.pack(">IIBBBBB", values.shape[1], len(values), depth, 0, 0, 0, 0)
    data = zlib.compress(b"".join(b"\0" + row for row in packed))
    parts = [(b"IHDR", header), *chunks, (b"IDAT", data), (b"IEND", b"")]
    return b"\x89PNG\r\n\x1a\n" + b"".join(chunk(*part) for part in parts)
