import base64
import re
from dataclasses import replace

import cv2
import numpy as np
import torch

from cltransfer.pipeline.scores import Scores, Term
from cltransfer.report.data import Flag, ReportData
from cltransfer.report.metrics import FIRST_VIEW
from cltransfer.report.page import page, write_report
from cltransfer.trajectory import Trajectory


def term(name: str, values: list[float], reason: str = "") -> Term:
    return Term(name, "frame", 2.0, torch.tensor(values, dtype=torch.float64), reason)


def test_the_page_is_complete_in_itself(report, tmp_path):
    text = write_report(tmp_path, report).read_text()
    bare = re.sub(r'src="data:image/jpeg;base64,[^"]*"', "", text)
    assert not re.search(r"<script|https?:|//[a-z]|@import|url\((?!#)|<link|<iframe| on[a-z]+=", bare)
    assert "default-src 'none'; img-src data:; style-src 'unsafe-inline'" in text
    assert text.count('src="data:image/jpeg;base64,') == text.count("src=") == 8
    assert "<dd>–</dd>" in text  # a cost that is not a number
    assert text.count("<svg") == text.count('role="img" aria-label="') == 3
    for said in (
        "dolly_zoom → courtyard",
        "3/4",
        "first view held still",
        "focal length is weakly seen",
        "patience",
    ):
        assert said in text


def test_the_page_repeats_byte_for_byte(report):
    assert page(report) == page(report)


def test_hostile_names_are_text(report):
    evil = "<script>alert(1)</script>\"'$\\frac{"
    hostile = replace(
        report,
        title=evil,
        command=evil,
        spent={evil: evil},
        flags=(Flag(0, evil),),
        scores=Scores((term(evil, [1.0, 2.0, 3.0, float("nan")], reason=evil),), torch.ones(4, dtype=torch.float64)),
        baseline=None,
    )
    text = page(hostile)
    assert "<script" not in text
    assert text.count("&lt;script&gt;") >= 6


def test_a_scored_pair_of_clips_needs_no_cameras(report):
    text = page(replace(report, trajectory=None, subject=None, baseline=None))
    assert text.count("<svg") == 1
    assert "first view held still" not in text


def test_the_page_says_what_its_columns_and_axes_are(report):
    wide = replace(
        report.scores, terms=(term("framing", [0.001, 1.0, 1.0, 1.0]), term("shot_size", [1.0, 1.0, 1.1, 1.2]))
    )
    text = page(replace(report, scores=wide, spent={"network_passes": 2.0}))
    assert FIRST_VIEW in text
    assert "first view" not in page(replace(report, baseline=None))
    assert (text.count("framing [frame], log scale"), text.count("shot_size [frame], log scale")) == (1, 0)
    assert "network passes" in text


def test_one_frame_makes_a_page(report):
    one = ReportData(
        "one",
        report.times[:1],
        Scores((term("framing", [0.5]),), torch.ones(1, dtype=torch.float64)),
        None,
        Trajectory(report.trajectory.camera[0], report.times[:1]),
        report.subject,
        report.reference_frames[:1],
        report.render_frames[:1],
    )
    assert page(one).count("<img") == 2
    assert len(re.findall(r"<use [^>]*y=", page(one))) > len(
        re.findall(r"<use [^>]*y=", page(replace(one, trajectory=None)))
    )


def test_long_words_stay_in_their_column_and_on_the_page(report, browser, tmp_path):
    word = 96 * "x"
    terms = (replace(report.scores.terms[0], reason=word, unit="of a long unit " * 9), *report.scores.terms[1:])
    flags = (Flag(None, word), Flag(1, word))
    long = replace(report, title=word, flags=flags, scores=replace(report.scores, terms=terms), command=word)
    file = write_report(tmp_path, long).as_uri()
    inside = "const box = document.querySelector('.table'); return box.scrollWidth <= box.clientWidth"
    over = "return [...document.querySelectorAll('li, dd, h1, pre')].filter(e => e.scrollWidth > e.clientWidth).length"
    for width in (1200, 500):
        browser.set_window_size(width, 800)
        browser.get(file)
        wide, shown = browser.execute_script("return [document.documentElement.scrollWidth, innerWidth]")
        assert wide <= shown
        assert browser.execute_script(over) == 0
        assert browser.execute_script(inside) == (width > 500)  # a narrow one has to be moved


def test_few_frames_are_no_larger_than_many_and_one_is_called_one(report, browser, tmp_path):
    one = replace(
        report,
        times=report.times[:1],
        trajectory=None,
        scores=Scores((term("framing", [0.5]),), torch.ones(1, dtype=torch.float64)),
        baseline=None,
        reference_frames=report.reference_frames[:1],
        render_frames=report.render_frames[:1],
    )
    browser.get(write_report(tmp_path, one).as_uri())
    assert max(picture.size["width"] for picture in browser.find_elements("css selector", ".strip img")) <= 280
    assert browser.find_element("css selector", ".under").text == "1 frame · camera language score"
    assert "4 frames over 0.38 s · camera language transfer" in page(report)


def test_what_is_as_good_as_the_first_view_is_neither_better_nor_worse(report):
    for share, word in ((1.0, ""), (2.0, "better"), (0.5, "worse")):
        held = replace(report.scores, terms=report.scores.terms[:1], totals=torch.ones(4, dtype=torch.float64))
        text = page(replace(report, scores=held, baseline=replace(held, totals=share * held.totals)))
        row = text.partition('<tr class="total')[2].partition("</tr>")[0]
        assert [found for found in ("better", "worse") if f'class="{found}"' in row] == [word] * bool(word)


def test_a_flag_of_every_frame_is_one_line(report):
    text = page(replace(report, flags=tuple(Flag(i, "degenerate") for i in range(4))))
    assert text.count("degenerate") == 1
    assert "<li>all 4 frames: degenerate</li>" in text


def test_a_page_of_scores_speaks_of_no_transfer(report):
    scored = page(replace(report, trajectory=None))
    assert "reference above render" in scored
    assert ">transfer</text>" not in scored
    assert "frames flagged" not in scored  # what `evaluate` notes is of no frame
    assert "camera language score" in scored
    whole = page(report)
    assert all(there in whole for there in ("reference above transfer", ">transfer</text>", "frames flagged"))


def test_the_frames_of_a_page_keep_their_colours(report):
    red = torch.zeros_like(report.render_frames)
    red[:, 0] = 200
    shown = re.search(r"image/jpeg;base64,([^\"]*)", page(replace(report, reference_frames=None, render_frames=red)))
    picture = cv2.imdecode(np.frombuffer(base64.b64decode(shown[1]), np.uint8), cv2.IMREAD_COLOR_RGB)
    np.testing.assert_allclose(picture.reshape(-1, 3).mean(0), [200, 0, 0], atol=6)
