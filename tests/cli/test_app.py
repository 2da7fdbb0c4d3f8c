"""Every verb runs, says where its results are, and keeps standard output for them."""

from __future__ import annotations

import html
import json
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import pytest
import torch
import typer

from cltransfer.ablate.trial import run_trial
from cltransfer.camera import Camera
from cltransfer.cli.app import app
from cltransfer.cli.shared import unused_plugins
from cltransfer.clips.clip import read_clip
from cltransfer.config import load_config, to_yaml
from cltransfer.plugins import allow
from cltransfer.reading.named_scenes import remember
from cltransfer.registry import EXTRACTORS, LOSSES
from cltransfer.subject import Subject
from cltransfer.trajectory import Trajectory

DATA = Path(__file__).resolve().parents[2].parent / "shared" / "data"
VERBS = (
    "",
    "transfer",
    "evaluate",
    "ablate",
    "render",
    "export",
    "lift",
    "bench",
    "bench speed",
    "bench grid",
    "bench lod",
    "bench driver",
    "bench chart",
    "bench stress",
    "bench flow",
    "bench describe",
    "fit",
    "study",
    "simplify",
    "bake",
    "plugins",
    "plugins list",
    "plugins show",
    "models",
    "models pull",
    "assets",
    "assets list",
    "cache list",
    "cache clear",
)
LEFT: tuple[str, ...] = (
    "manifest.json",
    "config.yaml",
    "trajectory.json",
    "camera/camera_path.json",
    "metrics.json",
    "metrics.csv",
)
LEFT += (
    "video/render.mp4",
    "video/side_by_side.mp4",
    "video/frames.mkv",
    "strip.jpg",
    "subject.json",
    "labels.safetensors",
    "report.html",
    "DONE",
)
METRICS = {"shot_size", "framing", "filmic_space", "camera_movement", "camera_angle", "total"}

PLUGIN = """
from dataclasses import dataclass
from cltransfer.registry import LOSSES
from cltransfer.subject import Subject

@LOSSES.register("headroom")
@dataclass(frozen=True)
class Headroom:
    weight: float = 1.0
    requires, unit, penalty = ("keypoints",), "frame", 1.0
    def __call__(self, reference, rendered):
        return ((rendered.keypoints[:, 12, 1] - reference.keypoints[:, 12, 1]) / reference.size[1]).abs()
"""


EACH_HELP = """
import os, rich.markdown, sys, time, typer.rich_utils  # what every help loads, once
from cltransfer.cli.app import main
begun = time.process_time()
for count, verb in enumerate(sys.argv[1:]):
    if not (child := os.fork()):
        for stream, kind in ((1, "out"), (2, "err")):
            os.dup2(os.open(f"{count}.{kind}", os.O_WRONLY | os.O_CREAT), stream)
        sys.argv = ["cltransfer", *verb.split(), "--help"]
        try:
            main()
        except SystemExit as end:
            sys.stdout.flush()
            os._exit(end.code or 10 * ("torch" in sys.modules))
    _, status, used = os.wait4(child, 0)
    print(os.waitstatus_to_exitcode(status), begun + used.ru_utime + used.ru_stime)
"""


@pytest.fixture(scope="module")
def helped(tmp_path_factory: pytest.TempPathFactory) -> dict[str, tuple[int, str, str, float]]:
    """Exit status, output, errors and processor time of every verb's help.

    Each runs in a process that forks off where the command line has been imported; its time is from the beginning.
    """
    folder, verbs = tmp_path_factory.mktemp("help"), (*VERBS, "doctor")
    command = [sys.executable, "-c", EACH_HELP, *verbs]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=True, timeout=120)
    told = [line.split() for line in done.stdout.splitlines()]
    texts = [[(folder / f"{count}.{kind}").read_text() for kind in ("out", "err")] for count in range(len(verbs))]
    return {
        verb: (int(code), out, err, float(seconds)) for verb, (code, seconds), (out, err) in zip(verbs, told, texts)
    }


@pytest.mark.parametrize("verb", [*VERBS, "doctor"])
def test_help_takes_no_torch(helped: dict[str, Any], verb: str) -> None:
    code, out, err, _ = helped[verb]
    assert (code, err) == (0, "")  # 10 with torch
    assert "Usage:" in out


def test_help_takes_half_a_second(helped: dict[str, Any], within: Callable[[float, float], bool]) -> None:
    took = {verb: seconds for verb, (*_, seconds) in helped.items()}
    assert within(max(took.values()), 0.5), took


def helps(verb: Any) -> Iterator[str]:
    """Every help text of a verb, of its options and of the verbs under it."""
    yield verb.help or ""
    yield from (getattr(option, "help", "") or "" for option in verb.params)
    for below in getattr(verb, "commands", {}).values():
        yield from helps(below)


def test_help_begins_with_what_most_people_want() -> None:
    assert list(typer.main.get_command(app).commands)[:4] == ["transfer", "render", "evaluate", "ablate"]  # type: ignore[attr-defined]


def test_no_help_says_a_word_twice_in_a_row() -> None:
    texts = list(helps(typer.main.get_command(app)))
    assert len(texts) > 100
    assert [text for text in texts if re.search(r"\b(\w+) \1\b", text)] == []


def usages(verb: Any, path: str = "cltransfer") -> Iterator[str]:
    """The line of how a verb is written, and those of the verbs under it."""
    yield " ".join(verb.get_usage(typer.Context(verb, info_name=path)).split()).removeprefix("Usage: ")
    for name, below in getattr(verb, "commands", {}).items():
        yield from usages(below, f"{path} {name}")


def test_a_usage_has_brackets_and_dots_once() -> None:
    told = list(usages(typer.main.get_command(app)))
    assert len(told) > 40
    assert [line for line in told if re.search(r"\[\[|\.\.\.[\]}]|\]\]", line)] == []
    assert "cltransfer transfer [OPTIONS] [SCENE] [REFERENCE] [KEY=VALUE]..." in told
    assert "cltransfer evaluate [OPTIONS] {reference} {render} [METHOD=FOLDER|KEY=VALUE]..." in told


def test_a_run_leaves_what_it_promises(tiny_run: Path) -> None:
    assert [name for name in LEFT if not (tiny_run / name).is_file()] == []
    assert list(tiny_run.rglob(".tmp*")) == []
    metrics = json.loads((tiny_run / "metrics.json").read_text(), parse_constant=pytest.fail)
    assert set(metrics["metrics"]) == METRICS
    assert metrics["metrics"]["shot_size"]["defined"] == metrics["frames"] == 3


def test_the_config_of_a_run_reads_back_and_runs_again(
    command: Callable[..., Any], tiny_run: Path, tmp_path: Path
) -> None:
    config = load_config(tiny_run / "config.yaml")
    assert (config.frames, config.generations, config.output_side, config.search_side) == (3, 2, 96, 48)
    assert to_yaml(config) == (tiny_run / "config.yaml").read_text()
    again = tmp_path / "again"
    answer = command("transfer", "--quiet", "-c", tiny_run / "config.yaml", "--out", again, "frames=1")
    assert answer.code == 0, answer.err
    assert load_config(again / "config.yaml") == replace(config, frames=1)
    assert json.loads((again / "metrics.json").read_text())["frames"] == 1


def test_print_config_reads_back_as_itself(command: Callable[..., Any], tmp_path: Path) -> None:
    first = command("transfer", "frames=5", "losses.framing.weight=3", "--print-config")
    (tmp_path / "config.yaml").write_text(first.out)
    again = command("transfer", "--config", tmp_path / "config.yaml", "--print-config")
    assert (first.code, first.err, again.out) == (0, "", first.out)


@pytest.mark.parametrize("key", ["losses.framing.weight", "search.subject_orbit.nearest"])
def test_a_config_that_cannot_run_is_not_printed(command: Callable[..., Any], key: str) -> None:
    refused = command("transfer", f"{key}=abc", "--print-config")
    assert (refused.code, refused.out) == (2, "")
    assert refused.err == f"error: command line: {key}: expected a number, got 'abc'\n"


def test_json_is_all_there_is_on_stdout(command: Callable[..., Any], tmp_path: Path) -> None:
    short = ("frames=2", "generations=1", "output_side=64", "search_side=32")
    answer = command("transfer", "--json", "--out", tmp_path / "run", *short)
    assert answer.code == 0, answer.err
    said = json.loads(answer.out, parse_constant=pytest.fail)
    assert said["folder"] == str(tmp_path / "run")
    assert set(said["metrics"]) == METRICS
    assert answer.err != ""  # progress
    assert "error" not in answer.err


@pytest.mark.parametrize(
    ("missing", "says"),
    [
        (".", "note: the run in RUN will be replaced (--out FOLDER keeps it)\n"),
        (
            "DONE",
            "note: the unfinished run in RUN will be replaced, unless this is its own command, "
            "which goes on with it by --resume RUN\n",
        ),
    ],
    ids=["finished", "unfinished"],
)
def test_a_run_is_written_over_a_run(
    command: Callable[..., Any], tiny_run: Path, tmp_path: Path, missing: str, says: str
) -> None:
    run = shutil.copytree(tiny_run, tmp_path / "run", ignore=shutil.ignore_patterns(missing))
    before = (run / "metrics.json").stat().st_mtime_ns
    short = ("frames=1", "generations=1", "output_side=64", "search_side=32")
    answer = command("transfer", "--out", run, *short)
    assert (answer.code, says.replace("RUN", str(run)) in answer.err) == (0, True), answer.err
    assert (run / "metrics.json").stat().st_mtime_ns > before
    assert (run / "DONE").is_file()


def test_render_again_at_another_size_from_the_memory_and_by_name(
    command: Callable[..., Any], tiny_run: Path, tmp_path: Path
) -> None:
    for name, more in (("a.mp4", ()), ("b.mp4", ("--scene", "builtin:courtyard"))):
        answer = command("render", tiny_run, "output_side=64", "--quiet", "--out", tmp_path / name, *more)
        assert (answer.code, answer.out, answer.err) == (0, f"{tmp_path / name}\n", "")
    first, second = (read_clip(tmp_path / name).image.float() for name in ("a.mp4", "b.mp4"))
    assert first.shape == (3, 3, 36, 64)
    assert float((first - second).abs().mean()) < 8  # levels; the encoder may choose other blocks


def test_render_fills_in_what_lies_between_the_frames(
    command: Callable[..., Any], tiny_run: Path, tmp_path: Path
) -> None:
    own = Trajectory.load(tiny_run / "trajectory.json").times
    fps = 4 / float(own[1] - own[0])
    answer = command("render", tiny_run, "output_side=64", "--fps", fps, "--quiet", "--out", tmp_path / "a.mp4")
    assert (answer.code, answer.err) == (0, "")
    film = read_clip(tmp_path / "a.mp4")
    assert len(film.times) == int(float(own[-1] - own[0]) * fps + 1e-6) + 1 > 2 * len(own)
    assert float(film.times.diff().mean()) == pytest.approx(1 / fps, rel=0.02)
    assert command("render", tiny_run, "output_side=64", "--quiet", "--out", tmp_path / "b.mp4").code == 0
    first = read_clip(tmp_path / "b.mp4").image[0].float()
    assert float((film.image[0].float() - first).abs().mean()) < 8  # levels; the encoder may choose other blocks


def test_render_tells_where_frames_between_those_of_the_run_pass_through_something(
    command: Callable[..., Any], tiny_run: Path, tmp_path: Path
) -> None:
    run = shutil.copytree(tiny_run, tmp_path / "run")
    own = Trajectory.load(run / "trajectory.json")
    beyond = own.camera[0].w2c.clone()  # as far behind the person as the first frame is before
    person = Subject.load(run / "subject.json").anchor
    beyond[:, :3, 3] -= 2 * (beyond[:, :3, :3] @ person + beyond[:, :3, 3])
    both = Camera(torch.cat([own.camera[0].w2c, beyond]), own.camera.K[:2], own.camera.size)
    Trajectory(both, torch.tensor([0.0, 1.0], dtype=torch.float64)).save(run / "trajectory.json")
    words = ("render", run, "output_side=64", "--quiet")
    assert "note" not in command(*words).out  # the two frames themselves are fine
    answer = command(*words, "--fps", 80)
    assert answer.code == 0
    told = re.search(
        r"note: the camera stands inside the person in (\d+) of 81 frames, (0\.\d+) to (0\.\d+) s", answer.out
    )
    assert told is not None
    assert float(told[3]) - float(told[2]) == pytest.approx((int(told[1]) - 1) / 80, abs=0.011)


def test_render_of_a_scene_that_was_moved_says_what_to_name(
    command: Callable[..., Any], tiny_run: Path, cache: Path, tmp_path: Path
) -> None:
    digest = json.loads((tiny_run / "manifest.json").read_text())["scene"]["sha256"]
    remember(digest, "builtin:courtyard")  # the run may have been made with another cache
    note = cache / "scenes" / f"{digest}.json"
    seen = note.read_bytes()
    note.write_text(json.dumps({**json.loads(seen), "path": str(tmp_path / "gone.ply")}))
    try:
        answer = command("render", tiny_run, "--quiet", "--out", tmp_path / "a.mp4")
    finally:
        note.write_bytes(seen)
    assert answer.code == 3
    assert "gone.ply: no such file (it has been moved? name it: --scene FILE)" in answer.err


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["frames=30"], "frames: the path of a run stands; only how it is drawn can change"),
        (["losses.framing=null"], "losses: the path of a run stands"),
        (["--fps", "0"], "--fps: expected a rate in (0, 240], got 0"),
        (["--fps", "nan"], "--fps: expected a rate in (0, 240], got nan"),
    ],
)
def test_render_refuses_what_it_cannot_do(
    command: Callable[..., Any], tiny_run: Path, words: list[str], says: str
) -> None:
    before = (tiny_run / "video" / "render.mp4").read_bytes()
    answer = command("render", tiny_run, *words, "--quiet")
    assert (answer.code, says in answer.err) == (2, True), answer.err
    assert (tiny_run / "video" / "render.mp4").read_bytes() == before


def test_evaluate_scores_a_clip_against_itself_as_zero(
    command: Callable[..., Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if not (DATA / "models").is_dir():
        pytest.skip("needs the networks and clips of shared/data")
    monkeypatch.setenv("CLTRANSFER_MODELS", str(DATA / "models"))
    clip = DATA / "video" / "lp_s20.mp4"
    answer = command("evaluate", clip, clip, "frames=3", "--json", "--quiet", "--out", tmp_path / "scores")
    assert (answer.code, answer.err) == (0, "")
    metrics = json.loads(answer.out, parse_constant=pytest.fail)["metrics"]
    assert [metric["mean"] for metric in metrics.values() if metric["mean"]] == []
    assert metrics["framing"]["mean"] == metrics["camera_angle"]["mean"] == metrics["shot_size"]["mean"] == 0
    assert metrics["shot_size"]["defined"] == 3
    assert metrics["filmic_space"]["mean"] is None
    assert metrics["filmic_space"]["reason"]
    assert {p.name for p in (tmp_path / "scores").iterdir()} == {"metrics.json", "metrics.csv", "report.html"}


CHOSEN = """from dataclasses import dataclass
from cltransfer.registry import EXTRACTORS

@EXTRACTORS.register("chosen")
@dataclass(frozen=True)
class Chosen:
    'What one likes.'
    give: str = "gaze"
    requires, family = ("image",), "both"
    provides = property(lambda self: (self.give,))
    __call__ = print
"""


def test_plugins_are_listed_and_shown(command: Callable[..., Any]) -> None:
    listed = json.loads(command("plugins", "list", "--json").out)
    assert METRICS - {"total"} <= set(listed["losses"])
    shown = json.loads(command("plugins", "show", "shot_size", "--json").out)
    assert shown["options"]["mode"] == "'robust'"
    assert "keypoints" in shown["requires"]


def test_the_keys_of_a_run_are_explained_with_what_the_default_sets(command: Callable[..., Any]) -> None:
    shown = command("plugins", "show", "config")
    assert all(f"\n{part}: " in f"\n{shown.out}" for part in ("config", "adam", "extract"))
    assert "popsize: candidates a generation." in shown.out
    assert "  joint = 3" in shown.out.splitlines()  # balanced, not the field's own default
    options = json.loads(command("plugins", "show", "config", "--json").out)["options"]
    assert options["extract.corrections"] == 1
    every = json.loads(json.dumps(asdict(load_config())))
    assert set(options) == {
        *(key for key, value in every.items() if not isinstance(value, dict)),
        *(f"{key}.{own}" for key in ("adam", "extract") for own in every[key]),
    }


def test_how_long_a_built_in_shot_is_stands_at_its_name_and_at_the_key(
    command: Callable[..., Any], helped: dict[str, tuple[int, str, str, float]]
) -> None:
    words = " ".join(helped["transfer"][1].replace("│", " ").split())
    assert "handheld), as many frames long as frames= says, by default 24, at 12 a second." in words
    explained = " ".join(command("plugins", "show", "config").out.split())
    assert "Of builtin:SHOT it makes another shot, as many frames long at 12 a second; null makes one" in explained


def test_what_fit_takes_is_listed_and_explained(command: Callable[..., Any]) -> None:
    assert json.loads(command("plugins", "list", "--json").out)["fit"] == ["gaussian_splats", "nerf_grid"]
    assert "  budget = 'auto'" in command("plugins", "show", "fit.nerf_grid").out.splitlines()
    assert command("plugins", "show", "nerf_grid").out.startswith("renderer.nerf_grid\n")
    missing = command("plugins", "show", "shot_sise")
    assert missing.err == "error: shot_sise: no such component (did you mean 'shot_size'?)\n"


def test_of_two_components_of_one_name_either_is_shown(
    command: Callable[..., Any], tmp_path: Path, own_loss: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "mine.py").write_text(own_loss.replace('"mine"', '"layers"'))
    monkeypatch.setitem(LOSSES._classes, "layers", object)  # to be forgotten after the test
    del LOSSES._classes["layers"]
    plugin = ("--allow-plugin", tmp_path / "mine.py")
    both = command("plugins", "show", "layers", *plugin)
    assert both.code == 2
    assert both.err == "error: layers: 2 components have this name (show one: extractors.layers, losses.layers)\n"
    for section, line in (("extractors", "provides: layers"), ("losses", "requires: keypoints")):
        assert line in command("plugins", "show", f"{section}.layers", *plugin).out.splitlines()


def test_an_extractor_whose_options_tell_what_it_provides_is_shown(
    command: Callable[..., Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "chosen.py").write_text(CHOSEN)
    monkeypatch.setitem(EXTRACTORS._classes, "chosen", object)  # to be forgotten after the test
    del EXTRACTORS._classes["chosen"]
    shown = command("plugins", "show", "chosen", "--allow-plugin", tmp_path / "chosen.py")
    assert shown.out.splitlines() == ["extractors.chosen", "What one likes.", "requires: image", "  give = 'gaze'"]


def test_doctor_finds_this_computer_fit(command: Callable[..., Any]) -> None:
    answer = command("doctor", "--json")
    assert answer.code == 0, answer.out
    found = {finding["what"]: finding["ok"] for finding in json.loads(answer.out)}
    assert found["self-test"]
    assert found["torch"]


def test_the_version_is_printed(command: Callable[..., Any]) -> None:
    assert re.fullmatch(r"\d+\.\d+\.\d+\n", command("--version").out)


def test_a_loss_from_anywhere_is_used_from_a_config_when_allowed(
    command: Callable[..., Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "headroom.py").write_text(PLUGIN)
    (tmp_path / "config.yaml").write_text("losses: {headroom: {weight: 5}}\nframes: 1\ngenerations: 1\n")
    sizes = ("search_side=32", "output_side=64", "--quiet")
    alone = command("transfer", "-c", "config.yaml", "--out", "run", *sizes)
    assert alone.code == 2
    assert "losses.headroom: no such loss" in alone.err
    try:
        allowed = command("transfer", "-c", "config.yaml", "--out", "run", "--json", "--allow-plugin", "mine", *sizes)
    finally:
        LOSSES._classes.pop("headroom", None)
    assert allowed.code == 0, allowed.err
    assert json.loads(allowed.out)["metrics"]["headroom"]["defined"] == 1


@pytest.fixture
def with_plugin(command: Callable[..., Any], tmp_path: Path) -> Callable[..., Any]:
    """Run a command line that is allowed a plugin, and forget the plugin."""
    (tmp_path / "my loss.py").write_text(PLUGIN)

    def run(*arguments: str | Path) -> Any:
        try:
            return command(*arguments, "--allow-plugin", tmp_path / "my loss.py")
        finally:
            del LOSSES._classes["headroom"]

    return run


def test_every_verb_that_reads_a_config_takes_a_plugin(
    command: Callable[..., Any], with_plugin: Callable[..., Any], tmp_path: Path
) -> None:
    short = ("losses.headroom={}", "frames=1", "generations=1", "output_side=64", "search_side=32", "--quiet")
    run, video = tmp_path / "run", tmp_path / "again.mp4"
    assert with_plugin("transfer", *short, "--out", run).code == 0
    made_again = f"--allow-plugin '{tmp_path / 'my loss.py'}' --config {run / 'config.yaml'}"
    assert made_again in html.unescape((run / "report.html").read_text())
    refused = command("render", run, "--quiet", "--out", video)
    assert (refused.code, video.exists()) == (2, False)
    assert "losses.headroom: no such loss" in refused.err
    rendered = with_plugin("render", run, "--quiet", "--out", video)
    assert (rendered.code, rendered.err, video.is_file()) == (0, "", True)
    assert "no such loss" in command("lift", "missing.ply", "losses.headroom={}").err
    assert "losses: changes nothing of a lift" in with_plugin("lift", "missing.ply", "losses.headroom={}").err
    assert "headroom" in json.loads(with_plugin("plugins", "list", "--json").out)["losses"]
    assert "headroom" not in json.loads(command("plugins", "list", "--json").out)["losses"]


def test_a_plugin_that_nothing_uses_and_a_reference_that_nobody_named_are_told(
    with_plugin: Callable[..., Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    here = "cltransfer.ablate.pool._by_processes"  # processes of their own take longer to start than the trials
    monkeypatch.setattr(here, lambda trials, job, workers: (run_trial(trial, job) for trial in trials))
    short = ("builtin:room", "preset=fast", "frames=1", "output_side=64", "search_side=32", "--quiet")
    plugin = f"note: plugin {tmp_path / 'my loss.py'} is allowed, but none of its components is in use"
    unused, reference = f"{plugin} (losses.headroom={{}})", "note: no reference named: builtin:dolly_zoom is taken"
    assert with_plugin("transfer", *short, "--out", tmp_path / "a").out.splitlines()[-2:] == [reference, unused]
    named = ("builtin:room", "builtin:static", *short[1:], "losses.headroom={}")
    used = with_plugin("transfer", *named, "--out", tmp_path / "b")
    assert (used.code, "is allowed" in used.out, "no reference" in used.out) == (0, False, False)
    json.loads(with_plugin("transfer", *short, "--json", "--out", tmp_path / "c").out)
    (tmp_path / "rows.yaml").write_text("rows: {one: {}}\n")
    sweep = ("ablate", tmp_path / "rows.yaml", "scenes=[builtin:room]", "references=[builtin:static]", *short[1:])
    assert unused in with_plugin(*sweep, "--out", tmp_path / "d").out
    measured = with_plugin(*sweep, "losses.headroom={}", "--out", tmp_path / "e")
    assert (measured.code, "is allowed" in measured.out) == (0, False)


def test_a_plugin_that_registers_nothing_is_told(tmp_path: Path, own_loss: str) -> None:
    (tmp_path / "lazy.py").write_text(own_loss.replace("@LOSSES", "# @LOSSES"))
    told = f"plugin {tmp_path / 'lazy.py'} is allowed, but registers nothing: @LOSSES.register(...) above a class does"
    allow([tmp_path / "lazy.py"])
    assert unused_plugins([str(tmp_path / "lazy.py")], load_config()) == [told]


def test_without_plugins_nothing_is_missed(command: Callable[..., Any], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CLTRANSFER_DISABLE_PLUGINS", "1")
    assert command("transfer", "--print-config").code == 0
    assert command("plugins", "list").code == 0


@pytest.mark.parametrize("value", ["1", "true", "yes"])
def test_plugins_are_switched_off_by_any_word(
    command: Callable[..., Any], monkeypatch: pytest.MonkeyPatch, tmp_path: Path, value: str
) -> None:
    (tmp_path / "mine.py").write_text("raise SystemExit('was run')")
    monkeypatch.setenv("CLTRANSFER_DISABLE_PLUGINS", value)
    refused = command("plugins", "list", "--allow-plugin", tmp_path / "mine.py")
    assert (refused.code, refused.err.count("\n")) == (4, 1)
    assert "plugins are switched off (unset CLTRANSFER_DISABLE_PLUGINS)" in refused.err


@pytest.mark.parametrize("views", ["0", "-3", "2", "65"])
def test_a_lift_looks_from_somewhere(command: Callable[..., Any], views: str) -> None:
    refused = command("lift", "builtin:courtyard", "--views", views)
    assert (refused.code, refused.err) == (2, f"error: --views: expected 3 to 64, got {views}\n")


def test_a_person_is_not_written_over_that_of_a_run(command: Callable[..., Any], tmp_path: Path) -> None:
    (tmp_path / "manifest.json").write_text('{"format": "cltransfer.run"}')
    refused = command("lift", "builtin:courtyard", "--out", tmp_path)
    assert (refused.code, refused.err.count("\n")) == (2, 1), refused.err
    assert "expected another folder than that of a run, whose own subject and labels" in refused.err


def test_an_installed_plugin_is_listed_unseen_and_runs_only_when_allowed(
    fresh: Callable[..., Any], tmp_path: Path
) -> None:
    site = tmp_path / "site"
    info = site / "cl_headroom-1.2.dist-info"
    info.mkdir(parents=True)
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: cl-headroom\nVersion: 1.2\n")
    (info / "entry_points.txt").write_text("[cltransfer.plugins]\nheadroom = cl_headroom\n")
    (site / "cl_headroom.py").write_text(f"open({str(tmp_path / 'ran')!r}, 'w').close()\n{PLUGIN}")
    path = os.pathsep.join(filter(None, (str(site), os.environ.get("PYTHONPATH"))))
    listed = fresh("plugins", "list", PYTHONPATH=path)
    assert "headroom (cl-headroom 1.2)" in listed.out
    assert fresh("plugins", "show", "headroom", PYTHONPATH=path).code == 2
    assert fresh("transfer", "losses.headroom={}", "--print-config", PYTHONPATH=path).code == 2
    assert not (tmp_path / "ran").exists()
    assert "keypoints" in fresh("plugins", "show", "headroom", "--allow-plugin", "headroom", PYTHONPATH=path).out
    assert (tmp_path / "ran").exists()


@pytest.mark.parametrize("code", ["raise RuntimeError('broken')", "import sys; sys.exit(0)", "def ("])
def test_a_plugin_that_fails_at_import_is_named(
    command: Callable[..., Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, code: str
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "broken.py").write_text(code)
    answer = command("transfer", "--allow-plugin", "broken.py")
    assert answer.code == 4
    assert answer.err.count("\n") == 1
    assert "broken.py" in answer.err


def test_a_plugin_cannot_take_a_built_in_name(
    command: Callable[..., Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.py").write_text(PLUGIN.replace('"headroom"', '"framing"'))
    answer = command("transfer", "--allow-plugin", "mine.py", "--print-config")
    assert (answer.code, answer.err) == (
        4,
        f"error: {tmp_path / 'mine.py'}: loss 'framing': the name is taken; choose another\n",
    )
