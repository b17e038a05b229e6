"""Detects the format of an image from its first bytes, since file names may be wrong."""

from __future__ import annotations

import struct

__all__ = ["IMAGE_SUFFIXES", "KTX2", "OPENIMAGEIO", "PILLOW", "is_deep_png", "suffix_of", "targa_alpha"]

# Formats of 8 bits a channel, by Pillow's names. Its other plugins stay disabled: some start programs (EPS), none is a texture.
PILLOW = {
    ".png": "PNG",
    ".jpg": "JPEG",
    ".jpeg": "JPEG",
    ".webp": "WEBP",
    ".avif": "AVIF",
    ".tga": "TGA",
    ".bmp": "BMP",
    ".gif": "GIF",
}
OPENIMAGEIO = (".exr", ".hdr", ".pic", ".tif", ".tiff", ".pfm", ".ppm", ".pgm", ".dds", ".psd", ".jp2", ".sgi", ".rgb")
KTX2 = ".ktx2"
IMAGE_SUFFIXES = (*PILLOW, *OPENIMAGEIO, KTX2)

_MAGIC = (
    (b"\x89PNG\r\n\x1a\n", ".png"),
    (b"\xff\xd8\xff", ".jpg"),
    (b"\x76\x2f\x31\x01", ".exr"),
    (b"#?", ".hdr"),  # RADIANCE, RGBE, and the names of other programs
    (b"GIF8", ".gif"),
    (b"BM", ".bmp"),
    (b"II*\x00", ".tif"),
    (b"MM\x00*", ".tif"),
    (b"II+\x00", ".tif"),  # BigTIFF
    (b"MM\x00+", ".tif"),
    (b"DDS ", ".dds"),
    (b"8BPS", ".psd"),
    (b"\x00\x00\x00\x0cjP  \r\n\x87\n", ".jp2"),
    (b"\xff\x4f\xff\x51", ".jp2"),  # a bare codestream
    (b"\x01\xda", ".sgi"),
    (b"\x53\x80\xf6\x34", ".pic"),
    (b"\xabKTX 20\xbb\r\n\x1a\n", KTX2),
)
_NETPBM = {b"PF": ".pfm", b"Pf": ".pfm", **{b"P%d" % n: ".ppm" for n in (3, 6)}, **{b"P%d" % n: ".pgm" for n in (2, 5)}}
_TARGA_FOOTER = b"TRUEVISION-XFILE"
_TARGA_DEPTHS = {1: (8, 16), 2: (15, 16, 24, 32), 3: (8, 16), 9: (8, 16), 10: (15, 16, 24, 32), 11: (8, 16)}
_IGNORED, _PREMULTIPLIED = 1, 4  # attributes types of TGA 2.0's extension area


def suffix_of(data: bytes) -> str | None:
    """Returns the suffix of the image format of a file with these bytes; None if unknown."""
    for magic, suffix in _MAGIC:
        if data.startswith(magic):
            return suffix
    if data[:4] == b"RIFF" and data[8:12] == b"WEBP":
        return ".webp"
    if data[4:8] == b"ftyp" and (b"avif" in data[8:40] or b"avis" in data[8:40]):
        return ".avif"
    if data[:2] in _NETPBM and data[2:3].isspace():
        return _NETPBM[data[:2]]
    return ".tga" if _is_targa(data) else None


def _is_targa(data: bytes) -> bool:
    """Returns True if the bytes begin like a TGA file, whose format has no magic number."""
    if len(data) < 18:
        return False
    mapped, kind, _, _, map_depth = struct.unpack_from("<xBBHHB", data)
    width, height, depth, descriptor = struct.unpack_from("<HHBB", data, 12)
    if kind not in _TARGA_DEPTHS or depth not in _TARGA_DEPTHS[kind] or not width or not height or descriptor & 0xC0:
        return False
    if mapped not in (0, 1) or (kind in (1, 9)) != (mapped == 1 and map_depth in (15, 16, 24, 32)):
        return False
    is_plain = kind < 9
    return not is_plain or len(data) >= 18 + data[0] + width * height * ((depth + 7) // 8) or _TARGA_FOOTER in data[-26:]


def is_deep_png(data: bytes) -> bool:
    """Returns True if a PNG file has 16 bits per channel, according to its IHDR chunk."""
    return data[12:16] == b"IHDR" and data[24:25] == b"\x10"


def targa_alpha(data: bytes) -> str:
    """Returns the meaning of a TGA file's fourth channel: "none", "straight" or "premultiplied".

    Source: Truevision, "TGA file format specification", 2.0: image descriptor (field 5.6), attributes type (field 24).
    """
    kind, bits = data[2], data[17] & 15
    if kind not in (1, 9) and bits == 0:
        return "none"
    if _TARGA_FOOTER in data[-26:]:
        extension = int.from_bytes(data[-26:-22], "little")
        attributes = data[extension + 494] if extension and extension + 495 <= len(data) else None
        if attributes == _IGNORED:
            return "none"
        if attributes == _PREMULTIPLIED:
            return "premultiplied"
    return "straight"
