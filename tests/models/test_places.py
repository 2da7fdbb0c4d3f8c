import os

import pytest

from cltransfer.errors import ModelError, UsageError
from cltransfer.models.catalogue import catalogue
from cltransfer.models.content import model_content
from cltransfer.models.places import find_model
from cltransfer.storage.files import content_hash

KNOWN = catalogue("model")


def test_models_are_found_in_each_folder_then_in_the_cache(tmp_path, monkeypatch):
    for folder in ("one", "two", "cache/models"):
        (tmp_path / folder).mkdir(parents=True)
    monkeypatch.setenv("CLTRANSFER_MODELS", os.pathsep.join([str(tmp_path / "one"), str(tmp_path / "two")]))
    monkeypatch.setenv("CLTRANSFER_CACHE", str(tmp_path / "cache"))
    for folder in ("cache/models", "two", "one"):
        (tmp_path / folder / "a.onnx").touch()
        assert find_model("a.onnx") == tmp_path / folder / "a.onnx"
    assert find_model(str(tmp_path / "two" / "a.onnx")) == tmp_path / "two" / "a.onnx"


def test_a_missing_model_says_what_to_get_and_where_to_put_it(tmp_path, monkeypatch):
    monkeypatch.setenv("CLTRANSFER_MODELS", str(tmp_path / "weights"))
    with pytest.raises(ModelError) as caught:
        find_model("yolox_nano.onnx")
    known = KNOWN["yolox_nano"]
    wanted = ("yolox_nano.onnx", known.sha256, known.source, known.licence, "models pull default")
    for part in (*wanted, str(tmp_path / "weights")):
        assert part in str(caught.value)


@pytest.mark.parametrize(
    ("file", "get"),
    [
        ("yolox_nano.onnx", "cltransfer models pull default"),
        ("mp_pose_landmark_lite.onnx", KNOWN["mp_pose_landmark_lite"].made_by),
    ],
)
def test_the_way_to_a_missing_model_that_is_named_with_its_folder_leads_there(tmp_path, file, get):
    with pytest.raises(ModelError) as caught:
        find_model(str(tmp_path / file))
    assert str(caught.value).endswith(f"(run: {get}; then write model={file}, or put {file} in {tmp_path})")
    with pytest.raises(ModelError) as caught:
        find_model(file)
    assert "write" not in str(caught.value)


THEIRS = """models:
  ours: {file: ours.onnx, task: t, licence: l, source: s, made_by: make ours}
  theirs: {file: theirs.onnx, task: t, licence: l, source: s, address: https://a, sha256: SHA, stands_in_for: NAME}
"""


@pytest.fixture
def theirs(tmp_path, monkeypatch):
    """The file of a network that stands in for ``ours``, whose file is missing."""
    path = tmp_path / "theirs.onnx"
    path.write_bytes(b"theirs")
    named = THEIRS.replace("SHA", content_hash(path)).replace("NAME", "ours")
    (tmp_path / "mine.yaml").write_text(named)
    monkeypatch.setenv("CLTRANSFER_CATALOGUE", str(tmp_path / "mine.yaml"))
    monkeypatch.setenv("CLTRANSFER_MODELS", str(tmp_path))
    return path


def test_a_network_stands_in_for_one_that_is_missing_and_for_no_other(theirs):
    assert find_model("ours.onnx") == theirs
    assert model_content("ours.onnx") == content_hash(theirs)
    ours = theirs.with_name("ours.onnx")
    ours.write_bytes(b"ours")
    assert find_model("ours.onnx") == ours
    assert model_content("ours.onnx") == content_hash(ours)
    theirs.unlink()
    ours.unlink()
    help_ = r"no such file, nor theirs\.onnx.*run: cltransfer models pull theirs; or put theirs\.onnx in"
    with pytest.raises(ModelError, match=help_):
        find_model("ours.onnx")
    ours.write_bytes(b"ours")
    with pytest.raises(ModelError, match=r"theirs\.onnx"):
        find_model("theirs.onnx")


def test_a_stand_in_for_nothing_is_refused(theirs):
    path = theirs.with_name("mine.yaml")
    path.write_text(path.read_text().replace("stands_in_for: ours", "stands_in_for: our"))
    with pytest.raises(UsageError, match=r"theirs\.stands_in_for: no such model in the catalogue: our"):
        find_model("theirs.onnx")
