"""The journal: what the losses make of whatever is rendered, appended and synced, so that a killed run goes on.

An answer is in the file before it is given, or, where another run is replaced, from the first frame on: a run that is
killed loses what it was asked last. A loss of power may take all that was answered since the disk was last waited for
(:data:`SYNC`); what remains of that is cut off.

A run is deterministic, so nothing but the answers has to be kept: a resumed run asks the same questions in the same
order and is answered from the journal until that ends. A question that is not the one recorded means another machine,
version or thread count; it is refused.

A question is a batch of candidates for one frame, a path as a whole, the views around one frame of a path, or what
networks read of the frames of a path. What was answered is rendered again only where the run goes on from there
(:mod:`.view`).

Record: length, crc32, then crc32 of what was asked, rows, columns, float64 answers; a document has no rows and columns,
and JSON after them. The first record is the header.
"""

from __future__ import annotations

import errno
import json
import math
import os
import struct
import time
import zlib
from collections.abc import Callable, Mapping
from importlib.util import find_spec
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import torch
from torch import Tensor

from ..camera import Camera
from ..computer.memory import require_parsed
from ..errors import InputError, ResourceError
from ..features import Features
from ..storage.files import JSON_LIMIT, written
from .journal_header import compare, same_command

_FRAME = struct.Struct("<II")  # length, crc32 of the payload
_SHAPE = struct.Struct("<III")  # crc32 of what was asked, rows, columns
RECORD_LIMIT = 2**28  # bytes; a path of 1,000 frames with 30 residuals, and beyond jumps, takes 720 kB
SYNC = 0.2  # [s] between waits for the disk; each takes 4 ms, and a search of 24 frames asks hundreds of times
SMALL = 4096  # numbers; joints and angles are, whose bias is aimed off, maps are not


class Journal:
    """Answers of a run on disk.

    Args:
        path: of the file.
        header: what the answers depend on, as JSON values; a journal of another header is not gone on with.
        resume: take up the answers that are there; otherwise they are discarded.
        patient: what is discarded stays on disk until :meth:`settle`, and new answers wait in memory.

    Raises:
        InputError: the file is no journal, or of another run.
        ResourceError: another process writes it; or, of any answer, it is larger than a record may be.
    """

    def __init__(self, path: Path, header: Mapping[str, object], resume: bool, patient: bool = False) -> None:
        path.parent.mkdir(parents=True, exist_ok=True)
        self.path = path
        self.replayed = 0
        self._synced = -math.inf  # when, by the clock of time.monotonic
        self._replaying = resume and path.exists() and _is_begun(path, header)
        self._stream = _open(path)
        self._waiting: list[bytes] | None = None  # records that are not on the disk yet
        if self._replaying:
            _record(self._stream)  # the header
        else:
            if patient and os.fstat(self._stream.fileno()).st_size:
                self._waiting = []
            else:
                self._stream.truncate(0)
            self._append(json.dumps(header, sort_keys=True).encode())

    @property
    def settled(self) -> bool:
        """Whether what lies on the disk is of this run."""
        return self._waiting is None

    def settle(self) -> None:
        """What another run had left is gone, and what was answered so far stands in its place."""
        if self._waiting is not None:
            records, self._waiting = b"".join(self._waiting), None
            self._stream.truncate(0)
            self._write(records, lasting=True)

    @classmethod
    def begun(cls, path: Path, header: Mapping[str, object]) -> bool:
        """Whether ``path`` holds answers of a run that was begun by the same command as one of this ``header``."""
        if not path.is_file():
            return False
        with path.open("rb") as stream:
            first = _record(stream, JSON_LIMIT)
            if first is None or _record(stream) is None:
                return False
        return same_command(_parsed(path, "header", first), header)

    def answer(
        self, cameras: Camera, compute: Callable[[], Tensor], told: int = 0, columns: int | None = None
    ) -> Tensor:
        """Values (B, C) float64 for B cameras: recorded if this question was asked before, else computed and recorded.

        Args:
            cameras: of which it is asked.
            compute: the values, where they are not recorded.
            told: digest of what else is asked, as by :func:`small_print`.
            columns: C, of what is recorded too; None takes any.

        Raises:
            InputError: another question was recorded here, or answered with other columns.
        """
        asked = fingerprint(cameras) ^ told
        if (payload := self._recorded()) is not None:
            crc, rows, found = _SHAPE.unpack(payload[: _SHAPE.size].ljust(_SHAPE.size, b"\0"))
            same = (crc, rows) == (asked, len(cameras)) and columns in (None, found)
            self._check(same and len(payload) == _SHAPE.size + 8 * rows * found)
            values = np.frombuffer(payload, np.float64, offset=_SHAPE.size).reshape(rows, found)
            return torch.from_numpy(values.copy())
        computed = compute().double()
        self._append(_SHAPE.pack(asked, *computed.shape) + computed.contiguous().numpy().tobytes())
        return computed

    def document(self, cameras: Camera, compute: Callable[[], object]) -> Any:
        """JSON values of N cameras: recorded if this question was asked before, else computed and recorded.

        Raises:
            InputError: another question was recorded here, or no JSON.
            ResourceError: there may not be memory for it.
        """
        asked = fingerprint(cameras) ^ zlib.crc32(b"document")
        if (payload := self._recorded()) is not None:
            crc, rows, columns = _SHAPE.unpack(payload[: _SHAPE.size].ljust(_SHAPE.size, b"\0"))
            self._check((crc, rows, columns) == (asked, 0, 0))
            require_parsed(len(payload), self.path)
        else:
            payload = _SHAPE.pack(asked, 0, 0) + json.dumps(compute()).encode()
            self._append(payload, lasting=True)
        return _parsed(self.path, f"record {self.replayed}", payload[_SHAPE.size :])

    def _check(self, same: bool) -> None:
        self.replayed += 1
        if not same:
            hint = "other machine, version or threads? start over with another --out"
            raise InputError(self.path, f"record {self.replayed}", "answers another question than this run asks", hint)

    def _recorded(self) -> bytes | None:
        """The next record, one in memory at a time; None from the last on, behind which what is torn is cut off."""
        if not self._replaying:
            return None
        end = self._stream.tell()
        payload = _record(self._stream)
        if payload is None:
            self._replaying = False
            self._stream.truncate(end)
            self._stream.seek(end)
        return payload

    def _append(self, payload: bytes, lasting: bool = False) -> None:
        if len(payload) > RECORD_LIMIT:
            size = f"an answer of {len(payload) >> 20} MiB, expected at most {RECORD_LIMIT >> 20}"
            raise ResourceError(self.path, "", size, "take fewer frames, or a loss of fewer residuals")
        record = _FRAME.pack(len(payload), zlib.crc32(payload)) + payload
        if self._waiting is None:
            self._write(record, lasting)
        else:
            self._waiting.append(record)

    def _write(self, records: bytes, lasting: bool) -> None:
        with written(self.path):
            self._stream.write(records)
            self._stream.flush()
            if lasting or time.monotonic() - self._synced >= SYNC:
                os.fsync(self._stream.fileno())
                self._synced = time.monotonic()


def fingerprint(cameras: Camera) -> int:
    """crc32 of the cameras' numbers."""
    return zlib.crc32(cameras.K.contiguous().numpy().tobytes(), zlib.crc32(cameras.w2c.contiguous().numpy().tobytes()))


def small_print(features: Features, kind: str) -> int:
    """crc32 of the kind of answer and of whatever is small in the features that cameras are held against."""
    crc = zlib.crc32(kind.encode())
    for name in sorted(features.names()):
        value = features.require(name)
        if isinstance(value, Tensor) and value.numel() <= SMALL:
            crc = zlib.crc32(name.encode() + value.detach().cpu().contiguous().numpy().tobytes(), crc)
    return crc


def _open(path: Path) -> BinaryIO:
    """The file to read and write, this process' alone."""
    stream = path.open("r+b" if path.exists() else "wb")
    _hold(stream, path)
    return stream


def _hold(stream: BinaryIO, path: Path) -> None:
    """Keep other processes from writing the same run, until the stream is closed; where the system has no locks, no."""
    if find_spec("fcntl") is None:
        return
    import fcntl

    try:
        fcntl.lockf(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        if error.errno not in (errno.EACCES, errno.EAGAIN):
            return  # a network drive without locks
        stream.close()
        reason, hint = "another process writes this run", "wait until it ends, or name another --out"
        raise ResourceError(path.parent, path.name, reason, hint) from None


def _record(stream: BinaryIO, limit: int = RECORD_LIMIT) -> bytes | None:
    """The record that begins here; None at the end, and where it is torn or flipped: so may be whatever follows."""
    if len(head := stream.read(_FRAME.size)) < _FRAME.size:
        return None
    length, crc = _FRAME.unpack(head)
    if not 0 < length <= limit:
        return None
    payload = stream.read(length)
    return payload if len(payload) == length and zlib.crc32(payload) == crc else None


def _is_begun(path: Path, header: Mapping[str, object]) -> bool:
    """Whether there are answers to go on with; not where the very header is torn.

    Raises:
        InputError: the file is no journal, or of another run.
    """
    with path.open("rb") as stream:
        first = _record(stream, JSON_LIMIT)
    if first is not None:
        compare(path, _parsed(path, "header", first), header)
    elif not _torn_at_once(path):
        raise InputError(path, "header", "not a journal", "start over with another --out")
    return first is not None


def _torn_at_once(path: Path) -> bool:
    """Whether the first record of the file was being written when its run was killed."""
    with path.open("rb") as stream:
        head = stream.read(_FRAME.size)
    length = _FRAME.unpack(head)[0] if len(head) == _FRAME.size else 0
    return length <= JSON_LIMIT and path.stat().st_size < _FRAME.size + length


def _parsed(path: Path, field: str, told: bytes) -> Any:
    try:
        return json.loads(told)
    except (ValueError, RecursionError):
        raise InputError(path, field, "not a journal", "start over with another --out") from None
