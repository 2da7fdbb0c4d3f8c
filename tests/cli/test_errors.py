"""Bad input at the command line: an exit code, exactly one line that names file and field, nothing half-written."""

from __future__ import annotations

import json
import logging
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cltransfer import __version__
from cltransfer.bench.synthetic_room import synthetic_room
from cltransfer.cli.shared import show, tell
from cltransfer.errors import ModelError
from cltransfer.scenes.ply import write_splats

SPLAT: tuple[str, ...] = ("x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2", "opacity", "scale_0", "scale_1", "scale_2")
SPLAT += ("rot_0", "rot_1", "rot_2", "rot_3")
SHORT = ("frames=1", "generations=1", "output_side=64", "search_side=32", "--quiet")
SECONDS = 6.0  # of a processor, both threads of it busy, for what loads torch and has nothing to render
DATA = Path(__file__).resolve().parents[2].parent / "shared" / "data"


def refused(answer: Any, code: int, *words: str) -> None:
    """One ``error:`` line with all of ``words`` and nothing else."""
    assert answer.code == code, answer.err
    assert answer.err.count("\n") == 1, answer.err
    assert answer.err.startswith("error: ")
    for word in words:
        assert word in answer.err, answer.err
    assert answer.out == ""


def write_rows(path: Path, names: tuple[str, ...], rows: np.ndarray) -> None:
    head = ["ply", "format binary_little_endian 1.0", f"element vertex {len(rows)}"]
    head += [f"property float {name}" for name in names]
    path.write_bytes("\n".join([*head, "end_header", ""]).encode() + rows.astype("<f4").tobytes())


def no_opacity(path: Path) -> None:
    names = tuple(name for name in SPLAT if name != "opacity")
    write_rows(path, names, np.ones((4, len(names))))


def two_percent_nan(path: Path) -> None:
    rows = np.ones((100, len(SPLAT)))
    rows[:2, 1] = np.nan
    write_rows(path, SPLAT, rows)


def cut_short(path: Path) -> None:
    write_splats(path, synthetic_room(200, 0))
    path.write_bytes(path.read_bytes()[:-100])


SCENES: dict[str, tuple[Callable[[Path], object], str]] = {
    "missing": (lambda path: None, "no such file"),
    "empty": (lambda path: path.write_bytes(b""), "header"),
    "truncated": (cut_short, "cut off"),
    "foreign": (lambda path: path.write_bytes(b"\x89PNG\r\n\x1a\n" + bytes(100)), "magic"),
    "a folder": (lambda path: path.mkdir(), "scene.ply"),
    "without opacity": (no_opacity, "opacity"),
    "two percent not finite": (two_percent_nan, "not finite"),
}


@pytest.mark.parametrize("kind", SCENES)
@pytest.mark.parametrize("verb", ["transfer", "lift"])
def test_a_scene_that_cannot_be_used_is_named(
    command: Callable[..., Any], tmp_path: Path, kind: str, verb: str
) -> None:
    make, word = SCENES[kind]
    scene, out = tmp_path / "scene.ply", tmp_path / "out"
    make(scene)
    refused(command(verb, scene, "--out", out), 3, "scene.ply", word)
    assert not out.exists()


CLIPS: dict[str, tuple[Callable[[Path], object], str]] = {
    "missing": (lambda path: None, "no such file"),
    "empty": (lambda path: path.write_bytes(b""), "is empty"),
    "random bytes": (lambda path: path.write_bytes(np.random.default_rng(0).bytes(5000)), "video"),
    "a playlist": (lambda path: path.write_text("#EXTM3U\n#EXTINF:1,\n/etc/passwd\n"), "video"),
    "a folder without images": (lambda path: path.mkdir(), "images"),
}


@pytest.mark.parametrize("kind", CLIPS)
def test_a_clip_that_cannot_be_used_is_named(command: Callable[..., Any], tmp_path: Path, kind: str) -> None:
    make, word = CLIPS[kind]
    clip = tmp_path / "clip.mp4"
    make(clip)
    refused(command("transfer", "builtin:courtyard", clip, "--out", tmp_path / "out"), 3, "clip.mp4", word)
    refused(command("evaluate", clip, clip), 3, "clip.mp4", word)
    assert not (tmp_path / "out").exists()


def test_a_truncated_clip_is_no_shorter_clip(command: Callable[..., Any], tiny_run: Path, tmp_path: Path) -> None:
    whole = (tiny_run / "video" / "render.mp4").read_bytes()
    (tmp_path / "cut.mp4").write_bytes(whole[: len(whole) // 2])
    refused(command("evaluate", tmp_path / "cut.mp4", tmp_path / "cut.mp4"), 3, "cut.mp4", "video")


def test_a_missing_network_is_told_before_anything_is_rendered(
    command: Callable[..., Any], tiny_run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("CLTRANSFER_MODELS", raising=False)
    clip, words = tiny_run / "video" / "render.mp4", ("yolox_nano.onnx", "sha256", "put yolox_nano.onnx in", "models")
    refused(command("transfer", "builtin:courtyard", clip, "--out", tmp_path / "out"), 4, *words)
    refused(command("evaluate", clip, clip), 4, *words)
    refused(command("lift", "builtin:courtyard", "--quiet", "--out", tmp_path / "out"), 4, *words)
    assert not (tmp_path / "out").exists()


def test_a_clip_without_a_person_is_refused(
    command: Callable[..., Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if not (DATA / "models" / "yolox_nano.onnx").is_file():
        pytest.skip("needs the networks of shared/data")
    monkeypatch.setenv("CLTRANSFER_MODELS", str(DATA / "models"))
    import cv2

    (tmp_path / "grey").mkdir()
    for i in range(3):
        assert cv2.imwrite(str(tmp_path / "grey" / f"{i}.png"), np.full((90, 160, 3), 90 + i, np.uint8))
    grey = tmp_path / "grey"
    refused(command("transfer", "builtin:courtyard", grey, "--quiet", "--out", tmp_path / "out"), 3, "grey", "person")
    refused(command("evaluate", grey, grey, "--quiet"), 3, "grey", "person")
    assert not (tmp_path / "out").exists()


USAGE = {
    "genrations=2": "did you mean 'generations'",
    "losses.framng=null": "did you mean 'framing'",
    "losses.framing.wieght=2": "did you mean 'weight'",
    "losses.framing.weight=heavy": "framing.weight",
    "losses.framing.weight=.nan": "framing.weight: expected a finite number",
    "generations=two": "generations",
    "generations=0": "generations: expected 1",
    "tolerance=.nan": "tolerance",
    "seed=-1": "seed",
    "preset=balancd": "did you mean 'balanced'",
    "zoom=wild": "zoom",
    "losses=null": "losses",
    "extract.inner=${oc.env:HOME}": "interpolation",
    'extract.inner="\\x24{oc.env:HOME}"': "interpolation",
    'losses={"\\x24{oc.env:HOME}": {}}': "interpolation",
    "--frames": "No such option: --frames (keys are set without dashes: frames=VALUE)",
    "--frames=24": "No such option: --frames (keys are set without dashes: frames=24)",
    "--output-side=64": "(keys are set without dashes: output_side=64)",
    "--losses.framing.weight=2": "(keys are set without dashes: losses.framing.weight=2)",
    "--frams=24": "No such option: --frams\n",
    "search-side=96": "search-side: no such key (did you mean 'search_side'?)",
    "search side=96": "search side: no such key (did you mean 'search_side'?)",
    "frames =12": "frames : no such key (did you mean 'frames'?)",
    "allow-plugin=a.py": "allow-plugin: no such key (--allow-plugin a.py is an option)",
    "out=run2": "command line: out: no such key (--out run2 is an option)",
    "allow_plugin=a.py": "allow_plugin: no such key (--allow-plugin a.py is an option)",
    "video=a.mp4": "video: no such key (known: adam,",
    "clip.mp4": "clip.mp4: is a video, expected a scene (the scene comes first: cltransfer transfer SCENE CLIP)",
    "--up=1,2": "--up",
    "--allow-plugn": "--allow-plugn",
}


@pytest.mark.parametrize("argument", USAGE)
def test_a_command_that_cannot_be_meant_is_usage(
    command: Callable[..., Any], argument: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HOME", "/not/to/be/told")
    answer = command("transfer", argument, "--out", tmp_path / "out")
    refused(answer, 2, USAGE[argument])
    assert "/not/to/be/told" not in answer.err
    assert not (tmp_path / "out").exists()


TWICE = {
    ("transfer", "--out", "a", "-o", "b"): "--out: expected once, it is there twice (leave one out)",
    ("lift", "a.ply", "--up", "0,1,0", "--up=0,0,1"): "--up: expected once",
    ("bench", "speed", "--quick", "--no-quick"): "--quick: expected once",
    ("transfer", "a.ply", "frames=3", "b.mp4", "frames=4"): "frames: expected once, got frames=3 before frames=4",
    ("models", "align", "a.ply", "frames=3", "frames=4"): "frames: expected once, got frames=3 before frames=4",
    ("transfer", "frames=3", "frames=4"): "frames: expected once, got frames=3 before frames=4 (leave one out)",
    ("evaluate", "a", "b", "frames=3", "seed=1", "frames=3"): "frames: expected once, got frames=3 before frames=3",
    ("fit", "a", "--out", "b", "side=64", "side=96"): "side: expected once",
    ("transfer", "adam.rate=0.1", "adam={rate: 1}"): "adam.rate: expected once, got adam.rate=0.1 before adam={rate:",
    ("transfer", "losses.framing={}", "losses=null"): "losses.framing: expected once, got losses.framing={} before",
}


@pytest.mark.parametrize("arguments", TWICE, ids=" ".join)
def test_what_a_later_word_would_replace_is_refused(
    command: Callable[..., Any], arguments: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    refused(command(*arguments), 2, TWICE[arguments])
    assert not list(tmp_path.iterdir())


def test_what_is_said_twice_and_replaces_nothing_is_taken(command: Callable[..., Any], tmp_path: Path) -> None:
    for said in (
        ("adam.rate=0.1", "adam={iterations: 3}", "-q", "-q", "--json", "--json"),
        ("renderer.mesh={}", "renderer.mesh.samples=2", "losses.framing=null", "losses.shot_size.weight=3"),
    ):
        assert command("transfer", "--print-config", *said).code == 0, said
    missing = tmp_path / "missing.ply"
    refused(command("simplify", missing, "--out", "b.ply", "--view", "a:0", "--view", "a:1", "-q"), 3, "missing.ply")
    assert command("transfer", "--out", "a", "--out", "b", "--help").code == 0


def test_a_name_with_an_equals_sign_is_a_path_where_there_is_such_a_file_or_it_can_be_no_key(
    command: Callable[..., Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "room-side=96.ply").write_text("no scene")
    refused(command("transfer", "room-side=96.ply"), 3, "room-side=96.ply: magic")
    refused(command("transfer", "scenes/room-side=96.ply"), 3, "scenes/room-side=96.ply: no such file")
    refused(command("transfer", "#=1.ply"), 2, "#=1.ply: is no moment (expected FILE#t=SECONDS")
    refused(command("transfer", "builtin:room=3"), 2, "scene 'room=3': no such built-in scene")


def test_a_clip_before_the_scene_is_told(command: Callable[..., Any], tmp_path: Path) -> None:
    hint = "expected a scene (the scene comes first: cltransfer transfer SCENE CLIP)"
    refused(command("transfer", "clip.mp4#t=1,2", "scene.ply"), 2, f"clip.mp4#t=1,2: is a video, {hint}")
    refused(command("transfer", tmp_path, "man.glb#t=0.6"), 2, f"{tmp_path}: is a folder, {hint}")


def test_a_value_that_the_shell_has_cut_at_its_spaces_is_told(command: Callable[..., Any]) -> None:
    quotes = "(what has spaces stands in quotes: 'key={a: b}')"
    several = ["a.ply", "b.mp4", "extractors.depth_onnx={model:", "a.onnx,", "kind:", "depth}"]
    refused(command("transfer", *several), 2, f"a.onnx,: expected at most 2 paths, got 5 {quotes}")
    refused(command("transfer", "search={paper_box:", "{}}"), 2, f"search: not a YAML value: {{paper_box: {quotes}")
    refused(command("transfer", "a.ply", "b.mp4", "c.mp4"), 2, "c.mp4: expected at most 2 paths, got 3\n")


@pytest.mark.parametrize(
    ("words", "line"),
    [
        (("a.ply", "b.mp4", "frames", "=", "4"), "frames: expected key=value, got frames = (no spaces go around the ="),
        (("frames", "=4"), "frames: expected key=value, got frames =4 (no spaces go around the =: frames=VALUE)"),
        (("a.ply", "b.mp4", "frames=", "4"), "4: expected at most 2 paths, got 3 (no spaces go around the =)"),
    ],
)
def test_spaces_around_the_sign_of_a_key_are_told(
    command: Callable[..., Any], words: tuple[str, ...], line: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    refused(command("transfer", *words), 2, f"error: {line}")


def test_the_value_of_an_option_that_is_a_key_is_found(command: Callable[..., Any]) -> None:
    refused(command("transfer", "a.ply", "b.mp4", "--frames", "24"), 2, "without dashes: frames=24)")
    refused(command("evaluate", "a.mp4", "b.mp4", "--frames", "24"), 2, "without dashes: frames=24)")
    assert "dashes" not in command("models", "list", "--frames", "24").err


def test_a_command_that_lacks_an_argument_says_how_it_is_written(command: Callable[..., Any]) -> None:
    refused(command("evaluate", "a.mp4"), 2, "'render' (expected: cltransfer evaluate REFERENCE RENDER; ")
    refused(command("models", "align"), 2, "(expected: cltransfer models align SCENE KEY=VALUE...; ")


def test_how_a_command_is_written_is_the_same_where_python_runs_it(fresh: Callable[..., Any]) -> None:
    refused(fresh("models", "align"), 2, "(expected: cltransfer models align SCENE KEY=VALUE...; ")


@pytest.mark.parametrize("words", [(), ("bench",), ("models",)])
def test_commands_of_commands_by_themselves_show_their_help_and_nothing_else(
    command: Callable[..., Any], words: tuple[str, ...]
) -> None:
    answer = command(*words)
    assert (answer.code, answer.err) == (2, "")
    assert "--help" in answer.out


CONFIGS = {
    "generations: 0\n": "generations: expected 1",
    "genrations: 3\n": "did you mean",
    "losses: {framing: {_target_: os.system}}\n": "no such option",
    "losses: 3\n": "losses",
    "generations: 3\n\tpatience: 1\n": "bad.yaml: line 2: a tab, expected spaces",
    "generations: 3\ngenerations: 4\n": "found duplicate key generations at line 2, column 1\n",
    "seed: !!python/object/apply:os.system [touch pwned]\n": "not a config",
    "preset: ${oc.env:HOME}\n": "interpolation",
    'preset: "\\x24{oc.env:HOME}"\n': "interpolation",
    '"\\x24{oc.env:HOME}": 3\n': "interpolation",
    'losses: {framing: {mode: [["\\u0024{oc.env:HOME}"]]}}\n': "interpolation",
    'preset: !!python/object/apply:pathlib.PosixPath ["\\x24{oc.env:HOME}"]\n': "interpolation",
    "base: ../../../../etc/passwd\n": "base",
    "base: missing.yaml\n": "missing.yaml",
    "- 1\n": "mapping",
    "a: &a [1, 1]\n" + "".join(f"{b}: &{b} [{', '.join([f'*{a}'] * 10)}]\n" for a, b in zip("abcdef", "bcdefg")): "",
    "preset: &a fast\n": "expected no anchors and aliases",
    "losses: [" + "a, " * 99 + "&b '" + "x" * 9999 + "', &c [" + "*b, " * 90 + "]," + "*c, " * 90 + "]\n": "anchors",
    "[" * 100_000: "expected at most 64 levels",
    "#" * (2**20 + 1): "at most",
    "\x00\x01": "not a config",
}


@pytest.mark.parametrize("text", CONFIGS, ids=range(len(CONFIGS)))
def test_a_config_file_that_cannot_be_meant_is_named(
    command: Callable[..., Any], tmp_path: Path, text: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "bad.yaml").write_text(text)
    answer = command("transfer", "--config", tmp_path / "bad.yaml")
    refused(answer, 2, CONFIGS[text])
    assert "missing.yaml" in answer.err or "bad.yaml" in answer.err
    assert not (tmp_path / "pwned").exists()


def test_what_a_terminal_would_act_on_is_shown_escaped(
    command: Callable[..., Any], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "bad.yaml").write_text('"\\e]0;title\\a\\e[31mred": 3\n')
    refused(command("transfer", "--config", tmp_path / "bad.yaml"), 2, "\\x1b]0;title\\x07\\x1b[31mred: no such key")
    show({}, "a\tb\nc\x9b31m é", as_json=False)
    tell(["\x1b[31m", "\u202ered"], as_json=False)
    assert capsys.readouterr().out == "a\\tb\nc\\x9b31m é\nnote: \\x1b[31m\nnote: \\u202ered\n"


LONG = "x" * 100_000
ENDLESS = {
    f"losses: [{LONG}]\n": "losses: expected name",
    f"losses: {{framing: {{? {LONG} : 3}}}}\n": "no such option",
    f"losses: {{framing: {{weight: {LONG}}}}}\n": "framing.weight",
    f"generations: {LONG}\n": "generations: expected a whole number",
    f"preset: {LONG}\n": "no preset",
    f"? {LONG}\n: 3\n": "no such key",
}


@pytest.mark.parametrize("text", ENDLESS, ids=range(len(ENDLESS)))
def test_a_line_is_short_whatever_a_config_holds(command: Callable[..., Any], tmp_path: Path, text: str) -> None:
    (tmp_path / "bad.yaml").write_text(text)
    answer = command("transfer", "--config", tmp_path / "bad.yaml", "--out", tmp_path / "out")
    refused(answer, 2, ENDLESS[text])
    assert len(answer.err) < 5000


def test_a_line_is_short_whatever_a_file_is_called(command: Callable[..., Any], tmp_path: Path) -> None:
    (tmp_path / "bad.yaml").write_text(f"base: {LONG}\n")
    answer = command("transfer", "--config", tmp_path / "bad.yaml", "--out", tmp_path / "out")
    refused(answer, 5, "File name too long")
    assert len(answer.err) < 5000


@pytest.mark.parametrize("field", ["people", "joints", "format"])
def test_a_line_is_short_whatever_a_value_file_holds(
    command: Callable[..., Any], tiny_run: Path, tmp_path: Path, field: str
) -> None:
    good = json.loads((tiny_run / "subject.json").read_text())
    (tmp_path / "subject.json").write_text(json.dumps({**good, field: [LONG]}))
    answer = command("transfer", "--subject", tmp_path / "subject.json", "--out", tmp_path / "out", *SHORT)
    refused(answer, 3, "subject.json")
    assert len(answer.err) < 5000


def test_a_missing_config_is_usage(command: Callable[..., Any], tmp_path: Path) -> None:
    refused(command("transfer", "--config", tmp_path / "nope.yaml"), 2, "nope.yaml", "no such file")


def test_names_of_built_ins_that_are_not_there_are_answered_with_those_that_are(command: Callable[..., Any]) -> None:
    refused(command("transfer", "builtin:nowhere"), 2, "nowhere", "courtyard")
    refused(command("transfer", "builtin:courtyard", "builtin:nowhere"), 2, "nowhere", "push_in")
    refused(command("plugins", "show", "framng"), 2, "framng", "did you mean 'framing'")
    refused(command("plugins", "show", "losses.framng"), 2, "framng", "did you mean 'losses.framing'")
    refused(command("transfr"), 2, "transfr")


def test_a_built_in_whose_prefix_was_left_out_is_offered_with_it(
    command: Callable[..., Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    refused(command("transfer", "courtyard", "builtin:pan"), 3, "courtyard", "(did you mean builtin:courtyard?)")
    refused(command("transfer", "room-3", "builtin:pan"), 3, "room-3", "(did you mean builtin:room-3?)")
    refused(command("transfer", "builtin:courtyard", "pan"), 3, "pan: no such file (did you mean builtin:pan?)")
    refused(command("evaluate", "builtin:pan", "x.mp4"), 3, "builtin:pan: is made by code, no clip (expected clips")


@pytest.mark.parametrize("verb", ["transfer", "lift", "evaluate"])
def test_out_that_is_a_file_is_refused_and_kept(command: Callable[..., Any], tmp_path: Path, verb: str) -> None:
    (tmp_path / "mine").write_text("mine")
    arguments = {"transfer": [], "lift": ["builtin:courtyard"], "evaluate": ["a.mp4", "b.mp4"]}[verb]
    refused(command(verb, *arguments, "--out", tmp_path / "mine"), 2, "mine", "--out")
    assert (tmp_path / "mine").read_text() == "mine"


def test_out_that_holds_something_else_is_refused_and_kept(command: Callable[..., Any], tmp_path: Path) -> None:
    (tmp_path / "mine").write_text("mine")
    refused(command("transfer", "--out", tmp_path), 2, str(tmp_path), "--out", "name another folder")
    assert [p.name for p in tmp_path.iterdir()] == ["mine"]


VALUES = ("", "[1]", '"x"', "{}", "{", "\x00", "[" * 100_000)


@pytest.mark.parametrize("text", VALUES, ids=range(len(VALUES)))
@pytest.mark.parametrize("option", ["--subject", "--init"])
def test_a_damaged_value_file_is_named(command: Callable[..., Any], tmp_path: Path, option: str, text: str) -> None:
    (tmp_path / "value.json").write_text(text)
    answer = command("transfer", option, tmp_path / "value.json", "--out", tmp_path / "out", *SHORT)
    refused(answer, 3, "value.json")
    assert not (tmp_path / "out").exists()


FIELDS: dict[tuple[str, str], list[Any]] = {
    ("subject.json", "joints"): [{}, [], 3, {"head_top": [1]}],
    ("subject.json", "height"): [-1, None, "tall", [1]],
    ("subject.json", "facing"): [[0, 0, 0], [1, 0], "x", None],
    ("trajectory.json", "frames"): [[], 3, [{}], [{"time": 0, "w2c": [[1]], "K": 3}]],
    ("trajectory.json", "size"): [[0, 9], [96], "x", [-1, 2], None],
}


@pytest.mark.parametrize(
    ("file", "field", "value"), [(*key, value) for key, values in FIELDS.items() for value in values]
)
def test_a_field_of_the_wrong_kind_is_named(
    command: Callable[..., Any], tiny_run: Path, tmp_path: Path, file: str, field: str, value: object
) -> None:
    good = json.loads((tiny_run / file).read_text())
    (tmp_path / file).write_text(json.dumps({**good, field: value}))
    option = "--subject" if file == "subject.json" else "--init"
    refused(command("transfer", option, tmp_path / file, "--out", tmp_path / "out", *SHORT), 3, file)


@pytest.mark.parametrize("text", ["", "[1]", "\x00", None], ids=["empty", "list", "binary", "missing"])
@pytest.mark.parametrize("file", ["manifest.json", "trajectory.json", "config.yaml"])
def test_a_damaged_run_is_not_rendered(
    command: Callable[..., Any], tiny_run: Path, tmp_path: Path, file: str, text: str | None
) -> None:
    run = shutil.copytree(tiny_run, tmp_path / "run")
    before = (run / "video" / "render.mp4").read_bytes()
    if text is None:
        (run / file).unlink()
    else:
        (run / file).write_text(text)
    answer = command("render", run, "--quiet")
    refused(answer, 2 if file == "config.yaml" else 3, file)
    assert (run / "video" / "render.mp4").read_bytes() == before


def test_render_refuses_what_is_no_run_and_what_is_another_scene(
    command: Callable[..., Any], tiny_run: Path, tmp_path: Path
) -> None:
    refused(command("render", tmp_path), 3, "manifest.json")
    refused(command("render", tiny_run, "--scene", "missing.ply"), 3, "missing.ply")
    refused(command("render", tiny_run, "--scene", "builtin:plaza"), 3, "is not the scene of this run")
    refused(command("render", tiny_run, "--out", tmp_path / "x.avi"), 2, "x.avi", ".mp4")
    manifest = json.loads((tiny_run / "manifest.json").read_text())
    manifest["scene"]["sha256"] = "../" * 8
    run = shutil.copytree(tiny_run, tmp_path / "run")
    (run / "manifest.json").write_text(json.dumps(manifest))
    refused(command("render", run), 3, "scene")
    manifest["scene"]["up"] = [10**400, 0, 0]
    (run / "manifest.json").write_text(json.dumps(manifest))
    refused(command("render", run), 3, "manifest.json", "scene: expected sha256 and up")


@pytest.mark.parametrize("debug", ["", "1"])
def test_what_a_plugin_raised_is_told_and_shown_when_asked(
    command: Callable[..., Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, debug: str
) -> None:
    monkeypatch.setenv("CLTRANSFER_DEBUG", debug)
    (tmp_path / "broken.py").write_text("raise RuntimeError('broken')")
    if not debug:
        refused(command("transfer", "--allow-plugin", tmp_path / "broken.py"), 4, "broken.py", "RuntimeError: broken")
        return
    with pytest.raises(ModelError) as caught:
        command("transfer", "--allow-plugin", tmp_path / "broken.py")
    assert isinstance(caught.value.__cause__, RuntimeError)


FRESH = {
    3: ("transfer", "missing.ply", "--out", "out"),
    2: ("transfer", "genrations=2", "--out", "out"),
    4: ("transfer", "--allow-plugin", "nope", "--out", "out"),
}


@pytest.mark.parametrize("code", FRESH)
def test_a_fresh_process_refuses_at_once(
    fresh: Callable[..., Any], within: Callable[[float, float], bool], tmp_path: Path, code: int
) -> None:
    answer = fresh(*FRESH[code])
    if not within(answer.seconds, SECONDS):  # the first may write bytecode
        answer = fresh(*FRESH[code])
    refused(answer, code)
    assert within(answer.seconds, SECONDS)
    assert not list(tmp_path.iterdir())


def test_a_disk_that_cannot_be_written_is_code_5(command: Callable[..., Any], tiny_run: Path, tmp_path: Path) -> None:
    """A name that no file system takes; where a file stands for the folder, the command cannot be meant."""
    answer = command("render", tiny_run, "output_side=64", "--quiet", "--out", tmp_path / f"{'x' * 300}.mp4")
    refused(answer, 5, "x.mp4")


@pytest.mark.slow  # a sweep is interrupted in tests/ablate/test_ablate.py, a run terminated in tests/run/test_resume.py
@pytest.mark.parametrize(("name", "code"), [("SIGINT", 130), ("SIGTERM", 143)])
def test_a_signal_ends_a_run_without_a_trace(tmp_path: Path, cache: Path, name: str, code: int) -> None:
    process = subprocess.Popen(
        [sys.executable, "-m", "cltransfer", "transfer", "generations=1000", "patience=1000", "--out", "a take"],
        cwd=tmp_path,
        env={**os.environ, "CLTRANSFER_CACHE": str(cache)},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),  # a background shell would have it ignored
    )
    try:
        assert process.stderr is not None
        process.stderr.readline()  # it works now
        while not (tmp_path / "a take" / "journal.bin").is_file() and process.poll() is None:
            time.sleep(0.05)
        process.send_signal(getattr(signal, name))
        start = time.perf_counter()
        out, err = process.communicate(timeout=30)
    finally:
        process.kill()
    assert (process.returncode, out) == (code, "")
    assert "Traceback" not in err
    word = {"SIGINT": "interrupted", "SIGTERM": "terminated"}[name]
    assert err.splitlines()[-1] == f"error: {word} (the same command with --resume 'a take' goes on from here)"
    assert time.perf_counter() - start < 10
    assert {p.name for p in (tmp_path / "a take").rglob("*")} <= {"journal.bin"}  # nothing half-written


def test_a_warning_shows_nothing_that_a_terminal_would_act_on(
    command: Callable[..., Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(logging.getLogger(), "handlers", [])  # as in a process of its own
    write_splats(tmp_path / "scene.ply", synthetic_room(200, 0))
    frame = {"file_path": "a.png", "transform_matrix": np.eye(4).tolist()}
    told = {"w": 8, "h": 6, "fl_x": 5, "ply_file_path": "\x1b]0;a\x07\x1b[31m\nx.ply", "frames": [frame]}
    (tmp_path / "transforms.json").write_text(json.dumps(told))
    answer = command("simplify", "scene.ply", "--view", "transforms.json:0", "--out", "a.ply", "k=0", "--quiet")
    where = "transforms.json: ply_file_path: no such file, the set has no points"
    assert answer.err == where + r": \x1b]0;a\x07\x1b[31m x.ply" + "\n"


ENDING = """
import atexit, os, signal
from cltransfer.cli.app import main
atexit.register(lambda: os.kill(os.getpid(), signal.SIGTERM))
main()
"""


def test_a_signal_when_all_is_said_shows_nothing_of_the_interpreter() -> None:
    done = subprocess.run([sys.executable, "-c", ENDING, "--version"], capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stdout, done.stderr) == (-signal.SIGTERM, f"{__version__}\n", "")


@pytest.mark.parametrize(("words", "left", "full"), [("--version", 1, 5), ("nonsense", 2, 2)])
def test_output_that_nobody_reads_or_that_has_no_room_is_told_in_no_words_of_the_interpreter(
    words: str, left: int, full: int
) -> None:
    end, start = os.pipe()
    os.close(end)
    usual = {name: value for name, value in os.environ.items() if name != "PYTHONUNBUFFERED"}
    told = "error: No such command 'nonsense'.\n" * (words == "nonsense")
    with os.fdopen(start, "w") as gone, open("/dev/full", "w") as no_room:
        for stdout, code, err in (
            (gone, left, told),
            (no_room, full, told or "error: file: No space left on device\n"),
        ):
            line = [sys.executable, "-m", "cltransfer", words]
            done = subprocess.run(line, env=usual, stdout=stdout, stderr=subprocess.PIPE, text=True, timeout=60)
            assert (done.returncode, done.stderr) == (code, err)
            both = subprocess.run(line, env=usual, stdout=stdout, stderr=stdout, timeout=60)
            assert both.returncode == code


def test_a_closed_stderr_is_no_fault(command: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "stderr", None)
    assert command("evaluate", "missing.mp4", "missing.mp4").code == 3
