"""A trial is run again only if something its outcome depends on has changed, wherever that lies."""

from __future__ import annotations

import pickle
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar

import pytest
import torch

from cltransfer.ablate import run
from cltransfer.ablate.drawn import draw_references
from cltransfer.ablate.outcome import Case, Metric, Outcome
from cltransfer.ablate.pool import outcomes
from cltransfer.ablate.read import read_sweep
from cltransfer.ablate.run import Options, ablate, markdown
from cltransfer.ablate.sources import check_sources
from cltransfer.ablate.sweep import EngineConfig, Sweep
from cltransfer.ablate.tables import failure_lines
from cltransfer.ablate.trial import Job, Trial, run_trial, trials
from cltransfer.clips.clip import write_video
from cltransfer.errors import ModelError, UsageError
from cltransfer.features import Features, OfThisRun
from cltransfer.models.content import read_by
from cltransfer.plugins import allow
from cltransfer.registry import EXTRACTORS, LOSSES
from cltransfer.registry.plugin_code import own_code
from cltransfer.shots import builtin_reference
from cltransfer.storage.files import content_hash
from cltransfer.storage.run_files import SUBJECT

PLUGIN = Path(__file__).parents[2] / "plugins" / "rule_of_thirds.py"

SWEEP = """
references: ['builtin:orbit']
base: {preset: fast, extractors: {depth_onnx: {model: depth.onnx, kind: disparity}}}
rows: {full: {}, none: {losses: {framing: null}}}
"""


@pytest.fixture
def keys(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., list[str]]:
    """Keys of a small sweep in a scene, networks read from the test's folder."""
    monkeypatch.setenv("CLTRANSFER_MODELS", str(tmp_path))

    def read(scene: str, base: str = "preset: fast") -> list[str]:
        (tmp_path / "sweep.yaml").write_text(SWEEP.replace("preset: fast", base) + f"scenes: ['{scene}']\n")
        return [trial.key for trial in trials(read_sweep(str(tmp_path / "sweep.yaml")), {})]

    return read


def test_another_network_of_the_same_name_is_another_trial(keys: Callable[..., list[str]], tmp_path: Path) -> None:
    seen = []
    for content in (b"first", b"second", b"first"):
        (tmp_path / "depth.onnx").write_bytes(content)
        seen.append(keys("builtin:courtyard"))
    assert seen[0] == seen[2] != seen[1]
    assert len(set(seen[0])) == 2


def test_a_clip_that_was_edited_since_is_another_trial(tmp_path: Path) -> None:
    (tmp_path / "sweep.yaml").write_text("references: [clip.mp4]\nrows: {full: {}}\n")
    sweep, seen = read_sweep(str(tmp_path / "sweep.yaml"), ["scenes=['builtin:courtyard']"]), []
    for content in (b"first", b"other", b"first"):
        (tmp_path / "clip.mp4").write_bytes(content)
        seen += [trial.key for trial in trials(sweep, {})]
    assert seen[0] == seen[2] != seen[1]


def test_each_file_is_read_once_for_all_its_trials(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "clip.mp4").write_bytes(b"clip")
    (tmp_path / "scene.ply").write_bytes(b"scene")
    (tmp_path / "shot.json").write_text("{}")
    rows, references = "{full: {}, none: {losses: {framing: null}}}", "[clip.mp4, scene.ply@shot.json]"
    (tmp_path / "sweep.yaml").write_text(f"references: {references}\nscenes: [scene.ply]\nrows: {rows}\n")
    read: list[str] = []

    def counted(path: Path) -> str:
        read.append(path.name)
        return content_hash(path)

    monkeypatch.setattr("cltransfer.ablate.content.content_hash", counted)
    assert len(trials(read_sweep(str(tmp_path / "sweep.yaml")), {})) == 4
    assert sorted(read) == ["clip.mp4", "scene.ply", "shot.json"]


def test_an_ablation_reads_each_file_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "clip.mp4").write_bytes(b"clip")
    (tmp_path / "scene.ply").write_bytes(b"scene")
    (tmp_path / "weights").mkdir()
    (tmp_path / "weights" / "w.pt").write_bytes(b"weights")
    base = f"{{extractors: {{weighted: {{weights: '{tmp_path}/weights'}}}}}}"
    told = f"references: [clip.mp4]\nscenes: [scene.ply]\nrows: {{full: {{}}}}\nseeds: [0, 1]\nbase: {base}\n"
    (tmp_path / "sweep.yaml").write_text(told)
    read: list[str] = []

    def counted(path: Path) -> str:
        read.append(path.name)
        return content_hash(path)

    def failed(trials: Sequence[Trial], *_: Any) -> Iterator[Outcome]:
        return (Outcome(t.key, t.row, t.case, failed="not run") for t in trials)

    monkeypatch.setitem(EXTRACTORS._classes, "weighted", Weighted)
    monkeypatch.setattr("cltransfer.ablate.run.outcomes", failed)
    monkeypatch.setattr("cltransfer.ablate.content.content_hash", counted)
    monkeypatch.setattr("cltransfer.models.content.content_hash", counted)
    assert ablate(read_sweep(str(tmp_path / "sweep.yaml")), Options(tmp_path / "out")).failed == 2
    assert sorted(read) == ["clip.mp4", "scene.ply", "weights", "weights"]  # those of the row, and of the metrics


def test_another_part_of_a_scene_is_another_trial(keys: Callable[..., list[str]], tmp_path: Path) -> None:
    (tmp_path / "scene.yaml").write_text("parts: [{file: wall.obj, label: scene}]\n")
    seen = []
    for height in (1, 2):
        (tmp_path / "wall.obj").write_text(f"v 0 0 0\nv 1 0 0\nv 0 {height} 0\nf 1 2 3\n")
        seen.append(keys("scene.yaml"))
    assert not set(seen[0]) & set(seen[1])


def test_a_plugin_that_was_edited_is_another_trial(
    keys: Callable[..., list[str]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(LOSSES._classes, "rule_of_thirds", object)  # to be as it was, and nothing else with it
    seen = []
    for comment in ("", "# edited"):
        LOSSES._classes.pop("rule_of_thirds", None)
        (tmp_path / "rule_of_thirds.py").write_text(PLUGIN.read_text() + comment)
        allow([tmp_path / "rule_of_thirds.py"])
        seen.append(keys("builtin:courtyard", "losses: {rule_of_thirds: {}}"))
    assert not set(seen[0]) & set(seen[1])


def test_a_worker_takes_a_plugin_anew_for_a_sweep_of_other_code_and_never_within_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(LOSSES._classes, "rule_of_thirds", object)  # to be as it was, and nothing else with it
    del LOSSES._classes["rule_of_thirds"]
    file, seen = tmp_path / "rule_of_thirds.py", []
    (tmp_path / "sweep.yaml").write_text("references: [none.mp4]\nscenes: ['builtin:courtyard']\nrows: {full: {}}\n")
    (trial,) = trials(read_sweep(str(tmp_path / "sweep.yaml")), {}, str)
    for edit, code in (("", "first"), ("# edited", "other"), ("# edited while that sweep runs", "other")):
        file.write_text(PLUGIN.read_text() + edit)
        assert "none.mp4" in run_trial(trial, Job((str(file),), codes=(code,))).failed
        seen.append(LOSSES.get("rule_of_thirds"))
    assert seen[0] is not seen[1]
    assert seen[1] is seen[2]


def test_a_plugin_that_was_edited_since_the_ablation_began_ends_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By its key the outcome would be that of the code before."""
    monkeypatch.setitem(LOSSES._classes, "rule_of_thirds", object)  # to be as it was, and nothing else with it
    del LOSSES._classes["rule_of_thirds"]
    file, rows = tmp_path / "rule_of_thirds.py", "{thirds: {losses: {rule_of_thirds: {}}}}"
    (tmp_path / "sweep.yaml").write_text(f"references: [none.mp4]\nscenes: ['builtin:courtyard']\nrows: {rows}\n")
    file.write_text(PLUGIN.read_text())
    allow([file])
    (trial,) = trials(read_sweep(str(tmp_path / "sweep.yaml")), {}, str)
    assert "none.mp4" in run_trial(trial, Job((str(file),), codes=("as it began",))).failed
    file.write_text(PLUGIN.read_text() + "# edited")
    with pytest.raises(ModelError, match="of an installed one in a new kernel, with new workers") as caught:
        run_trial(trial, Job((str(file),), codes=("in another worker",)))
    assert str(pickle.loads(pickle.dumps(caught.value))) == str(caught.value)  # it is raised in a worker
    file.write_text(PLUGIN.read_text())
    assert "none.mp4" in run_trial(trial, Job((str(file),), codes=("in another worker",))).failed  # taken back


def test_a_worker_of_other_code_packages_or_networks_ends_the_ablation(tmp_path: Path) -> None:
    """By its key the outcome would be that of the command's."""
    (tmp_path / "none.mp4").write_bytes(b"nothing to see")
    (tmp_path / "sweep.yaml").write_text("references: [none.mp4]\nscenes: ['builtin:courtyard']\nrows: {full: {}}\n")
    (trial,) = trials(read_sweep(str(tmp_path / "sweep.yaml")), {})
    assert "none.mp4" in run_trial(trial, Job(code=own_code(), readers=tuple(read_by()))).failed
    with pytest.raises(ModelError, match="other code of cltransfer than the command"):
        run_trial(trial, Job(code="that of another commit"))
    packages, others, networks = read_by()
    old = (packages, {**others, "numpy": "0.1"}, networks)
    with pytest.raises(ModelError, match=r"other packages than the command: numpy [\d.]+, not 0\.1 \(give every"):
        run_trial(trial, Job(readers=old))
    with pytest.raises(ModelError, match="other networks or files"):
        run_trial(replace(trial, files="with another network"), Job(code=own_code()))
    again = r"while the ablation ran \(run it again: what is done is kept\)$"
    with pytest.raises(ModelError, match=f"engine: the code of cltransfer was changed {again}"):
        run_trial(trial, Job(code="as it was before", elsewhere=False))
    with pytest.raises(ModelError, match=rf"engine: what pictures are read by was changed \(.*\) {again}"):
        run_trial(trial, Job(readers=old, elsewhere=False))
    with pytest.raises(ModelError, match=f"engine: a network or a file of a plugin was changed {again}"):
        run_trial(replace(trial, files="with another network"), Job(code=own_code(), elsewhere=False))
    with pytest.raises(ModelError, match="not_installed"):
        run_trial(trial, Job(("not_installed",), code=own_code()))
    (tmp_path / "none.mp4").write_bytes(b"edited since")
    with pytest.raises(ModelError, match=r"none\.mp4: engine: is not what it was when the ablation began"):
        run_trial(trial, Job(code=own_code()))
    (tmp_path / "none.mp4").unlink()
    with pytest.raises(ModelError, match=r"cannot be read here: .*none\.mp4: no such file \(scenes, references"):
        run_trial(trial, Job(code=own_code()))


def test_a_trial_of_other_code_or_packages_is_another(
    keys: Callable[..., list[str]], monkeypatch: pytest.MonkeyPatch
) -> None:
    here = keys("builtin:courtyard")
    with monkeypatch.context() as other:
        other.setattr("cltransfer.ablate.trial.own_code", lambda: "of another commit")
        assert not set(here) & set(keys("builtin:courtyard"))
    with monkeypatch.context() as other:
        other.setattr("cltransfer.ablate.trial.read_by", lambda: ["other packages"])
        assert not set(here) & set(keys("builtin:courtyard"))
    assert keys("builtin:courtyard") == here


@pytest.mark.parametrize(
    ("reference", "row", "reads"),
    [("builtin:orbit", "", False), ("clip.mp4", "", True), ("builtin:orbit", "extract: {inner: image}", True)],
)
def test_a_network_that_a_worker_lacks_matters_where_it_is_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, reference: str, row: str, reads: bool
) -> None:
    text = f"references: ['{reference}']\nscenes: ['builtin:courtyard']\nrows: {{full: {{{row}}}}}\n"
    (tmp_path / "sweep.yaml").write_text(text)
    (tmp_path / "models").mkdir()
    (tmp_path / "models" / "yolox_nano.onnx").write_bytes(b"")
    seen = []
    for place in ("models", "none"):
        monkeypatch.setenv("CLTRANSFER_MODELS", str(tmp_path / place))
        seen.append(trials(read_sweep(str(tmp_path / "sweep.yaml")), {}, str)[0].files)
    assert (seen[0] != seen[1]) == reads


def test_what_ends_an_ablation_on_a_worker_of_a_cluster_ends_it(tmp_path: Path) -> None:
    distributed = pytest.importorskip("distributed", reason="needs the extra cltransfer[cluster]")
    (tmp_path / "sweep.yaml").write_text("references: [none.mp4]\nscenes: ['builtin:courtyard']\nrows: {full: {}}\n")
    found = trials(read_sweep(str(tmp_path / "sweep.yaml")), {}, str)
    with distributed.LocalCluster(n_workers=1, processes=False, dashboard_address=None, silence_logs=50) as cluster:
        engine = EngineConfig(backend="dask", address=cluster.scheduler.address)
        run_all = outcomes(found, Job(code="that of another commit"), engine)
        with pytest.raises(ModelError, match="other code of cltransfer than the command"):
            next(run_all)


def test_workers_are_told_the_code_of_the_plugins_and_what_reads(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(LOSSES._classes, "rule_of_thirds", object)  # to be as it was, and nothing else with it
    del LOSSES._classes["rule_of_thirds"]
    allow([PLUGIN])
    told: list[Job] = []

    def noted(trials: Sequence[Trial], job: Job, *_: Any) -> Iterator[Outcome]:
        told.append(job)
        return (Outcome(t.key, t.row, t.case, failed="not run") for t in trials)

    monkeypatch.setattr("cltransfer.ablate.run.outcomes", noted)
    (tmp_path / "sweep.yaml").write_text("references: ['builtin:orbit']\nrows: {full: {}}\n")
    ablate(read_sweep(str(tmp_path / "sweep.yaml")), Options(tmp_path / "out"))
    assert content_hash(PLUGIN) in told[0].codes
    assert list(told[0].readers) == read_by()
    assert not told[0].elsewhere


@dataclass(frozen=True)
class Weighted:
    weights: str
    requires, provides, family = ("image",), ("emb",), "image"

    def __call__(self, now: Features, before: Features | None) -> Features:
        return now.having("emb", now.require("image").mean((1, 2, 3)))


def test_other_weights_of_a_plugin_are_another_trial(
    keys: Callable[..., list[str]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(EXTRACTORS._classes, "weighted", Weighted)
    monkeypatch.setattr(f"{__name__}.SWEEP", SWEEP.replace("{depth_onnx", "{weighted: {weights: w.pt}, depth_onnx"))
    seen = []
    for content in ("1", "100"):
        (tmp_path / "w.pt").write_text(content)
        seen.append(keys("builtin:courtyard"))
    assert not set(seen[0]) & set(seen[1])


def test_another_person_beside_a_trajectory_is_another_trial(
    keys: Callable[..., list[str]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "shot.json").write_text("{}")
    monkeypatch.setattr(f"{__name__}.SWEEP", SWEEP.replace("builtin:orbit", "builtin:plaza@shot.json"))
    seen = []
    for person in (None, "{}", "{ }"):
        if person is not None:
            (tmp_path / SUBJECT).write_text(person)
        seen.append(keys("builtin:courtyard"))
    assert not set(seen[0]) & set(seen[1])
    assert not set(seen[1]) & set(seen[2])


def test_another_person_by_number_is_another_trial_that_is_told_whom_to_film(tmp_path: Path) -> None:
    seen = []
    for subject in ("null", "0", "1"):
        scenes = f"scenes: [{{scene: 'builtin:courtyard', subject: {subject}}}]"
        base = "{preset: fast, frames: 1, search_side: 32, output_side: 32}"
        text = f"references: ['builtin:static']\n{scenes}\nbase: {base}\nrows: {{full: {{}}}}\n"
        (tmp_path / "sweep.yaml").write_text(text)
        seen += trials(read_sweep(str(tmp_path / "sweep.yaml")), {})
    assert len({trial.key for trial in seen}) == 3
    assert dict(seen[2].sources).keys() == {"builtin:courtyard", "auto", "builtin:static"}  # a number is no source
    assert "this scene tells its person itself, nobody is lifted" in run_trial(seen[2], Job(code=own_code())).failed


def test_a_drawn_reference_is_a_trial_wherever_the_ablation_lies(tmp_path: Path) -> None:
    (tmp_path / "a@b").mkdir()
    (tmp_path / "a@b" / "sweep.yaml").write_text("references: ['drawn:pan']\nbase: {frames: 2}\nrows: {full: {}}\n")
    sweep = read_sweep(str(tmp_path / "a@b" / "sweep.yaml"))
    check_sources(sweep)
    (trial,) = trials(sweep, draw_references(sweep, tmp_path / "a@b" / "out"))
    assert trial.reference == f"builtin:plaza-0@{tmp_path / 'a@b' / 'out' / 'references' / 'pan-0-2.json'}"


def test_a_case_is_shown_without_its_folders_whatever_they_are_called(tmp_path: Path) -> None:
    (tmp_path / "a@b").mkdir()
    for name in ("s.ply", "t.json", "clip.mp4"):
        (tmp_path / "a@b" / name).write_text("{}")
    references = ["a@b/s.ply@a@b/t.json", "builtin:plaza@a@b/t.json", "a@b/clip.mp4"]
    (tmp_path / "sweep.yaml").write_text(f"references: {references}\nrows: {{full: {{}}}}\n")
    sweep = read_sweep(str(tmp_path / "sweep.yaml"))
    check_sources(sweep)
    assert [t.case.reference for t in trials(sweep, {})] == ["s.ply@t.json", "builtin:plaza@t.json", "clip.mp4"]


def test_no_two_cases_have_one_name(tmp_path: Path) -> None:
    for folder in ("a", "b"):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "clip.mp4").write_bytes(folder.encode())
    (tmp_path / "scene.ply").write_bytes(b"")
    (tmp_path / "sweep.yaml").write_text(
        "references: [a/clip.mp4, b/clip.mp4, 'builtin:orbit']\n"
        "scenes: [scene.ply, {scene: scene.ply, up: [0, 1, 0]}]\nrows: {full: {}}\n"
    )
    found = trials(read_sweep(str(tmp_path / "sweep.yaml")), {})
    assert len({trial.case for trial in found}) == len(found) == 6
    assert {trial.case.reference for trial in found} == {"clip.mp4 (1)", "clip.mp4 (2)", "builtin:orbit"}
    assert {trial.case.scene for trial in found} == {"scene.ply (1)", "scene.ply (2)"}


def test_a_numbered_name_is_not_that_of_another_clip(tmp_path: Path) -> None:
    for name in ("a/clip.mp4", "b/clip.mp4", "clip.mp4 (1)"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(name)
    text = "references: [a/clip.mp4, b/clip.mp4, 'clip.mp4 (1)']\nrows: {full: {}}\n"
    (tmp_path / "sweep.yaml").write_text(text)
    shown = [t.case.reference for t in trials(read_sweep(str(tmp_path / "sweep.yaml")), {})]
    assert shown == ["clip.mp4 (2)", "clip.mp4 (3)", "clip.mp4 (1)"]


def test_one_clip_by_two_names_is_refused(tmp_path: Path) -> None:
    for name in ("a.mp4", "b.mp4"):
        (tmp_path / name).write_text("the same")
    (tmp_path / "sweep.yaml").write_text("references: [a.mp4, b.mp4]\nrows: {full: {}}\n")
    with pytest.raises(UsageError, match=r"references: b.mp4 in builtin:courtyard is the same as a.mp4 in "):
        trials(read_sweep(str(tmp_path / "sweep.yaml")), {})


def test_another_sweep_in_the_folder_leaves_the_references_alone(tmp_path: Path) -> None:
    (tmp_path / "sweep.yaml").write_text("references: ['drawn:pan']\nrows: {full: {}}\n")
    one, other = (read_sweep(str(tmp_path / "sweep.yaml"), [f"frames={count}"]) for count in (4, 2))
    drawn = draw_references(one, tmp_path / "out")
    (before,) = trials(one, drawn)
    draw_references(other, tmp_path / "out")
    assert trials(one, drawn)[0].key == before.key  # what a trial begun before will read is what its key says


def outcome(trial: Trial, reason: str = "") -> Outcome:
    found = {} if reason else {"metrics": {"total": Metric(1.0, "", 2, "")}, "frames": 2}
    return Outcome(
        trial.key, trial.row, trial.case, failed=reason, directions={"larger": Metric(0.1, "frame", 2, "")}, **found
    )


@pytest.fixture
def sweep(tmp_path: Path) -> Callable[..., Sweep]:
    (tmp_path / "sweep.yaml").write_text(
        "references: ['drawn:orbit']\nrows: {full: {}, none: {losses: {framing: null}}}\n"
    )
    return lambda *words: read_sweep(str(tmp_path / "sweep.yaml"), list(words))


def test_an_old_failure_is_told_as_one(sweep, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(run, "outcomes", lambda missing, *rest: (outcome(t, "yolox: no such file") for t in missing))
    first, again = (markdown(ablate(sweep("frames=2"), Options(tmp_path / "out"))) for _ in range(2))
    assert "--retry" not in "\n".join(first)
    assert "Failed: 2 of 2 trials. 2 of them in an earlier run: --retry runs them again." in again


def test_what_failed_is_run_again_only_when_it_is_asked_for(
    sweep, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[list[str]] = []

    def outcomes(missing: Sequence[Trial], *rest: Any) -> Iterator[Outcome]:
        asked.append([t.key for t in missing])
        return (outcome(t, "out of memory" if len(asked) == 1 and t.row == "none" else "") for t in missing)

    monkeypatch.setattr(run, "outcomes", outcomes)
    plain, retry = Options(tmp_path / "out"), Options(tmp_path / "out", retry=True)
    found = [ablate(sweep("frames=2"), options) for options in (plain, plain, retry, retry)]
    (failed,) = (o.key for o in found[0].outcomes if o.failed)
    assert len(asked[0]) == 2
    assert asked[1:] == [[], [failed], []]
    assert [(one.failed, one.old) for one in found] == [(1, 0), (1, 1), (0, 0), (0, 0)]


def test_tables_of_the_sweep_before_are_gone_when_another_is_killed(
    sweep, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(run, "outcomes", lambda missing, *rest: map(outcome, missing))
    ablate(sweep("frames=2"), Options(tmp_path / "out"))
    assert "larger" in (tmp_path / "out" / "table.tex").read_text()
    ablate(sweep("frames=2"), Options(tmp_path / "out"))
    ablate(sweep("frames=2", "engine.workers=3"), Options(tmp_path / "out"))
    assert not caplog.messages

    def killed(*words: Any) -> Iterator[Outcome]:
        raise KeyboardInterrupt

    monkeypatch.setattr(run, "outcomes", killed)
    with pytest.raises(KeyboardInterrupt):
        ablate(sweep("frames=3"), Options(tmp_path / "out"))
    assert not list((tmp_path / "out").glob("table.*"))  # ablation.yaml beside them is of the other sweep
    assert [message.partition(": ")[2][:34] for message in caplog.messages] == ["the tables of another sweep are re"]


def test_names_and_reasons_below_a_table_stay_text() -> None:
    (line,) = failure_lines([Outcome("k", "<b>x", Case("s", "r", 0), failed="ValueError: a\n\n# b")])
    assert line == "- &lt;b>x, r in s, seed 0: ValueError: a  # b"


@dataclass(frozen=True)
class Late:
    """Flow of whole clips; in the turn of ``late`` its time runs out."""

    late: ClassVar[list[int]] = []
    turns: ClassVar[list[int]] = []

    requires: ClassVar[tuple[str, ...]] = ("image",)
    provides: ClassVar[tuple[str, ...]] = ("flow",)
    family: ClassVar[str] = "image"
    whole_clip: ClassVar[bool] = True

    def read_clip(self, found: Features, load: Callable[[int, int], Features]) -> Features:
        self.turns.append(len(self.turns))
        if self.turns[-1] in self.late:
            return replace(found, reasons={"flow": OfThisRun("time ran out")})
        image = load(0, len(found)).require("image")
        return replace(found, flow=image[:, :2] - image[:, 1:])


@pytest.mark.parametrize(("seed", "late"), enumerate([[], [1], [3]]))  # of the transfer's render, of the measured one
def test_a_trial_lasts_where_time_ran_out_of_none_of_its_renders(
    mean_flow: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, seed: int, late: list[int]
) -> None:
    """Each clip is another, which no test before has left in the cache."""
    monkeypatch.setitem(EXTRACTORS._classes, "late", Late)
    monkeypatch.setattr(Late, "late", late)
    monkeypatch.setattr(Late, "turns", [])
    image = torch.randint(256, (2, 3, 27, 48), generator=torch.Generator().manual_seed(seed), dtype=torch.uint8)
    write_video(tmp_path / "a.mkv", image, torch.arange(2).double() / 8, lossless=True)
    builtin_reference("static", (48, 27), 1)[1].save(tmp_path / "view.json")
    scenes = f"[{{scene: 'builtin:plaza', init: '{tmp_path}/view.json'}}]"
    (tmp_path / "sweep.yaml").write_text(f"references: [{tmp_path}/a.mkv]\nscenes: {scenes}\nrows: {{full: {{}}}}\n")
    small = ("preset=fast", "frames=2", "search_side=48", "output_side=48", "steps=1")
    told = (*mean_flow, *small, "extractors.flow_dis=null", "extractors.late={}")
    (trial,) = trials(read_sweep(str(tmp_path / "sweep.yaml"), told), {})
    outcome = run_trial(trial, Job())
    assert (outcome.failed, Late.turns) == ("", [0, 1, 2, 3])  # the reference once, a view that is held too
    assert outcome.lasts is (not late)
