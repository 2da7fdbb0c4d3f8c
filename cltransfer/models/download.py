"""Downloads of catalogue entries: http(s) only, resumed where they broke off, kept only with the right hash."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any
from urllib.parse import urljoin, urlsplit

from ..progress import Progress
from ..storage.alone import in_turn
from ..storage.files import atomic, content_hash, written
from .catalogue import LARGEST, Entry, entry_of_file, pin, pinned, pinned_file

if TYPE_CHECKING:
    from requests import Response, Session

BLOCK = 2**14  # bytes; what a connection that breaks off costs at most
ATTEMPTS = 3  # one after the other, as long as each brings something
REDIRECTS = 10  # one after the other


class _RefusedError(Exception):
    """A download that cannot go on; its text is the reason."""


class _BrokenOffError(Exception):
    """A connection that ended early and may be taken up again."""


class _ElsewhereError(Exception):
    """A redirect; its text is where to."""


@dataclass
class Resuming:
    """What pooch downloads with: goes on where a part file ends, and stops at what the entry allows.

    Args:
        entry: what is wanted.
        progress: called with the file, bytes there, bytes in all (0 where nobody knows).
        timeout: how long a server may say nothing [s].
        sha256: of what was downloaded, once it is.
    """

    entry: Entry
    progress: Progress
    timeout: float = 30.0
    sha256: str = ""

    @property
    def part(self) -> Path:
        """Where the bytes gather until they are complete."""
        return self.entry.path.with_name(f"{self.entry.path.name}.part")

    def __call__(self, url: str, output_file: IO[bytes] | str, pooch: Any) -> None:
        """Download ``url`` to the path ``output_file``."""
        if not self.entry.sha256:
            self.part.unlink(missing_ok=True)  # nothing would tell that two halves are of one file
        for attempt in range(1, ATTEMPTS + 1):
            before = self._there()
            try:
                self._continue(url)
                break
            except _BrokenOffError as error:
                there = self._there()
                if attempt == ATTEMPTS or there <= before:
                    goes_on = ", the next pull goes on there" if there and self.entry.sha256 else ""
                    raise _RefusedError(f"{error} after {there} bytes{goes_on}") from None
        self.sha256 = content_hash(self.part)
        self.part.replace(str(output_file))

    def _there(self) -> int:
        return self.part.stat().st_size if self.part.exists() else 0

    def _continue(self, url: str) -> None:
        """Append to the part file until the server has no more."""
        import requests

        there = self._there()
        if there and there == self.entry.size:
            return
        headers = {"Accept-Encoding": "identity", **({"Range": f"bytes={there}-"} if there else {})}
        try:
            with requests.Session() as session, self._answer(session, url, headers) as answer:
                if there and answer.status_code == 416:  # the part file is longer than the server's
                    self.part.unlink()
                    self._continue(url)
                    return
                self._check(answer)
                self._append(answer, there if answer.status_code == 206 else 0)
        except (
            requests.exceptions.Timeout,
            requests.exceptions.ConnectionError,
            requests.exceptions.ChunkedEncodingError,
        ) as error:
            raise _BrokenOffError(_plain(error)) from None
        except (requests.exceptions.RequestException, ValueError) as error:  # no address, or no number, in a header
            raise _RefusedError(_plain(error)) from None

    def _answer(self, session: Session, url: str, headers: dict[str, str]) -> Response:
        """What is answered where ``url`` leads to in the end."""
        from requests.cookies import extract_cookies_to_jar

        def leave(answer: Response, **_: object) -> None:
            """Read no body of a redirect: requests would, all of it into memory, before it follows or does not."""
            if target := session.get_redirect_target(answer):
                extract_cookies_to_jar(session.cookies, answer.request, answer.raw)  # some send round for one
                answer.close()
                raise _ElsewhereError(target)

        for _ in range(1 + REDIRECTS):
            try:
                return session.get(
                    url,
                    headers=headers,
                    stream=True,
                    timeout=self.timeout,
                    allow_redirects=False,
                    hooks={"response": leave},
                )
            except _ElsewhereError as error:
                url = further(url, str(error))
        raise _RefusedError(f"more than {REDIRECTS} redirects, the last to {url}")

    def _check(self, answer: Response) -> None:
        """Refuse what is no file, or another part of it."""
        if answer.status_code not in (200, 206):
            raise _RefusedError(f"the server answers {answer.status_code} {answer.reason}")
        begin = re.match(r"bytes (\d+)-", answer.headers.get("Content-Range", ""))
        if answer.status_code == 206 and (begin is None or int(begin[1]) != self._there()):
            raise _RefusedError("the server goes on at another byte than it was asked for")

    def _append(self, answer: Response, there: int) -> None:
        """Write the answer's bytes behind the ``there`` first ones."""
        length = answer.headers.get("Content-Length", "")[:20]  # Python reads no number of thousands of digits
        total = there + int(length) if length.isdecimal() else self.entry.size
        limit = self.entry.size or LARGEST
        if total > limit or (self.entry.size and total != self.entry.size):
            self.part.unlink(missing_ok=True)
            raise _RefusedError(f"expected {self.entry.size or f'at most {LARGEST}'} bytes, the server has {total}")
        with self.part.open("r+b" if there else "wb") as stream:
            stream.seek(there)
            for block in answer.iter_content(BLOCK):
                there += len(block)
                if there > limit:
                    break
                with written(self.part):
                    stream.write(block)
                self.progress(self.entry.file, there, total)
        if there > limit:
            self.part.unlink()
            raise _RefusedError(f"expected at most {limit} bytes, the server goes on")
        if there < total:
            raise _BrokenOffError("cut off")


def further(url: str, target: str) -> str:
    """The address that a redirect of ``url`` leads to; https is not left, for whoever stands there chooses the file."""
    there = urljoin(url, target)
    scheme = urlsplit(there).scheme
    if scheme not in ("http", "https"):
        raise _RefusedError(f"the server leads to {there}, expected http or https")
    if urlsplit(url).scheme == "https" and scheme == "http":
        raise _RefusedError(f"the server leads away from https to {there}")
    return there


def pull(entry: Entry, accept_new: bool, progress: Progress, timeout: float = 30.0) -> Entry:
    """``entry`` with its file at ``entry.path``, downloaded unless it is there, and with its hash.

    A file that is there is replaced by a whole one only. Where its hash is not known it is left, and the hash too,
    unless ``accept_new`` asks for what is published.

    Args:
        entry: of the catalogue.
        accept_new: download an entry whose hash is not known, and pin what came.
        progress: called with the file, bytes there, bytes in all.
        timeout: how long a server may say nothing [s].

    Raises:
        ModelError: a network cannot be had: no address, no known hash, no connection, another content.
        InputError: likewise an asset.
    """
    import pooch

    if not entry.address:
        raise entry.error("address", f"is not published as such, from {entry.source}", entry.made_by)
    if not entry.sha256 and not accept_new:
        if entry.path.is_file():
            return entry
        hint = "--accept-new takes what comes and pins it"
        raise entry.error("sha256", f"is not known, from {entry.address}", hint)
    if not entry.path.parent.resolve().is_relative_to(entry.folder.resolve()):
        raise entry.error("folder", f"{entry.path.parent} is a link out of {entry.folder}, from {entry.address}")
    if entry.sha256 and entry.path.is_file() and content_hash(entry.path) == entry.sha256:
        return _noted(entry)  # of a cache too that may only be read
    pooch.get_logger().setLevel("ERROR")
    entry.path.parent.mkdir(parents=True, exist_ok=True)
    with in_turn(entry.lock):  # another command may be pulling the same file
        entry = pinned(entry)  # and have pinned it meanwhile
        getter = Resuming(entry, progress, timeout)
        about = f"from {entry.address}, sha256 {entry.sha256 or 'not known'}"
        try:
            _retrieve(entry, getter)
        except _RefusedError as error:
            raise entry.error("download", f"{error}, {about}", f"or put it by hand into {entry.folder}") from None
        except ValueError:  # pooch's word for another hash; it has deleted the file
            raise entry.error("sha256", f"got {getter.sha256}, {about}", "the file was not kept") from None
        if not entry.sha256:
            return pin(entry, getter.sha256)
        return _noted(entry)


def _noted(entry: Entry) -> Entry:
    """``entry``, pinned where its catalogue is not at hand any more when the network is run."""
    if entry.kind == "model" and entry_of_file(entry.file) is None and pinned_file(entry.path) != entry.sha256:
        pin(entry, entry.sha256)
    return entry


def _retrieve(entry: Entry, getter: Resuming) -> None:
    import pooch

    if entry.sha256:
        known = f"sha256:{entry.sha256}"
        pooch.retrieve(entry.address, known, entry.path.name, entry.path.parent, downloader=getter)
    else:
        with atomic(entry.path) as new:  # pooch keeps what it cannot check
            pooch.retrieve(entry.address, None, new.name, new.parent, downloader=getter)


def _plain(error: Exception) -> str:
    """What happened to the connection, without the library's nesting."""
    text = " ".join(str(error).split())
    known = {
        "NameResolution": "no such host, or no network",
        "Name or service": "no such host, or no network",
        "refused": "the connection was refused",
        "IncompleteRead": "cut off",
        "timed out": "the server said nothing any more",
    }
    return next((reason for sign, reason in known.items() if sign in text), text[:120])
