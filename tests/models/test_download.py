"""Downloads from an HTTP server on the loopback interface that behaves, and that does not."""

from __future__ import annotations

import contextlib
import hashlib
import io
import json
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import pytest
import requests

from cltransfer.errors import CltransferError, InputError, ModelError
from cltransfer.models.catalogue import Entry, pin, pinned
from cltransfer.models.download import pull
from cltransfer.storage.alone import in_turn

CONTENT = bytes(range(256)) * 2000  # 512,000 bytes
HEAVY = 2**26
HASH = hashlib.sha256(CONTENT).hexdigest()


class Server(ThreadingHTTPServer):
    """Serves :data:`CONTENT`; the path says how. ``asked`` keeps path and Range of every request, ``sent`` bytes."""

    daemon_threads = True

    def __init__(self) -> None:
        super().__init__(("127.0.0.1", 0), Handler)
        self.asked: list[tuple[str, str]] = []
        self.sent = 0

    @property
    def address(self) -> str:
        return f"http://127.0.0.1:{self.server_address[1]}"


class Handler(BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"
    server: Server

    def log_message(self, *values: object) -> None:
        pass

    def do_GET(self) -> None:
        wanted = self.headers.get("Range", "")
        self.server.asked.append((self.path, wanted))
        begin = int(wanted.removeprefix("bytes=").rstrip("-")) if wanted else 0
        if begin >= len(CONTENT):
            self.head(416, 0, Content_Range=f"bytes */{len(CONTENT)}")
        else:
            getattr(self, f"serve_{self.path.strip('/')}")(begin)

    def head(self, code: int, length: int | None, **fields: str) -> None:
        self.send_response(code)
        for key, value in fields.items():
            self.send_header(key.replace("_", "-"), value)
        if length is not None:
            self.send_header("Content-Length", str(length))
        else:
            self.send_header("Connection", "close")
            self.close_connection = True
        self.end_headers()

    def part(self, begin: int) -> bytes:
        """The head of a good answer; gives its bytes."""
        if begin:
            self.head(206, len(CONTENT) - begin, Content_Range=f"bytes {begin}-{len(CONTENT) - 1}/{len(CONTENT)}")
        else:
            self.head(200, len(CONTENT))
        return CONTENT[begin:]

    def serve_good(self, begin: int) -> None:
        self.wfile.write(self.part(begin))

    def serve_whole(self, begin: int) -> None:
        """Knows no ranges."""
        self.head(200, len(CONTENT))
        self.wfile.write(CONTENT)

    def serve_other(self, begin: int) -> None:
        self.head(200, len(CONTENT))
        self.wfile.write(CONTENT[::-1])

    def serve_cut(self, begin: int) -> None:
        """Hangs up after 200,000 bytes each time."""
        self.wfile.write(self.part(begin)[:200_000])
        self.close_connection = True

    def serve_dead(self, begin: int) -> None:
        """Hangs up before the first byte."""
        self.part(begin)
        self.close_connection = True

    def serve_shifted(self, begin: int) -> None:
        """Goes on from another byte than it was asked for."""
        self.head(206, 10, Content_Range="bytes 5-14/512000")
        self.wfile.write(CONTENT[5:15])

    def serve_none(self, begin: int) -> None:
        self.head(404, 0)

    def serve_slow(self, begin: int) -> None:
        rest = self.part(begin)
        for start in range(0, len(rest), 64_000):
            self.wfile.write(rest[start : start + 64_000])
            self.wfile.flush()
            time.sleep(0.05)

    def serve_stalled(self, begin: int) -> None:
        self.wfile.write(self.part(begin)[:1000])
        self.wfile.flush()
        time.sleep(3)

    def serve_longer(self, begin: int) -> None:
        self.head(200, len(CONTENT) + 1)
        self.wfile.write(CONTENT + b"!")

    def serve_endless(self, begin: int) -> None:
        """Says no length and does not stop."""
        self.head(200, None)
        try:
            for _ in range(100):
                self.wfile.write(CONTENT)
        except OSError:
            pass

    def serve_elsewhere(self, begin: int) -> None:
        self.head(302, 0, Location="/good")

    def serve_file(self, begin: int) -> None:
        self.head(302, 0, Location="file:///etc/passwd")

    def serve_heavy(self, begin: int) -> None:
        """A redirect with a body of 64 MB."""
        self.head(302, HEAVY, Location="/good")
        with contextlib.suppress(OSError):
            for _ in range(HEAVY // 2**20):
                self.wfile.write(bytes(2**20))
                self.server.sent += 2**20

    def serve_known(self, begin: int) -> None:
        """Sends whoever has no cookie of it round to fetch one."""
        if "known=1" in self.headers.get("Cookie", ""):
            self.serve_good(begin)
        else:
            self.head(302, 0, Location="/known", Set_Cookie="known=1")

    def serve_absurd(self, begin: int) -> None:
        self.head(200, None, Content_Length="9" * 5000)

    def serve_nowhere(self, begin: int) -> None:
        self.head(302, 0, Location="http://[::1")

    def serve_changing(self, begin: int) -> None:
        """Less of it to whoever asks later."""
        content = CONTENT[: len(CONTENT) // len(self.server.asked)]
        self.head(200, len(content))
        self.wfile.write(content)

    def serve_round(self, begin: int) -> None:
        self.head(302, 0, Location="/round")


@pytest.fixture
def server() -> Iterator[Server]:
    with Server() as running:
        thread = threading.Thread(target=running.serve_forever, kwargs={"poll_interval": 0.01}, daemon=True)
        thread.start()
        yield running
        running.shutdown()


@pytest.fixture
def entry(server: Server, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., Entry]:
    monkeypatch.setenv("CLTRANSFER_CACHE", str(tmp_path / "cache"))
    monkeypatch.setenv("NO_PROXY", "*")

    def make(path: str, **changes: object) -> Entry:
        usual = Entry("mine", "model", "net.onnx", "masks", "MIT", "me", f"{server.address}/{path}", HASH, len(CONTENT))
        return replace(usual, **changes)

    return make


def silent(step: str, done: int, total: int) -> None:
    pass


def refused(entry: Entry, *parts: str, accept_new: bool = False) -> CltransferError:
    """The one-line error of pulling ``entry``, which has these parts, the address and the folder; nothing is kept."""
    with pytest.raises(CltransferError) as caught:
        pull(entry, accept_new, silent, timeout=0.5)
    line = str(caught.value)
    assert "\n" not in line
    for part in (*parts, entry.file, entry.address):
        assert part in line
    assert not entry.path.exists()
    return caught.value


def left(entry: Entry) -> list[str]:
    """Names in the folder."""
    return sorted(path.name for path in entry.folder.iterdir()) if entry.folder.exists() else []


def test_a_good_file_is_kept_and_not_asked_for_again(server, entry):
    told: list[tuple[str, int, int]] = []
    had = pull(entry("good"), False, lambda *values: told.append(values))
    assert had == entry("good")
    assert had.path.read_bytes() == CONTENT
    assert told[-1] == ("net.onnx", len(CONTENT), len(CONTENT))
    pull(entry("good"), False, silent)
    assert server.asked == [("/good", "")]
    assert left(had) == ["net.onnx"]


def test_a_right_file_is_had_though_another_holds_its_lock_and_is_noted_once(server, entry):
    pull(entry("good"), False, silent)
    noted = entry("good").folder.with_name("pins.json").stat().st_mtime_ns
    with ThreadPoolExecutor(1) as pool, in_turn(entry("good").lock):
        assert pool.submit(pull, entry("good"), False, silent).result(timeout=10) == entry("good")
    assert entry("good").folder.with_name("pins.json").stat().st_mtime_ns == noted


def test_a_file_of_another_hash_is_not_kept_and_the_line_says_both_hashes(entry):
    other = hashlib.sha256(CONTENT[::-1]).hexdigest()
    error = refused(entry("other"), HASH, other)
    assert (error.exit_code, error.field) == (4, "sha256")
    assert left(entry("other")) == []


def test_a_spoiled_file_in_the_cache_is_fetched_anew(entry):
    pull(entry("good"), False, silent)
    entry("good").path.write_bytes(b"spoiled")
    pull(entry("good"), False, silent)
    assert entry("good").path.read_bytes() == CONTENT


def test_a_connection_that_is_cut_goes_on_where_it_broke_off(server, entry):
    assert pull(entry("cut"), False, silent).path.read_bytes() == CONTENT
    begins = [int(asked.removeprefix("bytes=").rstrip("-") or 0) for _, asked in server.asked]
    assert len(begins) == 3
    assert 0 == begins[0] < begins[1] < begins[2]


def test_what_came_before_a_dead_end_is_kept_for_the_next_pull(server, entry):
    folder = entry("dead").folder
    folder.mkdir(parents=True)
    (folder / "net.onnx.part").write_bytes(CONTENT[:300_000])
    error = refused(entry("dead"), "cut off after 300000 bytes", HASH, str(folder))
    assert error.field == "download"
    assert server.asked == [("/dead", "bytes=300000-")]  # an attempt that brings nothing is the last
    assert left(entry("dead")) == ["net.onnx.part"]
    assert pull(entry("good"), False, silent).path.read_bytes() == CONTENT
    assert server.asked[-1] == ("/good", "bytes=300000-")


def test_a_server_without_ranges_is_read_from_the_start(entry):
    entry("whole").folder.mkdir(parents=True)
    (entry("whole").folder / "net.onnx.part").write_bytes(b"x" * 1000)
    assert pull(entry("whole"), False, silent).path.read_bytes() == CONTENT


def test_a_part_file_of_something_else_ends_in_a_wrong_hash_and_then_in_a_good_file(entry):
    entry("good").folder.mkdir(parents=True)
    (entry("good").folder / "net.onnx.part").write_bytes(b"x" * 1000)
    refused(entry("good"), "got")
    assert pull(entry("good"), False, silent).path.read_bytes() == CONTENT


def test_a_complete_part_file_needs_no_server_and_a_longer_one_is_started_over(server, entry):
    entry("good").folder.mkdir(parents=True)
    part = entry("good").folder / "net.onnx.part"
    part.write_bytes(CONTENT)
    assert pull(entry("good"), False, silent).path.read_bytes() == CONTENT
    assert server.asked == []
    entry("good").path.unlink()
    part.write_bytes(CONTENT + b"!")
    assert pull(entry("good"), False, silent).path.read_bytes() == CONTENT
    assert [begin for _, begin in server.asked] == ["bytes=512001-", ""]


def test_a_server_that_goes_on_elsewhere_is_refused(entry):
    entry("shifted").folder.mkdir(parents=True)
    (entry("shifted").folder / "net.onnx.part").write_bytes(CONTENT[:1000])
    refused(entry("shifted"), "another byte")


def test_404_is_told(entry):
    assert refused(entry("none"), "404 Not Found", HASH, str(entry("none").folder)).exit_code == 4


def test_slow_is_no_fault_and_silence_is(entry):
    assert pull(entry("slow"), False, silent, timeout=0.5).path.read_bytes() == CONTENT
    entry("slow").path.unlink()
    start = time.perf_counter()
    refused(entry("stalled"), "the server said nothing any more")
    assert time.perf_counter() - start < 4


def test_more_bytes_than_the_catalogue_says_are_not_taken(entry):
    refused(entry("longer"), "expected 512000 bytes, the server has 512001")
    refused(entry("endless"), "expected at most 512000 bytes")
    assert left(entry("endless")) == []


def test_of_a_server_that_does_not_stop_no_more_is_written_than_may_come(entry):
    told = []
    with pytest.raises(ModelError, match="expected at most 512000 bytes"):
        pull(entry("endless"), False, lambda step, done, total: told.append(done))
    assert max(told) <= len(CONTENT)


def test_a_file_of_unknown_size_is_taken_up_to_the_limit(entry, monkeypatch):
    assert pull(entry("good", size=0), False, silent).path.read_bytes() == CONTENT
    entry("good").path.unlink()
    monkeypatch.setattr("cltransfer.models.download.LARGEST", 600_000)
    refused(entry("endless", size=0), "expected at most 600000 bytes")


def test_redirects_lead_to_http_only(entry):
    assert pull(entry("elsewhere"), False, silent).path.read_bytes() == CONTENT
    entry("good").path.unlink()
    refused(entry("file"), "file:///etc/passwd")
    refused(entry("round"), "redirects")


def test_the_body_of_a_redirect_is_not_read(server, entry):
    assert pull(entry("heavy"), False, silent).path.read_bytes() == CONTENT
    assert server.sent < HEAVY / 2  # what the system buffers


def test_what_a_redirect_sets_as_a_cookie_is_sent_on(server, entry):
    assert pull(entry("known"), False, silent).path.read_bytes() == CONTENT
    assert len(server.asked) == 2


class Hops(requests.adapters.BaseAdapter):
    """Answers each address with a redirect to the next one of :data:`hops`, the last with 404."""

    def __init__(self, hops: list[str]) -> None:
        super().__init__()
        self.hops = hops
        self.asked: list[str] = []

    def send(self, request: requests.PreparedRequest, *values: object, **options: object) -> requests.Response:
        answer = requests.Response()
        answer.request, answer.url, answer.raw = request, request.url, io.BytesIO()
        place = self.hops.index(request.url) + 1
        self.asked.append(request.url)
        answer.status_code, answer.reason = (302, "Found") if place < len(self.hops) else (404, "Not Found")
        if place < len(self.hops):
            answer.headers["Location"] = self.hops[place]
        return answer

    def close(self) -> None:
        pass


@pytest.mark.parametrize(
    ("hops", "told", "asked"),
    [
        (["https://a/", "http://a/b", "https://a/c"], "leads away from https to http://a/b", 1),
        (["HTTPS://a/", "http://a/b"], "leads away from https to http://a/b", 1),
        (["http://a/", "https://a/b", "http://a/c"], "leads away from https to http://a/c", 2),
        (["http://a/", "ftp://a/b"], "leads to ftp://a/b, expected http or https", 1),
        (["http://a/", "https://a/b", "https://b/c"], "404 Not Found", 3),
        ([f"http://a/{i}" for i in range(11)], "404 Not Found", 11),
        ([f"http://a/{i}" for i in range(12)], "more than 10 redirects, the last to http://a/11", 11),
    ],
)
def test_every_redirect_is_looked_at_before_it_is_followed(entry, monkeypatch, hops, told, asked):
    adapter = Hops([hops[0].replace("HTTPS", "https"), *hops[1:]])
    monkeypatch.setattr(requests.Session, "get_adapter", lambda self, url: adapter)
    refused(entry("", address=hops[0]), told)
    assert adapter.asked == adapter.hops[:asked]


@pytest.mark.parametrize(
    ("how", "told"),
    [("nowhere", "Invalid IPv6"), ("absurd", "expected 512000 bytes, the server has 99999999999999999999")],
)
def test_a_header_that_is_none_is_no_wrong_hash(entry, how, told):
    assert refused(entry(how), told).field == "download"


def test_nobody_there_is_told_with_file_address_hash_and_folder(entry):
    entry("good").folder.mkdir(parents=True)
    for address in ("http://127.0.0.1:9/a", "http://no-such-host.invalid/a"):
        gone = entry("good", address=address)
        error = refused(gone, HASH, str(gone.folder))
        assert (error.exit_code, error.field) == (4, "download")
    asset = entry("good", kind="asset", address="http://127.0.0.1:9/a")
    assert isinstance(refused(asset, "connection was refused"), InputError)


def test_an_unknown_hash_is_refused_then_accepted_and_pinned(server, entry):
    new = entry("good", sha256="", size=0)
    assert isinstance(refused(new, "is not known", "--accept-new"), ModelError)
    assert server.asked == []
    had = pull(new, True, silent)
    assert (had.sha256, had.size) == (HASH, len(CONTENT))
    assert pinned(new) == had
    pins = json.loads((new.folder.parent / "pins.json").read_text())
    pin = {"address": new.address, "sha256": HASH, "size": len(CONTENT), "file": "net.onnx"}
    assert pins == {"models": {"mine": pin}}
    refused_later = replace(pinned(new), file="other.onnx")
    assert pull(refused_later, False, silent).path.read_bytes() == CONTENT


@pytest.mark.parametrize("known", [False, True])
def test_two_pulls_of_one_file_at_once_are_both_of_all_of_it(server, entry, known):
    new = entry("slow") if known else entry("slow", sha256="", size=0)

    def later(seconds: float) -> Entry:
        time.sleep(seconds)
        return pull(new, True, silent)

    with ThreadPoolExecutor(2) as pool:
        both = list(pool.map(later, (0.0, 0.15)))
    assert [had.sha256 for had in both] == [HASH, HASH]
    assert new.path.read_bytes() == CONTENT
    assert known or pinned(new).size == len(CONTENT)


def test_who_has_waited_for_another_pull_takes_what_that_has_pinned(server, entry, monkeypatch):
    new = entry("changing", sha256="", size=0)

    def slow_pin(entry: Entry, sha256: str) -> Entry:
        time.sleep(0.3)
        return pin(entry, sha256)

    def later(seconds: float) -> Entry:
        time.sleep(seconds)
        return pull(new, True, silent)

    monkeypatch.setattr("cltransfer.models.download.pin", slow_pin)
    with ThreadPoolExecutor(2) as pool:
        both = list(pool.map(later, (0.0, 0.15)))
    assert [(had.sha256, had.size) for had in both] == [(HASH, len(CONTENT))] * 2
    assert new.path.read_bytes() == CONTENT
    assert len(server.asked) == 1


def test_a_new_file_is_never_put_together_from_halves(server, entry):
    new = entry("good", sha256="", size=0)
    new.folder.mkdir(parents=True)
    (new.folder / "net.onnx.part").write_bytes(b"x" * 1000)
    assert pull(new, True, silent).sha256 == HASH
    assert server.asked == [("/good", "")]


def test_a_file_that_is_there_is_replaced_by_a_whole_one_only(server, entry):
    new = entry("dead", sha256="", size=0)
    new.folder.mkdir(parents=True)
    new.path.write_bytes(b"works")
    with pytest.raises(ModelError, match="cut off"):
        pull(new, True, silent, timeout=0.5)
    assert new.path.read_bytes() == b"works"
    assert [name for name in left(new) if name.startswith(".tmp")] == []
    asked = len(server.asked)
    assert pull(new, False, silent) == new
    assert (new.path.read_bytes(), len(server.asked)) == (b"works", asked)
    assert pull(entry("good", sha256="", size=0), True, silent).sha256 == HASH
    assert new.path.read_bytes() == CONTENT


def test_a_pinned_entry_with_other_content_is_refused(server, entry):
    new = entry("good", sha256="", size=0)
    had = pull(new, True, silent)
    had.path.write_bytes(CONTENT[::-1])
    assert pull(pinned(new), False, silent).path.read_bytes() == CONTENT
    changed = replace(had, address=f"{server.address}/other")
    had.path.unlink()
    refused(changed, "got")


def test_an_entry_without_an_address_says_how_it_is_made(entry):
    made = entry("good", address="", made_by="python tools/export_onnx.py")
    with pytest.raises(ModelError, match=r"not published as such.*tools/export_onnx"):
        pull(made, False, silent)


def test_a_link_out_of_the_cache_is_not_followed(entry, tmp_path):
    clip = entry("good", kind="asset", file="clip/a.png")
    (tmp_path / "outside").mkdir()
    clip.folder.mkdir(parents=True)
    (clip.folder / "clip").symlink_to(tmp_path / "outside")
    refused(clip, "is a link out of")
    assert list((tmp_path / "outside").iterdir()) == []
