"""An ablation file: every row is a config, checked before anything runs; nothing outside its folder is named."""

from __future__ import annotations

import math
import os
import re
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import pytest

from cltransfer.ablate.read import ablations, read_sweep
from cltransfer.ablate.sources import check_sources
from cltransfer.config import load_config
from cltransfer.errors import CltransferError, InputError, UsageError
from cltransfer.run.initial import given_view
from cltransfer.scenes.load import load_scene

Written = Callable[[str], str]


@pytest.fixture
def written(tmp_path: Path) -> Written:
    def write(text: str) -> str:
        (tmp_path / "sweep.yaml").write_text(text)
        return str(tmp_path / "sweep.yaml")

    return write


MEASURED = "preset, output_side, extract, renderer, extractors, losses; say others in base or rows"
ROWS = "rows: {full: {}, none: {losses: {framing: null}}}\n"


@pytest.mark.parametrize("name", ablations())
def test_every_shipped_file_reads(name: str) -> None:
    sweep = read_sweep(name)
    assert sweep.file.about
    assert len(sweep.rows) > 1
    assert set(sweep.metrics.losses) == set(load_config().losses)


def test_what_the_issue_asks_for_is_shipped() -> None:
    wanted = {
        "leave_one_out",
        "faithful_robust",
        "losses_x_optimiser",
        "flow_layers",
        "key_joints",
        "renderer",
        "search",
    }
    assert {*wanted, "presets", "leave_one_out_paper"} <= set(ablations())
    assert len(read_sweep("leave_one_out").rows) == 6
    assert len(read_sweep("losses_x_optimiser").rows) == 4


@pytest.mark.parametrize(("name", "stands"), [("wide_lens", (2.0, 0.3)), ("wide_lens_far", (4.0, 0.15))])
def test_the_papers_rows_begin_at_views_that_their_file_tells(name: str, stands: tuple[float, float]) -> None:
    scene = read_sweep("leave_one_out_paper").file.scenes[0]
    file = Path(scene.init).with_stem(name)
    view, person = given_view(str(file)), load_scene(scene.scene).subject
    assert person is not None
    away = float((view.center[0] - person.anchor).norm()) / person.height
    cover = float(view.K[0, 1, 1]) / view.size[1] / away
    assert (away, cover) == pytest.approx(stands)
    assert math.degrees(float(view.vertical_fov[0])) == pytest.approx(80, abs=1)


@pytest.mark.parametrize("name", ["@" * 15_000 + ".json", "a.json@" * 1100 + "b.json", "#/" * 2000, "a:" * 2000])
def test_a_name_without_end_is_told_at_once(written: Written, name: str) -> None:
    begun, folder = (
        time.process_time(),
        written(f"references: ['{name}']\nscenes: ['builtin:plaza']\nrows: {{a: {{}}}}\n"),
    )
    with suppress(CltransferError, OSError):
        check_sources(read_sweep(folder))
    assert time.process_time() - begun < 5


def test_rows_lie_over_the_base_over_the_preset_and_the_command_line_over_all(written: Written) -> None:
    sweep = read_sweep(
        written("base: {preset: fast, frames: 5, steps: 2}\nrows: {a: {}, b: {steps: 3, losses: {framing: null}}}\n"),
        ["frames=7"],
    )
    first, second = (row.config for row in sweep.rows)
    assert (first.preset, first.frames, first.steps, first.threads) == ("fast", 7, 2, 1)
    assert (second.frames, second.steps) == (7, 3)
    assert set(first.losses) - set(second.losses) == {"framing"}
    assert set(sweep.metrics.losses) == set(first.losses)  # what a row leaves out is measured


def test_what_the_command_line_switches_off_is_off_in_every_row(written: Written) -> None:
    sweep = read_sweep(written("rows: {a: {}, b: {frames: 3, guard: true, lod: 2}}\n"), ["guard=false", "lod=0"])
    assert [(row.config.guard, row.config.lod) for row in sweep.rows] == [(False, 0)] * 2
    assert [(row["guard"], row["lod"]) for row in sweep.file.rows.values()] == [(False, 0)] * 2


def test_every_row_is_measured_by_the_renderer_of_the_base_or_of_the_metrics(written: Written) -> None:
    rows = "rows: {a: {}, b: {renderer: {nerf_grid: {}}}}\n"
    for base, renderer in (("", "gaussian_splats"), ("base: {renderer: {mesh: {}}}\n", "mesh")):
        assert list(read_sweep(written(base + rows)).metrics.renderer) == [renderer]
    sweep = read_sweep(written(rows + "metrics: {renderer: {gaussian_splats: {antialiased: false}}}\n"))
    assert sweep.metrics.renderer == {"gaussian_splats": {"antialiased": False}}


def test_the_command_line_lies_over_the_files_metrics_key_by_key(written: Written) -> None:
    file = written(ROWS + "metrics: {preset: fast, losses: {framing: {weight: 3}}}\nengine: {workers: 2}\n")
    sweep = read_sweep(file, ["metrics.losses.shot_size.weight=2"])
    assert sweep.metrics.preset == "fast"
    assert [sweep.metrics.losses[name]["weight"] for name in ("framing", "shot_size")] == [3, 2]


def test_what_the_metrics_say_lies_over_what_goes_on_top_of_every_row(written: Written) -> None:
    sweep = read_sweep(written(ROWS + "metrics: {preset: fast}\n"), ["preset=paper", "output_side=99"])
    assert {row.config.preset for row in sweep.rows} == {"paper"}
    assert (sweep.metrics.preset, sweep.metrics.output_side) == ("fast", 99)


def test_the_file_that_is_left_says_what_the_command_line_laid_over_every_row(written: Written) -> None:
    rows = "rows: {full: {}, paper: {preset: paper}, mesh: {scene: 'builtin:courtyard-0-mesh'}}\n"
    sweep = read_sweep(
        written(rows), ["frames=2", "losses.framing.weight=3", "extract.bias=frame", "engine.workers=2", "seeds=[4]"]
    )
    assert sweep.over == ("frames=2", "losses.framing.weight=3", "extract.bias=frame")
    assert sweep.judging == ("losses.framing.weight=3",)  # by which the rows are measured too
    again = read_sweep(written(sweep.to_yaml()))
    assert (again.rows, again.metrics) == (sweep.rows, sweep.metrics)
    assert {row.config.frames for row in again.rows} == {2}


BOXES = "rows: {orbit: {}, box: {frames: 3, search: {paper_box: {}}}, quick: {preset: fast}}\n"


def test_an_option_of_one_search_or_renderer_replaces_that_of_no_row(written: Written) -> None:
    sweep = read_sweep(written(BOXES), ["search.subject_orbit.nearest=0.6", "search.paper_box.angle=1.0"])
    found = [row.config.search for row in sweep.rows]
    assert found == [
        {"subject_orbit": {"nearest": 0.6}},
        {"paper_box": {"angle": 1.0}},
        {"subject_orbit": {"nearest": 0.6}},
    ]
    again = read_sweep(written(sweep.to_yaml()))
    assert (again.rows, again.metrics) == (sweep.rows, sweep.metrics)
    sweep = read_sweep(written(BOXES), ["search.paper_box.angle=1.0", "search.paper_box={}", "search.se3_jaws={}"])
    assert [row.config.search for row in sweep.rows] == [{"se3_jaws": {}}] * 3  # the last that is asked for everywhere
    sweep = read_sweep("renderer", ["renderer.mesh.samples=2"])
    assert [list(row.config.renderer) for row in sweep.rows] == [["gaussian_splats"], ["mesh"], ["nerf_grid"]]
    assert list(sweep.metrics.renderer) == ["gaussian_splats"]
    sweep = read_sweep(written(BOXES), ["search.se3_jaws.translation=2"])  # which no row has, so that all are to
    assert {name for row in sweep.rows for name in row.config.search} == {"se3_jaws"}


def test_an_option_on_top_of_every_row_brings_nothing_back_that_a_row_leaves_out(written: Written) -> None:
    sweep = read_sweep("key_joints", ["losses.shot_size.weight=20"])
    losses = {row.name: row.config.losses for row in sweep.rows}
    assert [losses[name]["shot_size"]["weight"] for name in ("key joints", "all joints")] == [20, 20]
    assert "shot_size" not in losses["pose matching"]
    sweep = read_sweep("leave_one_out", ["losses.framing.weight=20"])
    assert [row.name for row in sweep.rows if "framing" not in row.config.losses] == ["no framing"]
    assert sweep.metrics.losses["framing"]["weight"] == 20
    again = read_sweep(written(sweep.to_yaml()))
    assert (again.rows, again.metrics) == (sweep.rows, sweep.metrics)
    sweep = read_sweep("losses_x_optimiser", ["losses.framing.weight=20"])  # in whose presets some have no such loss
    assert [row.name for row in sweep.rows if "framing" in row.config.losses] == [
        "five losses, Adam",
        "five losses, CMA-ES",
    ]
    sweep = read_sweep(written("rows: {a: {losses: {framing: null}}, b: {steps: 3}}\n"), ["losses.framing={}"])
    assert all("framing" in row.config.losses for row in sweep.rows)  # which asks for it, in every row


def test_the_engine_of_a_run_and_that_of_the_sweep_are_told_apart(written: Written) -> None:
    sweep = read_sweep(written(ROWS), ["engine=cma", "frames=2"])
    assert {row.config.engine for row in sweep.rows} == {"cma"}
    assert sweep.file.engine.backend == "loky"
    sweep = read_sweep(written(ROWS), ["engine.backend=dask", "engine.address=tcp://127.0.0.1:8786", "seeds=[3,4]"])
    assert {row.config.engine for row in sweep.rows} == {"refine"}
    assert (sweep.file.engine.backend, sweep.file.engine.address) == ("dask", "tcp://127.0.0.1:8786")
    assert sweep.file.seeds == [3, 4]
    for words in (["engine=cma", "engine.workers=4"], ["engine.workers=4", "engine=cma"]):
        sweep = read_sweep(written(ROWS), words)
        assert {row.config.engine for row in sweep.rows} == {"cma"}
        assert sweep.file.engine.workers == 4


def test_a_cluster_is_the_command_lines_alone(written: Written, tmp_path: Path) -> None:
    cluster = ["engine.backend=dask", "engine.address=tcp://127.0.0.1:8786"]
    for said in ([], ["engine.workers=2"], cluster):
        with pytest.raises(UsageError, match="engine: a cluster is named on the command line"):
            read_sweep(written(f"{ROWS}engine: {{address: 'tcp://stranger:8786'}}\n"), said)
    with pytest.raises(UsageError, match=r"engine\.address: dask needs its scheduler's"):
        read_sweep(written(ROWS), cluster[:1])
    assert read_sweep(written(f"{ROWS}engine: {{backend: loky, workers: 3}}\n")).file.engine.workers == 3


def test_a_cluster_that_is_named_by_halves_is_refused_and_so_are_workers_beside_it(written: Written) -> None:
    cluster = ["engine.backend=dask", "engine.address=tcp://127.0.0.1:8786"]
    for said, line in (
        (cluster[1:], "engine.address: is a cluster's, and engine.backend is loky (add engine.backend=dask"),
        ([*cluster, "engine.workers=2"], "engine.workers: expected none beside a cluster, which has its own, got 2"),
    ):
        with pytest.raises(UsageError) as caught:
            read_sweep(written(ROWS), said)
        assert str(caught.value).startswith(f"command line: {line}")
    workers = f"{ROWS}engine: {{workers: 3}}\n"  # of whoever runs the file without a cluster
    assert read_sweep(written(workers), cluster).file.engine.backend == "dask"


def test_the_file_that_is_left_reads_back_whatever_ran_it(written: Written) -> None:
    on_cluster = read_sweep(written(ROWS), ["engine.backend=dask", "engine.address=tcp://127.0.0.1:8786"])
    here = read_sweep(written(ROWS), ["engine.workers=2"])
    for sweep in (on_cluster, here):
        again = read_sweep(written(sweep.to_yaml()))
        assert (again.rows, again.metrics) == (sweep.rows, sweep.metrics)
        assert again.file.engine.workers == sweep.file.engine.workers


REFUSED = {
    "rows: {}": "rows: expected name",
    "rows: {0.5: {}}": "rows: row names are text, got 0.5 (YAML takes yes, on and 1.10 for other things: text in",
    "rows: {a: {}, off: {steps: 3}}": "rows: row names are text, got false (YAML takes yes, on and 1.10 for other",
    "rows: {a: {}, '': {steps: 3}}": "rows: a row has no name, got '' (name it, as full: {})",
    "rows: {' ': {}}": "rows: a row has no name, got ' '",
    "rows: {a: 3}": "rows.a: expected overrides",
    "rows: {as it is: {}, none: {}}": "rows.none: is the same run as 'as it is'",
    "rows: {a: {lossses: {}}}": "rows.a: lossses: no such key (did you mean 'losses'?)",
    "rows: {a: {losses: {frame: {}}}}": "losses.frame: no such loss",
    "rows: {a: {losses: {framing: {weihgt: 3}}}}": "losses.framing.weihgt: no such option (did you mean 'weight'?)",
    "rows: {a: {frames: many}}": "sweep.yaml: rows.a: frames: expected a whole number or null, got 'many'",
    "rows: {a: {frames: 0}}": "frames: expected 1 to 2000",
    "rows: {a: {seed: 3}}": "seed: the sweep has its own",
    "rows: {a: {threads: 4}}": "rows.a: threads: a trial has one thread (say how many trials at once",
    "rows: {a: {}}\nmetrics: {search_side: 96}": "metrics.search_side: nothing is measured by it (it takes",
    "rows: {a: {}}\nmetrics: {frames: 3}": "metrics.frames: nothing is measured by it",
    "rows: {a: {}}\nmetrics: {extract: {bias: frame}}": "metrics.extract.bias: nothing is measured by it",
    "rows: {a: {}}\nmetrics: {sarch_side: 96}": "metrics: sarch_side: no such key (did you mean 'search_side'?)",
    "rows: {a: {}}\nmetrics: {seed: 1}": "metrics: seed: the sweep has its own",
    "rows: {a: {}}\nbase: {threads: 4}": "sweep.yaml: base: threads: a trial has one thread",
    "rows: {a: {base: other.yaml}}": "base: a base names no further base",
    "rows: {a: {}}\nseed: [1]": "seed: no such key (did you mean 'seeds'?)",
    "rows: {a: {}}\nseeds: []": "seeds: expected at least one",
    "rows: {a: {}}\nseeds: [1, 1]": "none twice",
    "rows: {a: {}}\nseeds: [-1]": "expected 0 or more",
    "rows: {a: {}}\nengine: {backend: threads}": "engine.backend: expected one of loky, dask, got 'threads'",
    "rows: {a: {}}\nbase: {frames: many}": "sweep.yaml: base: frames: expected a whole number or null",
    "rows: {a: {}}\nscenes: [{scene: a.ply, scne: 1}]": "scenes[0].scne: no such key (did you mean 'scene'?)",
    "rows: {a: {}}\nseeds: [x]": "seeds: expected a list of whole numbers, got ['x']",
    "rows: {a: {}}\nengine: {backend: dask}": "engine: a cluster is named on the command line, not in a file",
    "rows: {a: {}}\nengine: {backend: dask, address: 'tcp://h:1'}": "engine: a cluster is named on the command line",
    "rows: {a: {}}\nengine: {address: 'tcp://h:1'}": "engine: a cluster is named on the command line",
    "rows: {a: {}}\nreferences: clip.mp4": "references: expected a list",
    "rows: {a: {losses.framing.weight: 3}}": "rows.a: losses.framing.weight: no such key (write losses: {framing: {",
    "rows: {a: {}}\nreferences: [clip.mp4, drawn: orbit]": "references[1]: expected text, got {'drawn': 'orbit'}",
    "rows: {a: {}}\nreferences: [../clip.mp4]": "references: ../clip.mp4 leads out of the file's folder",
    "rows: {a: {}}\nreferences: [/etc/passwd]": "leads out of the file's folder",
    "rows: {a: {}}\nreferences: ['builtin:plaza@/etc/passwd']": "leads out of the file's folder",
    "rows: {a: {}}\nscenes: [{scene: a.ply, subject: ../subject.json}]": "leads out of the file's folder",
    "rows: {a: {scene: ../b.ply}}": "leads out of the file's folder",
    "rows: {a: {scene: {scne: b.ply}}}": "scene.scne: no such key (did you mean 'scene'?)",
    "rows: {a: {scene: {init: [1]}}}": "rows.a.scene.init: expected text, got [1]",
    "rows: {a: {scene: {subject: -1}}}": "rows.a.scene.subject: expected a file, or 0 or more, got -1",
    "rows: {a: {scene: {subject: true}}}": "rows.a.scene.subject: expected text or a whole number or null, got true",
    "rows: {a: {scene: {up: [0, 0, 0]}}}": "rows.a.scene.up: expected 3 finite numbers, not all 0, got [0.0, 0.0, 0.0]",
    "rows: {a: {}}\nscenes: [{scene: a.ply, up: [0, 1]}]": "scenes[0].up: expected 3 finite numbers, not all 0",
    "rows: {a: {}}\nscenes: [{scene: a.ply, up: [0, .nan, 1]}]": "scenes[0].up: expected 3 finite numbers, not all 0",
    "rows: {a: {}}\nscenes: [{up: [0, 0, 1]}]": "scenes[0].scene: is required (expected text)",
    "rows: {a: {}}\nscenes: [a.ply, null]": "scenes[1].scene: expected text, got null",
    "rows: {a: {scene: b.ply}}\nscenes: [a.ply, c.ply]": "stands in for one scene, the sweep has 2",
    "rows: {a: {frames: '${oc.env:HOME}'}}": "interpolation is not part of the grammar",
    'rows: {a: {frames: "\\x24{oc.env:HOME}"}}': "interpolation is not part of the grammar",
    'rows: {"\\x24{oc.env:HOME}": {}}': "interpolation is not part of the grammar",
    "rows: {a: !!python/object/apply:os.system ['true']}": "not a config",
    "[1, 2]": "expected a mapping",
}


@pytest.mark.parametrize("text", REFUSED)
def test_what_cannot_be_meant_is_refused_by_name(written: Written, text: str) -> None:
    with pytest.raises(UsageError) as caught:
        read_sweep(written(text))
    assert REFUSED[text] in str(caught.value)
    assert "sweep.yaml" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_what_is_wrong_on_the_command_line_is_named_there(written: Written) -> None:
    for override, line in (
        ("frames=many", "command line: frames: expected a whole number or null, got 'many'"),
        ("metrics.engine=cma", f"command line: metrics.engine: nothing is measured by it (it takes {MEASURED})"),
        ("metrics.losses.framng={}", "command line: metrics.losses.framng: no such loss (did you mean 'framing'?; a"),
        ("metrics.output_side=no", "command line: metrics.output_side: expected a whole number"),
        ("engine.workers=-1", "command line: engine.workers: expected 0 or more, got -1"),
        ("engine.backend=dask", "command line: engine.address: dask needs its scheduler's (as"),
        ("seeds=[-1]", "command line: seeds: expected 0 or more, got -1"),
        ("seeds=[1,1]", "command line: seeds: expected at least one, and none twice"),
        ("scenes=[]", "command line: scenes: expected at least one, and none twice"),
        ("seeds=[x]", "command line: seeds: expected a list of whole numbers, got ['x']"),
        ("reference=[a.mp4]", "command line: reference: no such key (did you mean 'references'?)"),
        ("metric.losses.framing=null", "command line: metric: no such key (did you mean 'metrics'?)"),
        ("base.frames=3", "command line: base: goes over every row by itself (leave out base., as in frames=3)"),
    ):
        with pytest.raises(UsageError) as caught:
            read_sweep(written(ROWS), [override])
        assert str(caught.value).startswith(line)


def test_what_is_wrong_in_the_file_is_named_there_whatever_the_command_line_says(written: Written) -> None:
    for text, line in (
        ("engine: {workers: -1}\n", "sweep.yaml: engine.workers: expected 0 or more"),
        ("metrics: {output_side: no}\n", "sweep.yaml: metrics: output_side: expected a whole number"),
    ):
        with pytest.raises(UsageError, match=re.escape(line)):
            read_sweep(written(f"{ROWS}{text}"), ["engine.backend=loky", "metrics.preset=fast", "frames=3"])


@pytest.mark.parametrize("name", ["clip.mp4", "'clip.mp4#t=1,2'", "builtin:plaza@clip.mp4", "clip.mp4@path.json"])
def test_a_link_that_leads_out_of_the_folder_is_refused(written: Written, tmp_path: Path, name: str) -> None:
    (tmp_path / "clip.mp4").symlink_to("/etc/hostname")
    with pytest.raises(UsageError, match="leads out"):
        read_sweep(written(f"rows: {{a: {{}}}}\nreferences: [{name}]\n"))


def test_a_link_to_itself_is_a_file_that_is_not_there(written: Written, tmp_path: Path) -> None:
    (tmp_path / "clip.mp4").symlink_to("clip.mp4")
    sweep = read_sweep(written("rows: {a: {}}\nreferences: [clip.mp4]\n"))
    with pytest.raises(InputError, match=r"clip\.mp4: no such file"):
        check_sources(sweep)


@pytest.mark.parametrize(
    "text",
    [
        r'rows: {a: {}}, references: ["a\0"]',
        r'rows: {a: {}}, scenes: ["a\0.ply"]',
        r'rows: {a: {scene: {init: "a\0#t=1"}}}',
    ],
)
def test_a_name_that_no_file_has_is_told(written: Written, text: str) -> None:
    with pytest.raises(UsageError, match=r"expected the name of a file \(got 'a\\x00"):
        read_sweep(written(f"{{{text}}}"))


def test_files_are_found_beside_the_file_and_from_the_command_line_anywhere(
    written: Written, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    name = written(
        ROWS + "references: [clips/a.mp4, 'builtin:orbit', 's.ply@t.json', 'a.mp4#t=1,2']\nscenes: [b.ply]\n"
    )
    monkeypatch.chdir(elsewhere)
    sweep = read_sweep(name)
    assert sweep.file.references == [
        str(tmp_path / "clips" / "a.mp4"),
        "builtin:orbit",
        f"{tmp_path / 's.ply'}@{tmp_path / 't.json'}",
        f"{tmp_path / 'a.mp4'}#t=1,2",
    ]
    assert sweep.file.scenes[0].scene == str(tmp_path / "b.ply")
    sweep = read_sweep(name, ["references=[c.mp4]", f"scenes=[{os.devnull}]"])
    assert sweep.file.references == [str(elsewhere / "c.mp4")]
    assert sweep.file.scenes[0].scene == os.devnull


def test_a_folder_with_an_at_in_its_name_holds_what_any_other_does(
    written: Written, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "a@b"
    folder.mkdir()
    for name in ("clip.mp4", "s.ply", "t.json"):
        (folder / name).touch()
    expected = [f"{folder}/clip.mp4#t=0,1", f"{folder}/s.ply@{folder}/t.json", f"builtin:plaza@{folder}/t.json"]
    relative = ["a@b/clip.mp4#t=0,1", "a@b/s.ply@a@b/t.json", "builtin:plaza@a@b/t.json"]
    assert read_sweep(written(f"{ROWS}references: {relative}\n")).file.references == expected
    monkeypatch.chdir(folder)
    inside = ["clip.mp4#t=0,1", "s.ply@t.json", "builtin:plaza@t.json"]
    for said in (inside, expected):
        assert read_sweep(written(ROWS), [f"references=[{','.join(map(repr, said))}]"]).file.references == expected


def test_a_rows_scene_that_names_none_is_the_sweeps_with_what_the_row_says(written: Written, tmp_path: Path) -> None:
    rows = "rows: {a: {}, b: {scene: {up: [0, 1, 0]}}, c: {scene: {scene: c.ply}}, d: {scene: d.ply}}\n"
    text = rows + "scenes: [{scene: a.ply, subject: person.json}]\n"
    found = [row.scene for row in read_sweep(written(text)).rows]
    named = [scene and (scene.scene, scene.subject, scene.up) for scene in found]
    assert named == [
        None,
        (str(tmp_path / "a.ply"), str(tmp_path / "person.json"), [0.0, 1.0, 0.0]),
        (str(tmp_path / "c.ply"), None, None),  # of another scene nothing is taken over
        (str(tmp_path / "d.ply"), None, None),
    ]
    outside = read_sweep(written(text), [f"scenes=[{os.devnull}]"]).rows[1].scene  # where the command line alone may be
    assert outside is not None
    assert outside.scene == os.devnull


def test_a_person_is_named_by_number_or_by_file(written: Written, tmp_path: Path) -> None:
    sweep = read_sweep(written("rows: {a: {}, b: {scene: {subject: '2'}}}\nscenes: [{scene: a.ply, subject: 1}]\n"))
    assert sweep.file.scenes[0].subject == 1
    assert [row.scene and row.scene.subject for row in sweep.rows] == [None, str(tmp_path / "2")]
    again = read_sweep(written(sweep.to_yaml()))
    assert (again.file.scenes, again.rows) == (sweep.file.scenes, sweep.rows)


def test_a_row_that_says_the_sweeps_scene_again_is_the_same_run(written: Written) -> None:
    with pytest.raises(UsageError, match=r"rows\.b: is the same run as 'a'"):
        read_sweep(written("rows: {a: {}, b: {scene: {init: auto}}}\nscenes: [a.ply]\n"))


def test_an_unknown_name_says_what_is_shipped() -> None:
    with pytest.raises(UsageError, match=r"no such ablation file \(did you mean 'leave_one_out'\?\)"):
        read_sweep("leave_one")
