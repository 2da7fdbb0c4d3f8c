"""The page of a clip's reading: a picture of each frame, doubtful ones marked, coverage told."""

import html
import json
import re
import shlex
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import pytest
import torch

from cltransfer.clips.source import ClipSource
from cltransfer.config import load_config
from cltransfer.inspect_clip import Inspection, inspect_clip, reading_confidence, write_inspection
from cltransfer.pipeline.components import Components
from cltransfer.pipeline.objective import Objective
from cltransfer.pipeline.scores import score
from cltransfer.reading.feature_file import FeatureFile
from cltransfer.reading.reference import Reference
from cltransfer.report.inspection_page import MARK
from cltransfer.storage.pages import check_page
from cltransfer.testing import sample_features, without_person


def test_a_shot_is_laid_open(command: Any, tmp_path: Path) -> None:
    said = command("inspect", "builtin:push_in", "frames=2", "output_side=96", "--out", tmp_path / "page", "--json")
    assert said.code == 0, said.err
    value = json.loads(said.out)
    assert value["person"] == 2
    assert value["terms"]["camera_movement"]["defined"] == 1
    page = (tmp_path / "page" / "index.html").read_text()
    assert page.count("<figure") == 2
    assert "LS, 5/5 key joints" in page
    for name in ("0000.png", "0000_flow.png", "0001.png", "0001_flow.png"):
        assert f"frames/{name}" in page
        assert (tmp_path / "page" / "frames" / name).stat().st_size > 500


def test_meanwhile_threads_are_the_config_s() -> None:
    cv2.setNumThreads(3)
    config, during = load_config(overrides=["threads=1", "frames=2", "output_side=64"]), set[int]()
    inspect_clip("builtin:push_in", config, lambda step, done, of: during.add(cv2.getNumThreads()))
    assert (during, cv2.getNumThreads()) == ({1}, 3)


@pytest.fixture
def laid_open() -> Callable[[str], Inspection]:
    """Three frames of a person, read from a source of any name."""

    def make(source: str) -> Inspection:
        features = replace(sample_features(0, 3), image=None)
        image = torch.zeros(3, 3, features.size[1], features.size[0], dtype=torch.uint8)
        reference = Reference(features, torch.tensor([0.0, 0.5, 1.0]).double(), image, "clip", "", "image", {})
        scores = score(Objective(Components.build(load_config()).losses), features, features, {})
        return Inspection(source, reference, scores, reading_confidence(features), 0.1)

    return make


def test_who_is_out_of_the_frame_is_not_in_it(laid_open: Any) -> None:
    """A scene knows where its person's joints are, there too."""
    shot = laid_open("builtin:push_in")
    keypoints = shot.reference.features.require("keypoints").clone()
    keypoints[1, :, 0], keypoints[1, :, 2] = 5000.0, 0.0
    features = replace(shot.reference.features, keypoints=keypoints)
    away = replace(shot, reference=replace(shot.reference, features=features))
    assert (shot.seen, away.seen) == (3, 2)
    assert away.captions()[1] == "1: 0.50 s, no person"
    assert "yaw" in away.captions()[0]


def test_frames_of_which_little_is_sure_are_marked(laid_open: Any, tmp_path: Path) -> None:
    shot = replace(laid_open("builtin:push_in"), confidence=torch.tensor([0.9, 0.4, 0.5]))
    page = write_inspection(tmp_path, shot).read_text()
    assert [' class="doubtful"' in figure for figure in page.split("<figure")[1:]] == [False, True, False]


def test_a_page_fits_a_narrow_window_whatever_its_clip_is_called(browser: Any, laid_open: Any, tmp_path: Path) -> None:
    browser.set_window_size(500, 800)  # the narrowest that Chromium makes a window
    browser.get(write_inspection(tmp_path / "page", laid_open(f"{'x' * 96}.mp4")).as_uri())
    wide, shown = browser.execute_script("return [document.documentElement.scrollWidth, innerWidth]")
    assert wide <= shown


def test_the_name_of_a_term_stays_on_one_line(browser: Any, laid_open: Any, tmp_path: Path) -> None:
    shot = laid_open("builtin:push_in")
    *others, last = shot.scores.terms
    term = replace(last, values=torch.full((3,), torch.nan), reason="why it has none of them, " * 20)
    browser.set_window_size(1400, 900)
    browser.get(write_inspection(tmp_path, replace(shot, scores=replace(shot.scores, terms=(*others, term)))).as_uri())
    lines = """return [...document.querySelectorAll("td:first-child")].map(cell => {
        const name = document.createRange()
        name.selectNodeContents(cell)
        return name.getClientRects().length
    })"""
    assert browser.execute_script(lines) == [1] * len(shot.scores.terms)


def test_a_click_in_a_picture_names_the_person(browser: Any, laid_open: Any, tmp_path: Path) -> None:
    browser.get(write_inspection(tmp_path / "page", laid_open("it's  a <b>.mp4#t=1,2&person=3")).as_uri())
    assert browser.find_element("id", "who").text == shlex.quote("it's  a <b>.mp4#t=1,2&person=X,Y,SECONDS")
    picture = browser.find_elements("css selector", "img[data-time]")[1]
    size = picture.size
    offset = (round(0.25 * size["width"] - size["width"] / 2), round(0.6 * size["height"] - size["height"] / 2))
    chain = pytest.importorskip("selenium.webdriver").ActionChains(browser)
    chain.move_to_element_with_offset(picture, *offset).click().perform()
    (word,) = shlex.split(browser.find_element("id", "who").text)
    source = ClipSource.parse(word)
    assert (source.path, source.span) == (Path("it's  a <b>.mp4"), (1.0, 2.0))
    assert source.person == pytest.approx((0.25, 0.6, 0.5), abs=0.02)
    assert not browser.get_log("browser")


def test_the_name_to_paste_is_one_word_for_the_shell(laid_open: Any, tmp_path: Path) -> None:
    page = write_inspection(tmp_path, laid_open("it's $(a).mp4#t=1,2")).read_text()
    shown = re.search(r'<code id="who"[^>]*>(.*?)</code>', page)
    assert shown is not None
    assert shlex.split(html.unescape(shown[1])) == ["it's $(a).mp4#t=1,2&person=X,Y,SECONDS"]


def test_a_page_of_something_else_is_not_written_over(command: Any, laid_open: Any, tmp_path: Path) -> None:
    (tmp_path / "index.html").write_text("mine")
    idle = command("inspect", "builtin:push_in", "engine=cma", "--out", tmp_path)
    assert (idle.code, "engine: changes nothing of an inspection" in idle.err) == (2, True)
    said = command("inspect", "builtin:push_in", "frames=1", "output_side=96", "--out", tmp_path)
    assert (said.code, "is neither empty nor a page of `inspect`" in said.err) == (2, True), said.err
    assert (tmp_path / "index.html").read_text() == "mine"
    write_inspection(tmp_path, laid_open("builtin:push_in"))  # one of its own may be made anew
    check_page(tmp_path, MARK, "a page of `inspect`")


@pytest.mark.parametrize(("source", "kind"), [("clip.mp4", "a clip"), ("features.safetensors", "a feature file")])
def test_a_size_is_refused_of_what_is_not_rendered(command: Any, tmp_path: Path, source: str, kind: str) -> None:
    said = command("inspect", source, "output_side=96", "--out", tmp_path / "page")
    assert (said.code, said.err.partition(",")[0]) == (
        2,
        f"error: output_side: changes nothing of an inspection of {kind}",
    )


def test_a_page_that_was_stopped_may_be_made_anew(
    laid_open: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(path: Path, picture: Any, **_: Any) -> None:
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as disk:
        disk.setattr("cltransfer.report.picture.write_picture", full)
        with pytest.raises(OSError, match="No space left"):
            write_inspection(tmp_path, laid_open("builtin:push_in"))
    (tmp_path / "frames").mkdir(exist_ok=True)
    (tmp_path / "frames" / "0000.png").touch()
    check_page(tmp_path, MARK, "a page of `inspect`")
    write_inspection(tmp_path, laid_open("builtin:push_in"))


def test_a_shot_of_a_scene_has_nobody_to_click_on(laid_open: Any, tmp_path: Path) -> None:
    page = write_inspection(tmp_path, laid_open("builtin:push_in")).read_text()
    assert "Click on the one" not in page
    assert "<script" not in page


def test_confidence_is_0_without_a_person_and_grows_with_joints_and_box() -> None:
    features = sample_features(0, 3)
    sure = reading_confidence(features)
    assert bool((sure > 0.5).all())
    assert reading_confidence(without_person(features)).tolist() == [0, 0, 0]
    box = features.box.clone()
    box[:, 4] = 0.4
    torch.testing.assert_close(reading_confidence(replace(features, box=box)), 0.4 * sure, check_dtype=False)


@pytest.mark.parametrize(
    ("overrides", "reason"),
    [(("losses.shot_size=null", "losses.framing=null"), "expected a loss that reads the person's joints"),
     (("extractors.scene_joints=null", "extractors.pose_blazepose=null"), "keypoints: no scene extractor")],
)  # fmt: skip
def test_without_joints_nothing_is_read_and_one_line_says_so(
    command: Any, tmp_path: Path, overrides: tuple[str, ...], reason: str
) -> None:
    said = command("inspect", "builtin:push_in", "frames=2", "output_side=96", *overrides, "--out", tmp_path / "page")
    assert (said.code, said.err.count("\n")) == (2, 1)
    assert reason in said.err


def test_a_feature_file_without_joints_is_named(command: Any, tmp_path: Path) -> None:
    features = replace(sample_features(0, 3), image=None, alpha=None, label=None, camera=None, person=None)
    FeatureFile(replace(features, keypoints=None), torch.arange(3).double(), "sample").save(tmp_path / "a.safetensors")
    said = command("inspect", tmp_path / "a.safetensors", "--out", tmp_path / "page")
    assert (said.code, said.err.count("\n")) == (3, 1)
    assert "a.safetensors: keypoints: expected joints of a person" in said.err


def test_a_feature_file_has_nothing_to_draw_on(command: Any, tmp_path: Path) -> None:
    features = replace(sample_features(0, 3), image=None, alpha=None, label=None, camera=None, person=None)
    FeatureFile(features, torch.arange(3).double(), "sample").save(tmp_path / "a.safetensors")
    said = command("inspect", tmp_path / "a.safetensors", "--out", tmp_path / "page")
    assert (said.code, said.err.count("\n")) == (3, 1)
    assert "inspect the clip itself" in said.err
