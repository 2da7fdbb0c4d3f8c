"""A sweep runs, survives its trials and its own death, and goes on where it was."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, ClassVar

import pytest
import torch

from cltransfer.ablate.drawn import draw_references
from cltransfer.ablate.outcome import Metric, Outcome
from cltransfer.ablate.pool import outcomes
from cltransfer.ablate.read import read_sweep
from cltransfer.ablate.run import Ablation, markdown
from cltransfer.ablate.summary import summarise
from cltransfer.ablate.trial import Job, run_trial, trials
from cltransfer.camera import Camera
from cltransfer.config import load_config
from cltransfer.features import Features
from cltransfer.paired import FEWEST, LEVEL
from cltransfer.plugins import _forget, _module
from cltransfer.registry import RENDERERS
from cltransfer.renderers.gaussian_splats import GaussianSplats
from cltransfer.scenes import Scene
from cltransfer.storage.alone import alone

DEADLINE = 120  # seconds for a line in the ledger
ROWS = "{full: {}, no framing: {losses: {framing: null}}, no size: {losses: {shot_size: null}}}"
TINIER = ("references=['drawn:push_in']", "frames=1", "search_side=32", "output_side=32")
SweepFile = Callable[..., Path]


def begun(arguments: list[str], cache: Path) -> subprocess.Popen[str]:
    """The command in a session of its own, so that it can be killed with its workers.

    It hears SIGINT even where the tests do not, as what a script has put into the background does not.
    """
    return subprocess.Popen(
        [sys.executable, "-m", "cltransfer", "ablate", *arguments],
        env={**os.environ, "CLTRANSFER_CACHE": str(cache)},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        preexec_fn=partial(signal.signal, signal.SIGINT, signal.SIG_DFL),
    )


def lines(folder: Path) -> list[dict[str, Any]]:
    """Whole lines of the ledger, which may not be there yet or be written to just now."""
    path = folder / "trials.jsonl"
    whole, end, _ = (path.read_text() if path.exists() else "").rpartition("\n")
    return [json.loads(line) for line in (whole + end).splitlines()]


def keys(folder: Path) -> list[str]:
    return [line["key"] for line in lines(folder)]


def stopped(arguments: list[str], cache: Path, out: Path, sent: signal.Signals) -> tuple[int, str, str]:
    """Exit status and words of the command, sent a signal once it has put another line into the ledger."""
    before, process, deadline = len(keys(out)), begun(arguments, cache), time.monotonic() + DEADLINE
    try:
        while process.poll() is None and len(keys(out)) == before:
            assert time.monotonic() < deadline, f"no trial ended in {DEADLINE} s"
            time.sleep(0.01)
        os.killpg(process.pid, sent)
        out_text, err_text = process.communicate(timeout=60)
    finally:
        with suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()
    return process.returncode, out_text, err_text


def timeless(values: dict[str, Any]) -> dict[str, Any]:
    """What a trial or a row came to, whenever and from whatever commit it was run."""
    return {**values, "seconds": 0, "commit": ""}


def values_of(metrics: dict[str, Any]) -> dict[str, tuple[float | None, int]]:
    return {name: (metric["mean"], metric["defined"]) for name, metric in metrics.items()}


def test_of_two_commands_in_one_folder_the_second_is_refused(
    command: Callable[..., Any], sweep_file: SweepFile, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    with alone(out, "works"):
        answer = command("ablate", sweep_file(ROWS), "--out", out, "--quiet")
    assert (answer.code, answer.err.count("\n")) == (5, 1), answer.err
    assert f"{out}: --out: another process runs an ablation there (wait until it ends" in answer.err
    assert not out.exists()


@pytest.mark.usefixtures("in_process")  # where it is not killed
def test_a_sweep_killed_in_the_middle_goes_on_to_the_same_table(
    command: Callable[..., Any], sweep_file: SweepFile, cache: Path, tmp_path: Path
) -> None:
    file, out = sweep_file(ROWS), tmp_path / "out"
    words = [str(file), "--out", str(out), "engine.workers=1", "--json"]
    assert stopped([*words, "--quiet"], cache, out, signal.SIGKILL) == (-signal.SIGKILL, "", "")
    interrupted = keys(out)
    assert 1 <= len(interrupted) < 3
    done = command("ablate", *words)
    assert done.code == 0, done.err
    assert keys(out)[: len(interrupted)] == interrupted
    assert len(set(keys(out))) == len(keys(out)) == 3
    found = json.loads(done.out)
    assert [row["name"] for row in found["rows"]] == ["full", "no framing", "no size"]
    assert [row["metrics"]["framing"]["value"]["count"] for row in found["rows"]] == [1, 1, 1]  # left out, yet measured
    assert {"table.csv", "table.md", "table.tex", "summary.json", "ablation.yaml"} <= {p.name for p in out.iterdir()}
    assert "| no framing | 1 | 0 |" in (out / "table.md").read_text()
    made_by, _, again = (out / "ablation.yaml").read_text().partition("\n")
    assert made_by == f"# made by: cltransfer ablate {' '.join(words)}"
    assert again == read_sweep(str(file), ["engine.workers=1"]).to_yaml()
    sweep = read_sweep(str(file), ["engine.workers=1"])
    unbroken = [run_trial(trial, Job()) for trial in trials(sweep, {})]
    assert [timeless(line) for line in lines(out)] == [timeless(asdict(outcome)) for outcome in unbroken]
    rows = summarise(["full", "no framing", "no size"], unbroken)
    assert [timeless(row) for row in found["rows"]] == [timeless(asdict(row)) for row in rows]


@pytest.mark.slow  # two commands
def test_an_interrupt_tells_how_to_go_on(
    command: Callable[..., Any], sweep_file: SweepFile, cache: Path, tmp_path: Path
) -> None:
    file, out = sweep_file(ROWS), tmp_path / "out"
    words = [str(file), "--out", str(out), "engine.workers=1"]
    status, said, complained = stopped([*words, "--quiet"], cache, out, signal.SIGINT)
    assert (status, said) == (130, "")
    assert f"error: interrupted (the same command goes on from here: {out})\n" in complained  # joblib may tell more
    interrupted = keys(out)
    done = command("ablate", *words)
    assert done.code == 0, done.err
    assert keys(out)[: len(interrupted)] == interrupted
    assert len(keys(out)) == 3


@pytest.mark.slow  # a process of its own
def test_no_worker_is_left_when_the_last_trial_has_ended(sweep_file: SweepFile, tmp_path: Path) -> None:
    sweep = read_sweep(str(sweep_file("{full: {}}")), [*TINIER, "engine.workers=1"])
    asked = trials(sweep, draw_references(sweep, tmp_path))
    (found,) = outcomes(asked, Job(), sweep.file.engine)
    assert not found.failed
    children = Path("/proc/self/task").glob("*/children")
    lines = [Path("/proc", pid, "cmdline").read_text() for file in children for pid in file.read_text().split()]
    assert not [line for line in lines if "LokyProcess" in line]


@pytest.mark.slow  # five trials
def test_every_row_is_measured_at_one_size_and_has_the_frames_that_it_asks_for(
    sweep_file: SweepFile, tmp_path: Path
) -> None:
    more = "metrics: {losses: {camera_movement: {mode: faithful}}}"  # in pixels
    exact = "small: {path: exact}, large: {path: exact, output_side: 192}"  # so rough a path would end elsewhere
    file = sweep_file(f"{{{exact}, long: {{frames: 3}}, patient: {{path: exact, patience: 9}}}}", more)
    sweep = read_sweep(str(file), ["references=['drawn:orbit']"])
    found = [run_trial(trial, Job()) for trial in trials(sweep, draw_references(sweep, tmp_path))]
    assert [outcome.frames for outcome in found] == [2, 2, 3, 2], [outcome.failed for outcome in found]
    small, large = (outcome.metrics["camera_movement"].mean for outcome in found[:2] if outcome.metrics)
    assert small
    assert large == pytest.approx(small, rel=0.2)
    text = markdown(Ablation(sweep, tuple(summarise([row.name for row in sweep.rows], found)), tuple(found)))
    assert "same metrics at 48 px" in "\n".join(text)
    assert "- rows differ in frames (2, 3): so does what moves from one frame to the next" in text
    same = "- rows small and patient came out the same in every value: what sets them apart has no effect here"
    assert same in text  # patience is of the engine cma


def test_the_page_says_what_bold_asks_for(sweep_file: SweepFile, tmp_path: Path) -> None:
    sweep = read_sweep(str(sweep_file("{full: {}, no framing: {losses: {framing: null}}}")))
    found = [Outcome(t.key, t.row, t.case, failed="not run") for t in trials(sweep, draw_references(sweep, tmp_path))]
    text = markdown(Ablation(sweep, tuple(summarise([row.name for row in sweep.rows], found)), tuple(found)))
    told = f"bold: the interval excludes zero and the signed-rank test has p at most {LEVEL}, of {FEWEST} pairs or more"
    assert told in " ".join(text)
    assert "References: 1. Each counts as one, its scenes" in text  # of two trials
    assert "The p are not corrected for their number." in " ".join(text)
    assert "one person" not in " ".join(text)


@pytest.mark.parametrize(("more", "told"), [(",drawn:pan", True), ("", False)])
def test_the_page_says_where_shots_of_a_seed_show_one_person(
    sweep_file: SweepFile, tmp_path: Path, more: str, told: bool
) -> None:
    sweep = read_sweep(str(sweep_file("{full: {}}")), [f"references=[drawn:orbit{more},'builtin:pan']"])
    found = [Outcome(t.key, t.row, t.case, failed="not run") for t in trials(sweep, draw_references(sweep, tmp_path))]
    text = " ".join(markdown(Ablation(sweep, tuple(summarise(["full"], found)), tuple(found))))
    line = "The 2 drawn shots of a seed show one person: intervals and tests take them for independent"
    assert (line in text, "one person" in text) == (told, told)


@dataclass(frozen=True)
class Black:
    """Splats whose pictures are black."""

    provides: ClassVar[frozenset[str]] = GaussianSplats.provides

    def render(self, scene: Scene, cameras: Camera, buffers: frozenset[str]) -> Features:
        drawn = GaussianSplats().render(scene, cameras, buffers)
        return replace(drawn, image=torch.zeros_like(drawn.require("image"))) if drawn.has("image") else drawn


def test_the_page_says_why_a_term_has_no_value(sweep_file: SweepFile, tmp_path: Path) -> None:
    sweep = read_sweep(str(sweep_file("{full: {}, no framing: {losses: {framing: null}}}")))
    lacking = {
        "camera_angle": Metric(None, "rad", 0, "the reference has no 'orientation'"),
        "framing": Metric(0.1, "", 2, ""),
        "shot_size": Metric(1.0, "frame", 0, "undefined on every frame of the render"),
    }
    found = [
        Outcome(t.key, t.row, t.case, metrics=lacking, frames=2)
        for t in trials(sweep, draw_references(sweep, tmp_path))
    ]
    text = markdown(Ablation(sweep, tuple(summarise([row.name for row in sweep.rows], found)), tuple(found)))
    assert f"- camera_angle has no value: the reference has no 'orientation' ({len(found)} trials)" in text
    assert f"- shot_size pays its penalty: undefined on every frame of the render ({len(found)} trials)" in text
    assert not any(line.startswith("- framing") for line in text)


def test_what_measures_a_loss_of_a_row_is_told_to_be_copied(sweep_file: SweepFile) -> None:
    sweep = read_sweep(str(sweep_file("{pose: {losses: {jaws_pose: {}}}}")))
    text = markdown(Ablation(sweep, tuple(summarise(["pose"], [])), ()))
    assert any("jaws_pose is not measured; `metrics: {losses: {jaws_pose: {}}}` measures it" in line for line in text)


def test_the_head_of_the_page_stays_text_on_one_line(sweep_file: SweepFile) -> None:
    sweep = read_sweep(str(sweep_file("{a: {}, b: {steps: 2}}")))
    told = replace(sweep, name="a`b", file=replace(sweep.file, about="<b>one</b>\n\n# two | *three*"))
    head = markdown(Ablation(told, tuple(summarise(["a", "b"], [])), ()))[:4]
    assert head == ["# a\\`b", "", r"&lt;b>one&lt;/b>  # two \| \*three\*", ""]


def test_what_a_command_changes_in_the_yardstick_is_told_at_the_head_of_the_page(sweep_file: SweepFile) -> None:
    heads = []
    for said in (["frames=2", "extract.bias=frame"], ["frames=2", "losses.framing.weight=3", "output_side=64"]):
        sweep = read_sweep(str(sweep_file("{a: {}, b: {steps: 2}}")), said)
        heads.append(markdown(Ablation(sweep, tuple(summarise(["a", "b"], [])), ()))[4:7])
    assert heads[0][:2] == ["Over every row, from the command line: `frames=2`, `extract.bias=frame`.", ""]
    assert heads[1] == [
        "Over every row, from the command line: `frames=2`, `losses.framing.weight=3`, `output_side=64`.",
        "All rows are measured by `losses.framing.weight=3`, `output_side=64` too, where the metrics say nothing else.",
        "",
    ]


@pytest.mark.slow  # four trials
def test_no_row_is_measured_in_what_its_own_renderer_draws(
    sweep_file: SweepFile, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(RENDERERS._classes, "black", Black)
    gone = ", ".join(f"{name}: null" for name in load_config().losses)
    for renderer, sees in (("", True), ("renderer: {black: {}}", False)):
        # the search reads geometry, which both rows draw alike; the flow that measures them is read off the pictures
        metrics = f"metrics: {{extract: {{inner: image}}, losses: {{{gone}, jaws_flow: {{}}}}, {renderer}}}"
        sweep = read_sweep(str(sweep_file("{splats: {}, black: {renderer: {black: {}}}}", metrics)))
        sweep = replace(sweep, file=replace(sweep.file, references=["builtin:orbit"]))
        found = [run_trial(trial, Job()) for trial in trials(sweep, {})]
        flows = [outcome.metrics["jaws_flow"].mean for outcome in found if outcome.metrics]
        assert flows[0] == flows[1], [outcome.failed for outcome in found]
        assert bool(flows[0]) == sees
        drawn = markdown(Ablation(sweep, tuple(summarise(["splats", "black"], found)), tuple(found)))
        assert f"is drawn by {'gaussian_splats' if sees else 'black'} in every row" in "\n".join(drawn)


def test_trials_that_raise_or_kill_their_process_are_rows_with_a_reason(
    fresh: Callable[..., Any],
    command: Callable[..., Any],
    sweep_file: SweepFile,
    fatal: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """By a plugin that is a file, and one that is installed: a folder of its name is not imported in its place."""
    info, name = tmp_path / "site" / "cl_deadly-1.2.dist-info", "deadly"
    info.mkdir(parents=True)
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: cl-deadly\nVersion: 1.2\n")
    (info / "entry_points.txt").write_text(f"[cltransfer.plugins]\n{name} = cl_deadly\n")
    code = fatal.read_text().replace('register("fatal")', f'register("{name}")')
    (tmp_path / "site" / "cl_deadly.py").write_text(code)
    (tmp_path / name).mkdir()
    (tmp_path / name / "other.py").write_text(f"open({str(tmp_path / 'ran')!r}, 'w').close()\n")
    path = os.pathsep.join(filter(None, (str(tmp_path / "site"), os.environ.get("PYTHONPATH"))))
    file = sweep_file("{full: {}, kills: {losses: {fatal: {how: kill}}}, raises: {losses: {deadly: {}}}}")
    plugins = ("--allow-plugin", fatal, "--allow-plugin", name)
    words = ("ablate", file, "--out", tmp_path / "out", *plugins, "--quiet", "engine.workers=2")
    answer = fresh(*words, PYTHONPATH=path)
    assert answer.code == 1, answer.err
    assert "Failed: 2 of 3 trials." in answer.out
    assert (
        "- raises, builtin:static in builtin:courtyard, seed 0: loss 'deadly': expected values of shape (2,), it "
        "raised ArithmeticError: the loss has no answer" in answer.out
    )
    assert "- kills, builtin:static in builtin:courtyard, seed 0: its process was killed (out of memory?)" in answer.out
    assert not (tmp_path / "ran").exists()
    assert len(set(keys(tmp_path / "out"))) == len(keys(tmp_path / "out")) == 3
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path / "site")
    again = command(*words)
    for module in ("cl_deadly", _module(fatal)):
        _forget(module)
    told = "2 of 3 trials. 2 of them in an earlier run: --retry runs them again."
    assert (again.code, again.out) == (1, answer.out.replace("2 of 3 trials.", told))  # all from the ledger
    assert len(keys(tmp_path / "out")) == 3


@pytest.mark.usefixtures("in_process")
def test_runs_are_kept_when_asked_and_references_are_drawn_by_the_seed(
    command: Callable[..., Any], sweep_file: SweepFile, tmp_path: Path
) -> None:
    file = sweep_file("{full: {}}", "seeds: [0, 1]")
    out = tmp_path / "out"
    answer = command("ablate", file, "--out", out, "--keep-runs", "-q", *TINIER)
    assert answer.code == 0, answer.err
    drawn = [json.loads((out / "references" / f"push_in-{seed}-1.json").read_text()) for seed in (0, 1)]
    assert drawn[0] != drawn[1]
    assert len(lines(out)) == 2
    for line in lines(out):
        run = out / "runs" / line["key"]
        assert (run / "DONE").is_file()
        assert (run / "video" / "render.mp4").is_file()
        told = json.loads((run / "metrics.json").read_text())["metrics"]
        assert line["metrics"]["framing"]["mean"] > 0
        assert values_of(line["metrics"]) == values_of(told)


@pytest.mark.usefixtures("in_process")
def test_runs_that_are_to_be_kept_too_late_are_told(
    command: Callable[..., Any], sweep_file: SweepFile, tmp_path: Path
) -> None:
    words = ("ablate", sweep_file("{full: {}}"), "--out", tmp_path / "out", "-q", *TINIER)
    assert "--keep-runs" not in command(*words).out
    again = command(*words, "--keep-runs")
    assert again.out.endswith("note: 1 trials had been run without --keep-runs; another --out keeps them all\n")
    assert "Over every row, from the command line: `frames=1`, `search_side=32`, `output_side=32`." in again.out


@pytest.mark.usefixtures("in_process")
def test_rows_that_were_renamed_keep_their_own_figures(
    command: Callable[..., Any], sweep_file: SweepFile, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    means = []
    for names in (("one", "other"), ("other", "one"), ("one", "new")):
        rows = f"{{{names[0]}: {{}}, {names[1]}: {{engine: cma, generations: 1}}}}"
        answer = command("ablate", sweep_file(rows), "--out", out, "-q", *TINIER)
        assert answer.code == 0, answer.err
        found = json.loads((out / "summary.json").read_text())["rows"]
        assert [row["name"] for row in found] == list(names)
        means.append([row["metrics"]["framing"]["value"]["mean"] for row in found])
    assert means[0][0] != means[0][1]
    assert means[0] == means[1] == means[2]
    assert len(lines(out)) == 2  # nothing was run again


@pytest.mark.usefixtures("in_process")
def test_a_trial_that_another_run_may_tell_more_of_is_run_again(
    command: Callable[..., Any], sweep_file: SweepFile, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    words = ("ablate", sweep_file(ROWS), "--out", out, "-q", *TINIER)
    assert command(*words).code == 0
    ledger = out / "trials.jsonl"
    first, *others = ledger.read_text().splitlines()
    ledger.write_text("\n".join([first.replace('"lasts": true', '"lasts": false'), *others]) + "\n")
    assert command(*words).code == 0
    assert [line["key"] for line in lines(out)][3:] == [json.loads(first)["key"]]
    assert command(*words).code == 0
    assert len(lines(out)) == 4


@pytest.mark.parametrize("part", ["references", "references/pan-0-24.json", "runs", "runs/key/video", "trials.jsonl"])
def test_nothing_is_written_where_a_part_of_the_folder_leads_out_of_it(
    command: Callable[..., Any], sweep_file: SweepFile, tmp_path: Path, part: str
) -> None:
    elsewhere, out = tmp_path / "elsewhere", tmp_path / "out"
    elsewhere.write_text("mine")
    (out / part).parent.mkdir(parents=True)
    (out / "ablation.yaml").write_text("# made by: cltransfer ablate\n")
    (out / part).symlink_to(elsewhere)
    answer = command("ablate", sweep_file("{a: {}}"), "--out", out, "--keep-runs", "references=['drawn:pan']")
    assert answer.code == 3
    assert f"{out / part}: leads out of the folder of its ablation" in answer.err
    assert elsewhere.read_text() == "mine"


@pytest.mark.usefixtures("in_process")
def test_what_cannot_be_run_is_refused_before_anything_is_written(
    command: Callable[..., Any], sweep_file: SweepFile, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "out"
    missing = command("ablate", sweep_file("{a: {}}"), "--out", out, "references=[nowhere.mp4]")
    assert missing.code == 3
    assert "nowhere.mp4: no such file" in missing.err
    option = command("ablate", sweep_file("{a: {losses: {framing: {mode: wrong}}}}"), "--out", out)
    assert option.code == 2
    assert "tiny.yaml: rows.a: losses.framing.mode: expected one of robust, faithful, got 'wrong'" in option.err
    shot = command("ablate", sweep_file("{a: {}}"), "--out", out, "references=['drawn:moonwalk']")
    assert "shot 'moonwalk'" in shot.err
    shot = command("ablate", sweep_file("{a: {}}"), "--out", out, "references=['builtin:orbitt']")
    assert (shot.code, "shot 'orbitt': no such shot" in shot.err) == (2, True)
    assert not out.exists()
    typo = command("ablate", sweep_file("{a: {}}"), "--out", out, "references=['drawn:pan']", "scenes=[nope.ply]")
    assert "nope.ply: no such file" in typo.err
    out.mkdir(exist_ok=True)
    left = out / ".tmp-7-0123abcd-ablation.yaml"
    left.touch()  # by a sweep that was killed as it wrote
    assert command("ablate", sweep_file("{a: {}}"), "--out", out, "references=['drawn:pan']", "frames=1").code == 0
    assert not left.exists()
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "thesis.tex").write_text("")
    taken = command("ablate", sweep_file("{a: {}}"), "--out", tmp_path / "other")
    assert taken.code == 2
    assert "is neither empty nor an ablation" in taken.err
    own = sweep_file("{a: {}}")
    (own.parent / "ablation.yaml").write_text(own.read_text())
    replaced = command("ablate", own.parent / "ablation.yaml", "--out", own.parent)
    assert "is neither empty nor an ablation" in replaced.err
    assert (own.parent / "ablation.yaml").read_text() == own.read_text()
    monkeypatch.setattr("cltransfer.ablate.pool.PATIENCE", 0.5)
    nobody = command(
        "ablate",
        sweep_file("{a: {}}"),
        "--out",
        tmp_path / "d",
        "engine.backend=dask",
        "engine.address=tcp://256.0.0.1:1",
    )
    assert nobody.code == 5, nobody.err
    assert nobody.err.count("error:") == 1
