from dataclasses import dataclass, replace

import pytest

from cltransfer.extractors.depth_onnx import DepthOnnx
from cltransfer.extractors.detect_yolox import DetectYolox
from cltransfer.models.catalogue import catalogue
from cltransfer.models.content import model_content, read_by, read_otherwise, reading

KNOWN = catalogue("model")


def test_what_was_read_by_another_network_of_the_same_name_is_told_apart(tmp_path, monkeypatch):
    monkeypatch.setenv("CLTRANSFER_MODELS", str(tmp_path))
    extractor = DepthOnnx(model="mine.onnx", kind="disparity")
    keys = [reading(extractor)]
    for content in (b"first", b"other"):
        (tmp_path / "mine.onnx").write_bytes(content)
        keys.append(reading(extractor))
    assert keys[0]["sha256"] == ""
    assert len({key["sha256"] for key in keys}) == 3
    assert keys[0]["model"] == "mine.onnx"


@dataclass(frozen=True)
class Weighted:
    """A plugin's extractor, whose files stand in options of any name."""

    weights: str = "w.pt"
    more: tuple[str, ...] = ("x" * 5000, "")
    model: int = 3
    folder: str = "./parts"


def test_what_was_read_by_other_files_of_a_plugin_is_told_apart(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("CLTRANSFER_MODELS", str(tmp_path / "models"))
    (tmp_path / "models").mkdir()
    (tmp_path / "parts").mkdir()
    extractor, places = Weighted(more=("bpe.txt", "x" * 5000, "")), ("w.pt", "bpe.txt", "parts/a", "models/w.pt")
    keys = [reading(extractor)]
    for place in places:
        for content in ("1", "100"):
            (tmp_path / place).write_text(content)
            keys.append(reading(extractor))
    assert all(keys.count(key) == 1 for key in keys)
    assert reading(extractor) == keys[-1]
    assert "files" not in reading(replace(extractor, weights="other.pt", more=(), folder="parts"))


@dataclass(frozen=True)
class Head:
    weights: str = "w.pt"


@dataclass(frozen=True)
class OfHeads:
    """A plugin's extractor, whose files stand in options of options."""

    head: Head = Head()
    more: tuple[Head, ...] = ()


def test_what_was_read_by_another_file_that_an_option_of_an_option_names_is_told_apart(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    extractor, keys = OfHeads(more=(Head("x.pt"),)), []
    for place in ("w.pt", "x.pt"):
        for content in ("1", "100"):
            (tmp_path / place).write_text(content)
            keys.append(reading(extractor))
    assert all(keys.count(key) == 1 for key in keys)
    assert set(keys[-1]["files"]) == {"w.pt", "x.pt"}


def test_a_file_of_a_plugin_counts_by_its_content_wherever_models_are_kept(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    keys = []
    for home in ("here", "there"):
        (tmp_path / home).mkdir()
        (tmp_path / home / "w.pt").write_text("1")
        monkeypatch.setenv("CLTRANSFER_MODELS", str(tmp_path / home))
        keys.append(reading(Weighted()))
    assert keys[0] == keys[1]
    assert "w.pt" in keys[0]["files"]


@pytest.mark.parametrize("text", ["/", "./", "../", "."])
def test_a_text_that_is_the_folder_one_works_in_or_one_around_it_is_no_folder_of_weights(text, tmp_path, monkeypatch):
    (tmp_path / "work").mkdir()
    monkeypatch.chdir(tmp_path / "work")
    monkeypatch.setattr("cltransfer.models.content.content_hash", lambda path: pytest.fail(f"{path} was read"))
    assert "files" not in reading(Weighted(folder=text))


def test_a_file_that_happens_to_bear_the_name_of_an_option_of_ours_is_nothing(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    ours = DepthOnnx(model="mine.onnx", kind="disparity")
    before = reading(ours)
    (tmp_path / ours.output).write_text("of something else")
    assert reading(ours) == before


def test_a_file_of_the_catalogue_has_the_content_it_has_there(tmp_path, monkeypatch):
    monkeypatch.setenv("CLTRANSFER_MODELS", str(tmp_path))
    assert model_content(DetectYolox().model) == KNOWN["yolox_nano"].sha256 != ""


def test_what_reads_otherwise_than_elsewhere_is_told_by_name(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CLTRANSFER_NETWORKS", "cpu")
    packages, others, networks = here = read_by()
    assert read_otherwise(here) == ""
    assert read_otherwise([packages, others, "cuda"]) == "CLTRANSFER_NETWORKS cpu, not cuda"
    there = [{**packages, "torch": "1.0"}, {**others, "pycolmap_of_theirs": "3"}, networks]
    told = f"torch {packages['torch']}, not 1.0; pycolmap_of_theirs absent, not 3"
    assert read_otherwise(there) == told
