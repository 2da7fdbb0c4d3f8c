"""Whether a JPEG is all there: its markers walked, since what lies behind it may hold any bytes.

A motion photo has a film behind its picture; and a scan holds bytes that are no marker.
"""

from __future__ import annotations

import re

END, SCAN = 0xD9, 0xDA
_ALONE = {0x01, *range(0xD0, 0xD8)}  # markers without a content
_AFTER_SCAN = re.compile(rb"\xff[^\x00\xff\xd0-\xd7]")  # a marker that is none of a scan


def jpeg_ends(data: bytes) -> bool:
    """Whether the picture that ``data`` begin with, a JPEG, has its end.

    >>> jpeg_ends(bytes.fromhex("ffd8 ffda0002 00ff0011 ffd9 ffda")), jpeg_ends(bytes.fromhex("ffd8 ffda0002 00"))
    (True, False)
    """
    at = 2
    while (at := data.find(b"\xff", at)) >= 0 and at + 1 < len(data):
        marker = data[at + 1]
        if marker == END:
            return True
        if marker == 0xFF:  # fills up
            at += 1
        elif marker in _ALONE:
            at += 2
        else:
            at += 2 + int.from_bytes(data[at + 2 : at + 4], "big")
            if marker == SCAN:
                found = _AFTER_SCAN.search(data, at)
                at = len(data) if found is None else found.start()
    return False
