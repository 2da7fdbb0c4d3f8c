"""Files in and out: caps before reading, whole files or none when writing, no formulas in tables, names by content."""

from __future__ import annotations

import contextlib
import csv
import hashlib
import io
import json
import logging
import os
import re
import secrets
import stat
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from ..errors import InputError, UsageError

JSON_LIMIT = 16 * 2**20  # bytes; a trajectory of 2,000 frames takes about 2 MiB
SIGNS = "=+@＝＋－＠-"  # how a cell may begin that a spreadsheet works out instead of showing it
FORMULA = (*SIGNS, "\t", "\n")
_BEGINS = re.compile(rf"([;\t\n][\s\"]*)(?=[{SIGNS}])")  # a cell, where the spreadsheet's separator is no comma

_log = logging.getLogger("cltransfer")


@contextlib.contextmanager
def written(path: Path) -> Iterator[None]:
    """What the system says of a write, a flush or a sync in the block is told of ``path``, which it does not name."""
    try:
        yield
    except OSError as error:
        if error.errno is None or error.filename is not None:
            raise
        raise OSError(error.errno, error.strerror, str(path)) from None


@contextlib.contextmanager
def atomic(path: Path, lasting: bool = True) -> Iterator[Path]:
    """Temporary name beside ``path`` that becomes ``path`` only if the block ends well.

    Where it is to be ``lasting``, a loss of power takes it no more once that has happened; it costs some milliseconds.

    The suffix stays last, so that encoders which choose a format by suffix still can. Who may read it is as of any
    other new file there, whatever the writer has set: safetensors leaves its files to their owner alone.

    Raises:
        UsageError: there is a folder, a device or a pipe at ``path``, which must stay what it is.
    """
    if path.exists() and not path.is_file():
        raise UsageError(path, "", "is no regular file", "name a file")
    path.parent.mkdir(parents=True, exist_ok=True)
    own = f"{os.getpid()}-{secrets.token_hex(4)}"  # threads share a number, and so do containers that share a folder
    temporary = path.with_name(f".tmp-{own}-{path.name}")
    try:
        with written(path):
            usual = _usual_mode(path.with_name(f".new-{own}-{path.name}"))
            yield temporary
            if stat.S_IMODE(temporary.stat().st_mode) != usual:
                temporary.chmod(usual)
            if lasting:
                _sync(temporary, os.O_RDWR)  # Windows syncs nothing that is open to be read alone
            os.replace(temporary, path)
            if lasting:
                with contextlib.suppress(OSError):  # a folder that may be written but not read, a drive that syncs none
                    _sync(path.parent, os.O_RDONLY)
    finally:
        temporary.unlink(missing_ok=True)


def _sync(path: Path, mode: int) -> None:
    """Wait until a file, or the names in a folder, would outlast a loss of power."""
    handle = os.open(path, mode)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def _usual_mode(path: Path) -> int:
    """Permissions that a new file gets at ``path``, where none is left; the umask can only be asked by setting it."""
    with path.open("ab") as stream:
        usual = stat.S_IMODE(os.fstat(stream.fileno()).st_mode)
    path.unlink(missing_ok=True)
    return usual


def check_out(folder: Path) -> None:
    """Refuse an output folder that cannot be one or be written into, before any work is done for it.

    Raises:
        UsageError: there is a file of that name, or of one it would lie in; or the folder it lies in is not ours.
    """
    if folder.exists() and not folder.is_dir():
        raise UsageError(folder, "--out", "expected a folder, there is a file of that name")
    _check_place(folder, folder)


def _check_place(out: Path, folder: Path) -> None:
    """Refuse an ``out`` where ``folder``, itself or the one it lies in, cannot be made or written into."""
    there = next(path for path in (folder, *folder.absolute().parents) if path.exists())
    if not there.is_dir():
        raise UsageError(out, "--out", f"cannot lie in {there}, which is a file", "name another folder")
    if not os.access(there, os.W_OK | os.X_OK):
        raise UsageError(out, "--out", f"may not be written: {there} is not ours", "name another folder")


def check_out_file(path: Path | None) -> None:
    """Refuse an output file that cannot be one, before any work is done for it.

    Raises:
        UsageError: there is a folder, a device or a pipe of that name, or the folder it lies in is none, or not ours.
    """
    if path is None:
        return
    if path.exists() and not path.is_file():
        raise UsageError(path, "--out", "expected a file, there is something else of that name")
    _check_place(path, path.absolute().parent)


def refuse_link(path: Path) -> None:
    """Refuse a link where a file is appended to: what is written would lie elsewhere.

    Raises:
        InputError: it is one.
    """
    if path.is_symlink():
        raise InputError(path, "", "is a link", "put the file itself there")


def refuse_outside(folder: Path, paths: Iterable[Path], whole: str) -> None:
    """Refuse ``paths`` that lead out of ``folder``, that of the ``whole``: they would be read and written elsewhere.

    Raises:
        InputError: one of them is.
    """
    home = folder.resolve()
    for path in paths:
        if not Path(os.path.realpath(path)).is_relative_to(home):
            raise InputError(path, "", f"leads out of the folder of its {whole}", "put the file itself there")


def same_file(one: Path, other: Path) -> bool:
    """Whether both are one file, by links or by a system that counts capitals for nothing too; there or not."""
    if one.exists() and other.exists():
        return one.samefile(other)
    return os.path.realpath(one) == os.path.realpath(other)


def told_from_here(path: Path) -> str:
    """``path`` from the folder we are in, or whole where no way leads there, as to another drive."""
    try:
        return os.path.relpath(path)
    except ValueError:
        return str(path)


def write_text(path: Path, text: str) -> None:
    """Write ``text`` as UTF-8, whole or not at all, the same bytes on every system.

    Bytes of a file's name that are none are shown as ``\\udce9``.
    """
    with atomic(path) as temporary:
        temporary.write_text(text, encoding="utf-8", errors="backslashreplace", newline="\n")


def write_json(path: Path, value: Any) -> None:
    """Write ``value`` as JSON, whole or not at all; NaN and infinity are refused (say null and why)."""
    write_text(path, json.dumps(value, indent=2, allow_nan=False) + "\n")


def csv_text(lines: Iterable[Iterable[Any]], digits: int | None = None) -> str:
    """``lines`` as CSV, each cell as :func:`csv_cell` has it; None is an empty one.

    Floats have so many ``digits``, or all.

    >>> csv_text([["-a", -1 / 3, None]], 3)
    "'-a,-0.333,\\n"
    """

    def cell(value: Any) -> Any:
        return f"{value:.{digits}g}" if digits and isinstance(value, float) else csv_cell(value)

    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(map(cell, line) for line in lines)
    return text.getvalue()


def csv_cell(value: Any) -> Any:
    """``value``; what a spreadsheet would take for a formula has a ``'`` before it.

    So has what it would in a text that it splits at semicolons or tabs, as where a comma stands before decimals.

    >>> csv_cell("=1+1"), csv_cell("a=1"), csv_cell(-1.5), csv_cell("a; =1+1")
    ("'=1+1", 'a=1', -1.5, "a; '=1+1")
    """
    if not isinstance(value, str):
        return value
    text = _BEGINS.sub(r"\1'", value.replace("\r", "\n"))
    return f"'{text}" if text.startswith(FORMULA) else text


def read_json(path: Path) -> Any:
    """Parsed JSON of ``path``.

    Raises:
        InputError: the file is missing, larger than :data:`JSON_LIMIT`, or not JSON.
    """
    text = read_text(path, JSON_LIMIT)
    try:
        return json.loads(text)
    except (ValueError, RecursionError) as error:
        raise InputError(path, "", f"expected JSON, {error}") from None


def read_text(path: Path, limit: int) -> str:
    """UTF-8 text of ``path``, at most ``limit`` bytes.

    Raises:
        InputError: the file is missing, is no file, is too large or is not UTF-8.
    """
    check_size(path, limit)
    try:
        return path.read_text(encoding="utf-8")
    except UnicodeDecodeError:
        raise InputError(path, "", "expected UTF-8 text, got binary data") from None


def read_lines(path: Path, limit: int, longest: int) -> Iterator[str]:
    """Lines of a UTF-8 text of at most ``limit`` bytes, without their ends, one at a time.

    Raises:
        InputError: the file is missing, is no file, is too large or is not UTF-8, or a line has more characters than
            ``longest``.
    """
    check_size(path, limit)
    with path.open(encoding="utf-8") as stream:
        try:
            for number, line in enumerate(iter(lambda: stream.readline(longest + 2), ""), start=1):
                if len(line.rstrip("\n")) > longest:
                    raise InputError(path, f"line {number}", f"expected at most {longest} characters")
                yield line.rstrip("\n")
        except UnicodeDecodeError:
            raise InputError(path, "", "expected UTF-8 text, got binary data") from None


def check_size(path: Path, limit: int) -> None:
    """Refuse what is no file of at most ``limit`` bytes.

    Raises:
        InputError: it is missing, a folder or larger.
    """
    if not path.is_file():
        inside = [name for name in ("trajectory.json", "subject.json") if (path / name).is_file()]  # a run's
        hint = f"name a file in it: {' or '.join(inside)}" if inside else ""
        raise InputError(path, "", "no such file" if not path.exists() else "expected a file, got a folder", hint)
    size = path.stat().st_size
    if size > limit:
        raise InputError(path, "", f"expected at most {limit} bytes, got {size}")


def content_hash(path: Path, files: Iterable[Path] | None = None) -> str:
    """SHA-256 of a file, or of the names and contents of a folder's ``files``, all of them by default, by name.

    Raises:
        InputError: one of them is a folder, a device or a pipe.
    """
    digest, members = hashlib.sha256(), files
    if members is None:
        members = (p for p in path.rglob("*") if p.is_file()) if path.is_dir() else [path]
    for member in sorted(members):
        if member.exists() and not member.is_file():
            raise InputError(member, "", "expected a file")  # a pipe would be waited for
        if path.is_dir():
            digest.update(os.fsencode(f"{member.relative_to(path).as_posix()}\0{member.stat().st_size}\0"))
        with member.open("rb") as stream:
            while block := stream.read(2**20):
                digest.update(block)
    return digest.hexdigest()


def cache_dir() -> Path:
    """Folder for what can be made again: ``CLTRANSFER_CACHE``, else ``~/.cache/cltransfer``."""
    named = os.environ.get("CLTRANSFER_CACHE")
    if named:
        return Path(named)
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "cltransfer"


@contextlib.contextmanager
def into_cache(path: Path, cost: str) -> Iterator[None]:
    """The block writes ``path`` of the cache; if it cannot, that is told with what it will ``cost``, and no more."""
    try:
        yield
    except OSError as error:
        _log.warning("%s: %s: %s", path, error.strerror or error, cost)
