from __future__ import annotations

import contextlib
import json
import shlex
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from cltransfer.config import load_config
from cltransfer.errors import InputError, ModelError, UsageError
from cltransfer.models.catalogue import (
    LARGEST,
    Entry,
    catalogue,
    entry_of_file,
    pin,
    pinned,
    pinned_file,
    read_catalogue,
)
from cltransfer.models.onnx import Network
from cltransfer.models.places import adopt, find_model
from cltransfer.pipeline.components import Components
from cltransfer.storage.alone import in_turn
from cltransfer.storage.files import content_hash, write_json

DATA = Path(__file__).resolve().parents[2].parent / "shared" / "data"
HASH = "0123456789abcdef" * 4
USUAL = {"file": "net.onnx", "task": "masks", "licence": "MIT", "source": "me/mine"}


def written(path, section="models", name="mine", **changes):
    values = {**USUAL, **changes}
    lines = [f"{section}:", f"  {name}:", *(f"    {key}: {value}" for key, value in values.items())]
    path.write_text("\n".join(lines))
    return path


def test_every_extractor_of_a_network_has_one_in_the_catalogue():
    from cltransfer.registry import EXTRACTORS

    tasks = " ".join(entry.task for entry in catalogue("model").values())
    networks = [name for name in EXTRACTORS.names() if "model" in EXTRACTORS.options(name)]
    assert len(networks) >= 8
    assert [name for name in networks if name not in tasks] == []


def test_every_entry_can_be_pulled_or_says_how_it_is_made():
    for kind in ("model", "asset"):
        for entry in catalogue(kind).values():
            assert entry.address or entry.made_by, entry.name
            assert entry.sha256 or kind == "model", entry.name


@pytest.mark.needs("models/yolox_nano.onnx", "mesh", "splat", "video")
def test_hashes_and_sizes_are_those_of_the_shared_files():
    shared = {path.name: path for path in DATA.rglob("*") if path.is_file()}
    checked = 0
    for kind in ("model", "asset"):
        for entry in catalogue(kind).values():
            found = shared.get(Path(entry.file).name)
            if found is not None:
                assert (content_hash(found), found.stat().st_size) == (entry.sha256, entry.size), entry.name
                checked += 1
    assert checked >= 20


def test_demo_is_a_scene_and_a_clip():
    group = [entry for entry in catalogue("asset").values() if entry.group == "demo"]
    assert sorted(Path(entry.file).suffix for entry in group) == [".mp4", ".ply"]
    assert all(entry.address and entry.sha256 for entry in group)


def test_a_catalogue_of_ones_own_adds_to_ours(tmp_path, monkeypatch):
    one = written(tmp_path / "one.yaml", address="https://example.org/net.onnx", sha256=HASH, size=12)
    assert catalogue("model", [one])["mine"] == Entry(
        "mine", "model", **USUAL, address="https://example.org/net.onnx", sha256=HASH, size=12
    )
    assert "mine" not in catalogue("model")
    monkeypatch.setenv("CLTRANSFER_CATALOGUE", str(one))
    assert "yolox_nano" in catalogue("model")
    assert entry_of_file("net.onnx").name == "mine"
    assert entry_of_file("other.onnx") is None


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"file": "../net.onnx"}, "plain name"),
        ({"file": "/etc/net.onnx"}, "plain name"),
        ({"file": "folder/net.onnx"}, "plain name"),
        ({"file": ".hidden"}, "plain name"),
        ({"address": "file:///etc/passwd"}, "http or https"),
        ({"address": "ftp://example.org/a"}, "http or https"),
        ({"address": "https:///a"}, "http or https"),
        ({"sha256": "'12'"}, "64 digits"),
        ({"size": -1}, "at most"),
        ({"size": 10**12}, "at most"),
        ({"size": "many"}, "size must be int"),
        ({"licence": "''"}, "licence is missing"),
        ({"licence": "null"}, "licence"),
        ({"hash": HASH}, "no such key"),
    ],
)
def test_entries_that_cannot_be_meant_are_refused_in_one_line(tmp_path, changes, reason):
    with pytest.raises(UsageError, match=reason) as caught:
        read_catalogue(written(tmp_path / "one.yaml", **changes))
    assert "\n" not in str(caught.value)
    assert "models.mine" in str(caught.value)


def test_taken_names_and_files_and_other_sections_are_refused(tmp_path):
    for taken in ({"name": "yolox_nano"}, {"file": "yolox_nano.onnx"}):
        with pytest.raises(UsageError, match="already"):
            catalogue("model", [written(tmp_path / "one.yaml", **taken)])
    with pytest.raises(UsageError, match="expected models and assets"):
        read_catalogue(written(tmp_path / "one.yaml", section="networks"))
    with pytest.raises(UsageError, match="no such file"):
        read_catalogue(tmp_path / "none.yaml")
    (tmp_path / "list.yaml").write_text("models: [a, b]")
    with pytest.raises(UsageError, match="expected a mapping"):
        read_catalogue(tmp_path / "list.yaml")


def test_a_pin_holds_for_its_address_only(tmp_path, monkeypatch):
    monkeypatch.setenv("CLTRANSFER_CACHE", str(tmp_path))
    new = Entry("mine", "model", **USUAL, address="https://example.org/a")
    assert pinned(new) == new
    new.folder.mkdir()
    new.path.write_bytes(b"abc")
    known = pin(new, HASH)
    assert (known.sha256, known.size) == (HASH, 3)
    assert pinned(new) == known
    moved = Entry("mine", "model", **USUAL, address="https://example.org/b")
    assert pinned(moved).sha256 == ""
    asset = Entry("mine", "asset", **USUAL, address="https://example.org/a")
    assert pinned(asset).sha256 == ""


def test_a_file_that_another_entry_has_replaced_is_known_by_that_one(tmp_path, monkeypatch):
    monkeypatch.setenv("CLTRANSFER_CACHE", str(tmp_path))
    first, second = (Entry(name, "model", **USUAL, address=f"https://example.org/{name}") for name in ("b", "a"))
    first.folder.mkdir()
    first.path.write_bytes(b"abc")
    for entry, sha256 in ((first, HASH), (second, HASH[::-1]), (first, HASH)):
        pin(entry, sha256)
        assert pinned_file(entry.path) == sha256


PINNED = {"address": "https://example.org/a", "sha256": HASH, "size": 3}


@pytest.mark.parametrize(
    ("content", "field"),
    [
        ([], "expected a mapping of models"),
        ({"models": 5}, "models: expected a mapping of names"),
        ({"models": {"mine": []}}, "models.mine: expected address, sha256 and size"),
        ({"models": {"mine": {**PINNED, "sha256": None}}}, "models.mine: expected"),
        ({"models": {"mine": {**PINNED, "sha256": int("1" * 64)}}}, "models.mine: expected"),
        ({"models": {"mine": {**PINNED, "size": "3"}}}, "models.mine: expected"),
        ({"models": {"mine": {**PINNED, "size": -1}}}, "models.mine: expected"),
        ({"models": {"mine": {**PINNED, "size": LARGEST + 1}}}, "models.mine: expected"),
        ({"models": {"mine": {"address": "https://example.org/a"}}}, "models.mine: expected"),
    ],
)
def test_damaged_pins_are_named_with_what_to_do(tmp_path, monkeypatch, content, field):
    monkeypatch.setenv("CLTRANSFER_CACHE", str(tmp_path))
    (tmp_path / "pins.json").write_text(json.dumps(content))
    new = Entry("mine", "model", **USUAL, address="https://example.org/a")
    for use in (pinned, lambda entry: pin(entry, HASH)):
        new.folder.mkdir(exist_ok=True)
        new.path.touch()
        with pytest.raises(InputError, match=rf"pins\.json: {field}.* \(delete the file, then pull"):
            use(new)


@pytest.mark.parametrize("locks", [True, False])
def test_two_that_pin_at_once_are_both_remembered_where_there_are_locks(tmp_path, monkeypatch, locks):
    monkeypatch.setenv("CLTRANSFER_CACHE", str(tmp_path / "cache"))
    if not locks:
        monkeypatch.setitem(sys.modules, "fcntl", None)
    both, meet = [Entry(name, "model", **USUAL, address="https://a") for name in ("one", "other")], threading.Barrier(2)
    both[0].folder.mkdir(parents=True)
    both[0].path.touch()

    def slow(path, pins):
        with contextlib.suppress(threading.BrokenBarrierError):
            meet.wait(0.2)  # each has read what is pinned before either writes, unless one is kept out
        write_json(path, pins)

    monkeypatch.setattr("cltransfer.models.catalogue.write_json", slow)
    with ThreadPoolExecutor(2) as pool:
        list(pool.map(lambda entry: pin(entry, HASH), both))
    assert [pinned(entry).sha256 for entry in both].count(HASH) == (2 if locks else 1)


def test_a_file_is_pinned_where_nothing_was_pulled_before(tmp_path, monkeypatch):
    monkeypatch.setenv("CLTRANSFER_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(Entry, "path", tmp_path / "net.onnx")
    (tmp_path / "net.onnx").touch()
    entry = Entry("mine", "model", **USUAL, address="https://a")
    assert pin(entry, HASH) == pinned(entry)


def test_what_one_made_is_the_network_from_then_on(tmp_path, monkeypatch):
    monkeypatch.setenv("CLTRANSFER_CACHE", str(tmp_path / "my cache"))
    monkeypatch.setenv("CLTRANSFER_MODELS", "")
    monkeypatch.setenv("CLTRANSFER_CATALOGUE", str(written(tmp_path / "mine.yaml", file="mine.onnx", sha256=HASH)))
    made = tmp_path / "made.onnx"
    made.write_bytes(b"other bytes")
    mine = catalogue("model")["mine"]
    mine.folder.mkdir(parents=True)
    mine.path.write_bytes(b"other bytes")  # put there by hand: another network by the same name
    with pytest.raises(ModelError, match=f"if you made it: cltransfer models adopt mine {shlex.quote(str(mine.path))}"):
        _ = Network(find_model("mine.onnx"), {}, {}).session
    mine.path.unlink()
    had = adopt(mine, made)
    assert had.path.read_bytes() == b"other bytes"
    assert catalogue("model")["mine"].sha256 == had.sha256 == content_hash(made) != HASH
    with pytest.raises(
        ModelError, match=r"mine\.onnx: model: "
    ):  # its content is right now, only that it is no network
        _ = Network(find_model("mine.onnx"), {}, {}).session


def test_what_one_made_is_not_adopted_where_another_file_would_be_found_before_it(tmp_path, monkeypatch):
    monkeypatch.setenv("CLTRANSFER_CACHE", str(tmp_path / "cache"))
    monkeypatch.setenv("CLTRANSFER_MODELS", str(tmp_path / "weights"))
    mine, first = Entry("mine", "model", **USUAL), tmp_path / "weights" / "net.onnx"
    first.parent.mkdir()
    first.write_bytes(b"of an earlier day")
    (tmp_path / "made.onnx").write_bytes(b"made")
    with pytest.raises(UsageError) as caught:
        adopt(mine, tmp_path / "made.onnx")
    told = "mine: is another file, and is found before the one in the cache (remove or rename it)"
    assert str(caught.value) == f"{first}: {told}"
    assert not (tmp_path / "cache" / "pins.json").exists()
    assert adopt(mine, first).sha256 == content_hash(first)  # as the error of such a file says
    monkeypatch.setenv("CLTRANSFER_MODELS", str(tmp_path / "weights" / ".." / "cache" / "models"))
    assert adopt(mine, tmp_path / "made.onnx").sha256 == content_hash(tmp_path / "made.onnx")


def test_what_one_made_is_adopted_when_nobody_else_replaces_the_file(tmp_path, monkeypatch):
    monkeypatch.setenv("CLTRANSFER_CACHE", str(tmp_path / "cache"))
    mine = Entry("mine", "model", **USUAL)
    (tmp_path / "made.onnx").write_bytes(b"made here")
    with ThreadPoolExecutor(1) as pool:
        with in_turn(mine.lock):
            later = pool.submit(adopt, mine, tmp_path / "made.onnx")
            time.sleep(0.2)
            assert not mine.path.exists()
        assert later.result(timeout=10).sha256 == content_hash(mine.path)


def test_what_is_published_is_not_adopted(tmp_path):
    with pytest.raises(UsageError, match=r"is published, at https://example\.org/a"):
        adopt(Entry("mine", "model", **USUAL, address="https://example.org/a"), tmp_path / "made.onnx")
    with pytest.raises(InputError, match="no such file"):
        adopt(Entry("mine", "model", **USUAL), tmp_path / "made.onnx")


def test_errors_of_networks_and_of_assets_have_their_own_exit_codes():
    assert isinstance(Entry("mine", "model", **USUAL).error("a", "b"), ModelError)
    assert isinstance(Entry("mine", "asset", **USUAL).error("a", "b"), InputError)


def test_what_the_presets_need_is_one_group_whose_hashes_are_known(monkeypatch, tmp_path):
    monkeypatch.delenv("CLTRANSFER_MODELS", raising=False)
    monkeypatch.setenv("CLTRANSFER_CACHE", str(tmp_path))
    pulled = [entry for entry in catalogue("model").values() if entry.group == "default"]
    assert all(entry.address and entry.sha256 and entry.size for entry in pulled)
    for entry in pulled:
        entry.path.parent.mkdir(exist_ok=True)
        entry.path.touch()
    parts = Components.build(load_config()).extractors.values()
    networks = [part.model for part in parts if hasattr(part, "model")]
    assert {find_model(name).name for name in networks} == {entry.file for entry in pulled}
