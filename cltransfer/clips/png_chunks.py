"""The parts of a PNG that its picture needs: a decoder keeps others unpacked, of any size, or refuses it all."""

from __future__ import annotations

PNG = b"\x89PNG\r\n\x1a\n"
_DRAWN = (b"IHDR", b"PLTE", b"tRNS", b"pHYs", b"gAMA", b"cHRM", b"sRGB", b"IDAT", b"IEND")


def drawn_chunks(data: bytes) -> bytes:
    """A PNG of no chunks but those that its picture needs."""
    view, kept, at = memoryview(data), bytearray(PNG), len(PNG)
    while at < len(data):
        end = at + 12 + int.from_bytes(data[at : at + 4], "big")  # length, name, content, checksum
        if data[at + 4 : at + 8] in _DRAWN:
            kept += view[at:end]
        at = end
    return bytes(kept)
