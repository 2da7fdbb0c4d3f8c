"""A participant in a real browser: opens the page from disk, answers, reloads, downloads; all is analysed."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from cltransfer.study.design import Study

pytest.importorskip("selenium", reason="needs selenium, of the extra cltransfer[dev]")
from selenium.webdriver.common.action_chains import ActionChains
from selenium.webdriver.common.by import By
from selenium.webdriver.common.keys import Keys


def until(true: Callable[[], Any], seconds: float = 20) -> Any:
    deadline = time.monotonic() + seconds
    while not (found := true()):
        assert time.monotonic() < deadline, "the page did not come that far"
        time.sleep(0.02)
    return found


def text(browser: Any, name: str) -> str:
    return browser.find_element(By.ID, name).text


def join(browser: Any, folder: Path, participant: str, first: str = "") -> None:
    """Open the page, run the script ``first`` there, and give a name."""
    browser.get((folder / "index.html").as_uri())
    browser.execute_script(first)
    browser.find_element(By.ID, "participant").send_keys(participant + Keys.ENTER)
    until(lambda: text(browser, "where"))


def reload_with(browser: Any, shelf: str, record: str) -> None:
    """Load the page anew where this browser has kept the ``record``: what is put there before may come too late."""
    source = f"localStorage.setItem({json.dumps(shelf)}, {json.dumps(record)})"
    added = browser.execute_cdp_cmd("Page.addScriptToEvaluateOnNewDocument", {"source": source})
    browser.refresh()
    browser.execute_cdp_cmd("Page.removeScriptToEvaluateOnNewDocument", added)


def pair(browser: Any) -> list[str]:
    """Tokens on the left and on the right."""
    return [Path(v.get_attribute("src")).stem for v in browser.find_elements(By.CSS_SELECTOR, ".pair video")]


def press(browser: Any, key: str) -> None:
    """Press a key once the page takes answers, and wait until it has gone on."""
    until(lambda: browser.find_element(By.ID, "choose-left").is_enabled())
    before = (text(browser, "where"), text(browser, "count"))
    browser.find_element(By.TAG_NAME, "body").send_keys(key)
    until(lambda: (text(browser, "where"), text(browser, "count")) != before)


def prefer(browser: Any, study: Study, method: str) -> None:
    side = [study.clips[token].method for token in pair(browser)].index(method)
    press(browser, (Keys.ARROW_LEFT, Keys.ARROW_RIGHT)[side])


def test_a_participant_answers_reloads_downloads_and_is_analysed(
    browser: Any, page: tuple[Path, Path], tmp_path: Path, command: Callable[..., Any]
) -> None:
    folder, key = page
    study = Study.load(key)
    join(browser, folder, "P-07")
    ready = "return [...document.querySelectorAll('video')].every(v => v.readyState > 2 && v.videoWidth === 64)"
    until(lambda: browser.execute_script(ready))
    for _ in range(2):
        prefer(browser, study, "quetzal")
    press(browser, Keys.BACKSPACE)
    assert text(browser, "count") == "Question 2 of 3"
    seen = pair(browser)
    browser.refresh()
    until(lambda: text(browser, "where"))
    assert (text(browser, "where"), text(browser, "count")) == ("Comparison 1 of 2", "Question 2 of 3")
    assert pair(browser) == seen
    prefer(browser, study, "ibex")
    for _ in range(3):
        prefer(browser, study, "quetzal")
    side = [study.clips[token].method for token in pair(browser)].index("quetzal")
    browser.find_element(By.ID, ("choose-left", "choose-right")[side]).click()  # by mouse, the last one
    until(lambda: text(browser, "summary") == "All 6 questions are answered (P-07).")
    browser.refresh()
    until(lambda: text(browser, "summary"))
    browser.find_element(By.ID, "download").click()
    saved = tmp_path / "downloads" / f"answers-{study.name}-P-07.csv"
    until(saved.is_file)
    answer = command("study", "--analyse", saved, "--key", key, "--json")
    assert answer.code == 0, answer.err
    said = json.loads(answer.out)
    assert said["participants"] == {"P-07": 6}
    wins = {p["question"]: (p["wins"], p["count"]) for p in said["preferences"]}
    assert wins == {"visual_style": (2, 2), "smoothness": (1, 2), "naturalness": (2, 2)}
    fetched = browser.execute_script("return performance.getEntriesByType('resource').map(e => e.name)")
    assert all(name.startswith("file:") for name in fetched)
    assert [line for line in browser.get_log("browser") if line["level"] == "SEVERE"] == []


def test_a_button_that_has_the_focus_is_pressed_by_the_space_bar(browser: Any, page: tuple[Path, Path]) -> None:
    """Elsewhere that key shows the videos again."""
    join(browser, page[0], "P-08")
    until(lambda: browser.find_element(By.ID, "choose-right").is_enabled())
    browser.execute_script("document.getElementById('choose-right').focus()")
    before = text(browser, "count")
    browser.switch_to.active_element.send_keys(Keys.SPACE)
    until(lambda: text(browser, "count") != before)
    assert text(browser, "count") == "Question 2 of 3"


def test_after_a_click_the_space_bar_shows_the_videos_again_and_answers_nothing(
    browser: Any, page: tuple[Path, Path]
) -> None:
    join(browser, page[0], "P-09")
    kept = f"return JSON.parse(localStorage.getItem('cltransfer-study-{Study.load(page[1]).name}')).answers.length"
    for _ in range(2):
        press(browser, Keys.ARROW_LEFT)
    for name, count in (("back", 1), ("choose-left", 2)):
        browser.find_element(By.ID, name).click()
        until(lambda told=f"Question {count + 1} of 3": text(browser, "count") == told)
        ActionChains(browser).send_keys(Keys.SPACE).perform()
        assert browser.execute_script(kept) == count


def test_who_stops_early_downloads_what_there_is_and_makes_room_for_another(
    browser: Any, page: tuple[Path, Path], tmp_path: Path, command: Callable[..., Any]
) -> None:
    folder, key = page
    join(browser, folder, "a")
    press(browser, Keys.ARROW_LEFT)
    browser.refresh()
    until(lambda: text(browser, "where"))
    browser.find_element(By.ID, "another").click()
    browser.switch_to.alert.dismiss()  # not downloaded yet
    assert text(browser, "who") == "a"
    browser.find_element(By.ID, "stop").click()
    saved = tmp_path / "downloads" / f"answers-{Study.load(key).name}-a.csv"
    until(saved.is_file)
    assert saved.name in text(browser, "partly")
    press(browser, Keys.ARROW_LEFT)
    assert text(browser, "partly") == ""  # of the second answer that is not true
    press(browser, Keys.BACKSPACE)
    assert json.loads(command("study", "--analyse", saved, "--key", key, "--json").out)["participants"] == {"a": 1}
    browser.find_element(By.ID, "another").click()
    browser.switch_to.alert.accept()
    until(lambda: browser.find_element(By.ID, "participant").is_displayed())
    shown = {}
    for other in ("b", "c", "d", "e"):  # each sees the pair of the own plan, though it is the first one again
        browser.find_element(By.ID, "participant").send_keys(other + Keys.ENTER)
        until(lambda: text(browser, "where"))
        assert (text(browser, "who"), text(browser, "count")) == (other, "Question 1 of 3")
        shown[other] = pair(browser)
        browser.find_element(By.ID, "another").click()  # nothing to throw away, nothing asked
    assert len({tuple(tokens) for tokens in shown.values()}) > 1


DAMAGE = (
    "answers[0] = null",
    "answers[0] = 1",
    "answers[0].item = 'item9'",
    "answers[0].question = answers[1].question",
    "answers[0].chosen = 'ffffff'",
    "[answers[0].left, answers[0].right] = [answers[0].right, answers[0].left]",
    "answers[1].seconds = '1,2'",
    "answers[1].seconds = null",
    "kept.answers = Array(6).fill(null)",
)


def test_a_record_that_is_damaged_is_not_taken_up(browser: Any, page: tuple[Path, Path]) -> None:
    join(browser, page[0], "a")
    for _ in range(2):
        press(browser, Keys.ARROW_LEFT)
    shelf = f"cltransfer-study-{Study.load(page[1]).name}"
    whole = browser.execute_script("return localStorage.getItem(arguments[0])", shelf)
    for damage in DAMAGE:
        change = f"const kept = JSON.parse(arguments[0]), answers = kept.answers; {damage}; "
        reload_with(browser, shelf, browser.execute_script(change + "return JSON.stringify(kept)", whole))
        until(lambda: browser.find_element(By.ID, "participant").is_displayed())
    reload_with(browser, shelf, whole)
    until(lambda: text(browser, "count") == "Question 3 of 3")


def test_sides_and_order_differ_between_participants_and_stay_for_one(browser: Any, page: tuple[Path, Path]) -> None:
    browser.get((page[0] / "index.html").as_uri())
    seen = {}
    for participant in ("a", "b", "c", "d", "e", "f", "a"):
        browser.execute_script("localStorage.clear()")
        join(browser, page[0], participant)
        shown = tuple(pair(browser))
        assert seen.setdefault(participant, shown) == shown
    assert len(set(seen.values())) > 1


def test_nobody_can_answer_before_all_three_were_shown_to_the_end(browser: Any, page: tuple[Path, Path]) -> None:
    held = "const video = HTMLMediaElement.prototype; window.play = video.play; video.play = async () => {}"
    join(browser, page[0], "a", held)
    assert "shown to the end" in text(browser, "wait")
    assert not browser.find_element(By.ID, "choose-left").is_enabled()
    browser.find_element(By.TAG_NAME, "body").send_keys(Keys.ARROW_LEFT)
    assert text(browser, "count") == "Question 1 of 3"
    browser.execute_script("HTMLMediaElement.prototype.play = window.play")
    browser.find_element(By.TAG_NAME, "body").send_keys(" ")
    press(browser, Keys.ARROW_LEFT)
    assert text(browser, "count") == "Question 2 of 3"
    assert browser.find_element(By.ID, "choose-left").is_enabled()  # the same three videos


def test_a_video_that_does_not_play_is_told(browser: Any, page: tuple[Path, Path]) -> None:
    for video in (page[0] / "videos").iterdir():
        video.write_bytes(b"nothing")
    join(browser, page[0], "a")
    until(lambda: "does not play" in text(browser, "trouble"))
    assert not browser.find_element(By.ID, "choose-left").is_enabled()


def test_where_the_browser_blocks_storage_answers_live_in_memory_and_that_is_told(
    browser: Any, page: tuple[Path, Path], tmp_path: Path
) -> None:
    refuse = "throw new DOMException('denied', 'SecurityError')"
    blocked = f"Object.defineProperty(window, 'localStorage', {{ get() {{ {refuse}; }} }})"
    browser.execute_cdp_cmd("Page.addScriptToEvaluateOnNewDocument", {"source": blocked})
    join(browser, page[0], "a")
    assert "does not let the page keep your answers" in text(browser, "unkept")
    study = Study.load(page[1])
    for _ in range(5):
        prefer(browser, study, "quetzal")
    browser.find_element(By.TAG_NAME, "body").send_keys(Keys.ARROW_LEFT)
    until(lambda: "are answered" in text(browser, "summary"))
    browser.find_element(By.ID, "download").click()
    saved = tmp_path / "downloads" / f"answers-{study.name}-a.csv"
    until(saved.is_file)
    assert len(saved.read_text().splitlines()) == 7
    browser.find_element(By.ID, "next").click()
    until(lambda: browser.find_element(By.ID, "participant").is_displayed())


def test_nothing_is_told_where_storage_works(browser: Any, page: tuple[Path, Path]) -> None:
    join(browser, page[0], "a")
    assert not browser.find_element(By.ID, "unkept").is_displayed()
