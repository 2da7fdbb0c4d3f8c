from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from threading import Thread
from typing import Any

import pytest

from cltransfer.errors import ModelError
from cltransfer.models.catalogue import catalogue, pinned_file
from cltransfer.models.onnx import Network

DATA = Path(__file__).resolve().parents[2].parent / "shared" / "data"
CONTENT = b"a network, for all that a catalogue knows" * 100
HASH = hashlib.sha256(CONTENT).hexdigest()


class Quiet(SimpleHTTPRequestHandler):
    def log_message(self, *values: object) -> None:
        pass


@pytest.fixture
def mine(tmp_path, monkeypatch):
    """A catalogue with a known and a new network, and a group of two assets, on a loopback server."""
    (tmp_path / "served").mkdir()
    (tmp_path / "served" / "net.onnx").write_bytes(CONTENT)
    monkeypatch.setenv("CLTRANSFER_MODELS", "")
    monkeypatch.setenv("NO_PROXY", "*")
    with ThreadingHTTPServer(("127.0.0.1", 0), partial(Quiet, directory=tmp_path / "served")) as server:
        Thread(target=server.serve_forever, kwargs={"poll_interval": 0.01}, daemon=True).start()
        usual = f"task: t, licence: MIT, source: me, address: 'http://127.0.0.1:{server.server_address[1]}/net.onnx'"
        known = f"{usual}, sha256: {HASH}, size: {len(CONTENT)}"
        (tmp_path / "mine.yaml").write_text(
            f"models:\n  known_net: {{file: known.onnx, {known}}}\n  new_net: {{file: new.onnx, {usual}}}\n"
            f"assets:\n  one: {{file: pair/one.ply, group: pair, {known}}}\n"
            f"  two: {{file: two.ply, group: pair, {known}}}\n"
        )
        monkeypatch.setenv("CLTRANSFER_CATALOGUE", str(tmp_path / "mine.yaml"))
        yield tmp_path / "mine.yaml"
        server.shutdown()


@pytest.fixture(autouse=True)
def cache(tmp_path):
    return tmp_path / "cache"


Command = Callable[..., Any]


def test_list_tells_of_every_network_where_it_is_and_comes_from(command: Command, mine: Path) -> None:
    answer = command("models", "list")
    assert answer.code == 0
    for word in ("yolox_nano", "known_net  ", "AGPL-3.0", "pose_topdown", "https://", "tools/export_onnx.py"):
        assert word in answer.out
    rows = {row["name"]: row for row in json.loads(command("models", "list", "--json").out)}
    assert rows["known_net"]["sha256"] == HASH
    assert rows["known_net"]["path"] == ""
    command("models", "pull", "known_net")
    line = next(line for line in command("models", "list").out.splitlines() if line.startswith("known_net"))
    assert line.split()[1] == "here"


def test_pull_prints_where_the_file_is_and_check_finds_it_right(command: Command, mine: Path, cache: Path) -> None:
    answer = command("models", "pull", "known_net")
    assert (answer.code, answer.out) == (0, f"{cache}/models/known.onnx\n")
    assert (cache / "models" / "known.onnx").read_bytes() == CONTENT
    checked = command("models", "check")
    assert (checked.code, checked.out) == (0, "known.onnx: ok\n")


def test_check_ends_with_4_on_other_content_and_on_what_is_missing(command: Command, mine: Path, cache: Path) -> None:
    (cache / "models").mkdir(parents=True)
    (cache / "models" / "known.onnx").write_bytes(b"other")
    checked = command("models", "check")
    assert checked.code == 4
    assert f"expected {HASH}, got {hashlib.sha256(b'other').hexdigest()}" in checked.out
    missing = command("models", "check", "yolox_nano", "--json")
    assert missing.code == 4
    assert json.loads(missing.out)[0]["state"] == "missing"


def test_a_new_file_is_taken_only_when_asked_and_its_hash_is_printed(command: Command, mine: Path, cache: Path) -> None:
    refused = command("models", "pull", "new_net")
    assert refused.code == 4
    assert refused.err.count("\n") == 1
    assert "--accept-new" in refused.err
    taken = command("models", "pull", "new_net", "--accept-new")
    assert taken.out == f"{cache}/models/new.onnx sha256 {HASH}, pinned\n"
    assert command("models", "check", "new_net").out == "new.onnx: ok\n"
    assert command("models", "pull", "new_net").out == f"{cache}/models/new.onnx\n"


def test_the_hash_that_was_pinned_is_printed_though_a_later_network_fails(
    command: Command, mine: Path, cache: Path
) -> None:
    catalogue = mine.read_text()
    new = next(line for line in catalogue.splitlines() if "new_net" in line)
    dead = new.replace("new_net", "dead_net").replace("new.onnx", "dead.onnx").replace("/net.onnx", "/nothing.onnx")
    mine.write_text(catalogue.replace(new, f"{new}\n{dead}"))
    answer = command("models", "pull", "new_net", "dead_net", "--accept-new")
    assert (answer.code, answer.out) == (4, f"{cache}/models/new.onnx sha256 {HASH}, pinned\n")
    answer = command("models", "pull", "new_net", "dead_net", "--accept-new", "--json")
    assert [row["name"] for row in json.loads(answer.out)] == ["new_net"]
    assert command("models", "pull", "dead_net", "--accept-new", "--json").out == ""


def test_a_group_of_assets_is_pulled_by_one_name(command: Command, mine: Path, cache: Path) -> None:
    answer = command("assets", "pull", "pair", "--json")
    assert [row["path"] for row in json.loads(answer.out)] == [
        f"{cache}/assets/pair/one.ply",
        f"{cache}/assets/two.ply",
    ]
    assert "known_net" not in command("assets", "list").out


def test_a_catalogue_can_be_named_on_the_command_line(command: Command, mine: Path, monkeypatch) -> None:
    monkeypatch.delenv("CLTRANSFER_CATALOGUE")
    unknown = command("models", "pull", "known_net")
    assert unknown.code == 2
    assert "no such model" in unknown.err
    assert "known: default, " in command("models", "pull", "zzz").err  # groups are named too
    assert command("models", "pull", "known_net", "--catalogue", mine).code == 0


@pytest.mark.parametrize("name", ["known", "new"])
def test_a_network_of_a_catalogue_that_was_named_once_is_checked_when_it_is_run(
    command: Command, mine: Path, cache: Path, monkeypatch, name: str
) -> None:
    monkeypatch.delenv("CLTRANSFER_CATALOGUE")
    assert command("models", "pull", f"{name}_net", "--accept-new", "--catalogue", mine).code == 0
    path = cache / "models" / f"{name}.onnx"
    for content, field in ((CONTENT, "model"), (b"another network", "sha256")):
        path.write_bytes(content)
        with pytest.raises(ModelError) as caught:
            _ = Network(path, {}, {}).session
        assert caught.value.field == field
    assert caught.value.reason.startswith(f"expected {HASH}, got ")
    elsewhere = path.rename(mine.with_name(path.name))  # somebody's own network may have the same name
    with pytest.raises(ModelError, match="model: "):
        _ = Network(elsewhere, {}, {}).session


def test_a_file_is_pinned_to_what_was_pulled_last(command: Command, mine: Path, cache: Path, monkeypatch) -> None:
    monkeypatch.delenv("CLTRANSFER_CATALOGUE")
    other = mine.with_name("other.yaml")
    other.write_text(mine.read_text().replace("new_net", "newest"))
    for content, name, more in ((CONTENT, "new_net", mine), (b"a later version", "newest", other)):
        (mine.parent / "served" / "net.onnx").write_bytes(content)
        assert command("models", "pull", name, "--accept-new", "--catalogue", more).code == 0
        assert pinned_file(cache / "models" / "new.onnx") == hashlib.sha256(content).hexdigest()
    assert catalogue("model", [mine])["new_net"].sha256 == HASH


def test_a_network_that_one_made_is_adopted_and_right(
    command: Command, tmp_path: Path, cache: Path, monkeypatch
) -> None:
    monkeypatch.setenv("CLTRANSFER_MODELS", "")
    (tmp_path / "blazepose.onnx").write_bytes(CONTENT)
    answer = command("models", "adopt", "mp_pose_landmark_lite", tmp_path / "blazepose.onnx")
    path = cache / "models" / "mp_pose_landmark_lite.onnx"
    assert (answer.code, answer.out) == (0, f"{path} sha256 {HASH}, pinned\n")
    assert command("models", "check").out == "mp_pose_landmark_lite.onnx: ok\n"
    answer = command("models", "adopt", "yolox_nano", tmp_path / "blazepose.onnx")
    assert answer.code == 2
    assert "pull this one" in answer.err


@pytest.mark.parametrize("words", [("models", "pull"), ("assets", "pull"), ("models", "check"), ("models", "adopt")])
def test_an_empty_name_means_nothing(command: Command, mine: Path, cache: Path, words: tuple[str, str]) -> None:
    answer = command(*words, "", *([mine] if "adopt" in words else []))
    assert answer.code == 2
    assert f"NAME: expected a name of the catalogue, got '' (see: cltransfer {words[0]} list)" in answer.err
    assert not cache.exists()


def test_a_group_is_not_adopted(command: Command, mine: Path) -> None:
    mine.write_text(
        mine.read_text()
        .replace("{file: known", "{group: both, file: known")
        .replace("{file: new", "{group: both, file: new")
    )
    answer = command("models", "adopt", "both", mine)
    assert answer.code == 2
    assert "both: is a group (expected one network: known_net, new_net)" in answer.err


def test_offline_the_one_line_names_file_address_hash_and_folder(command: Command, mine: Path, cache: Path) -> None:
    away = mine.with_name("away.yaml")
    away.write_text(
        mine.read_text().replace("http://127.0.0.1", "http://127.0.0.1:9/#").replace("known_net", "far_net")
        .replace("known.onnx", "far.onnx").replace("new", "newer").replace("one", "three").replace("two", "four")
    )  # fmt: skip
    answer = command("models", "pull", "far_net", "--catalogue", away)
    assert answer.code == 4
    assert answer.err.count("\n") == 1
    for part in ("far.onnx", "http://127.0.0.1:9/", HASH, str(cache / "models")):
        assert part in answer.err


@pytest.mark.needs(
    "models/yolox_nano.onnx", "models/mp_pose_landmark_lite.onnx", "models/mp_selfie_segmentation_landscape.onnx"
)
def test_the_shared_networks_are_ok(command: Command, monkeypatch) -> None:
    monkeypatch.setenv("CLTRANSFER_MODELS", str(DATA / "models"))
    checked = command("models", "check")
    assert checked.code == 0
    assert checked.out.count(": ok") == 3


def test_an_option_of_align_that_is_written_as_a_key_is_told_as_that(command: Callable[..., Any]) -> None:
    answer = command("models", "align", "builtin:plaza", "views=3")
    assert answer.code == 2
    assert answer.err == "error: command line: views: no such key (--views 3 is an option)\n"
