"""One grammar, checked before anything heavy is imported."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from cltransfer.config import load_config, presets, to_yaml
from cltransfer.config.layers import merge, parse_overrides
from cltransfer.config.options import RunConfig
from cltransfer.errors import UsageError


def test_every_shipped_preset_loads_and_builds() -> None:
    for name in presets():
        config = load_config(overrides=[f"preset={name}"])
        assert config.preset == name
        for section in ("renderer", "extractors", "losses", "search"):
            assert config.build(section)


def test_balanced_is_the_default() -> None:
    assert load_config().preset == "balanced"


def test_overrides_win_over_the_file_and_the_file_over_the_preset(tmp_path: Path) -> None:
    file = tmp_path / "run.yaml"
    file.write_text("generations: 7\npopsize: 6\n")
    config = load_config(file, ["generations=3"])
    assert (config.generations, config.popsize) == (3, 6)


def test_a_shipped_file_goes_by_its_name() -> None:
    file = Path(__file__).parents[2] / "configs" / "networks" / "paper.yaml"
    assert load_config("networks/paper") == load_config(file)


@pytest.mark.parametrize(
    ("name", "hint"),
    [
        ("networks/papr", "did you mean 'networks/paper'?"),
        ("networks/paper.yml", "did you mean 'networks/paper'?"),
        ("balancd", "did you mean 'balanced'?"),
        ("ablations/presets", "known: "),
        ("nope.yaml", "known: balanced, "),
    ],
)
def test_a_file_that_is_not_there_is_answered_with_the_nearest_that_is_shipped(name: str, hint: str) -> None:
    with pytest.raises(UsageError) as caught:
        load_config(name)
    assert str(caught.value).startswith(f"{name}: no such file (")
    assert hint in str(caught.value)


def test_base_names_one_parent_and_null_removes(tmp_path: Path) -> None:
    (tmp_path / "full.yaml").write_text("losses: {framing: {weight: 2.0}}\n")
    child = tmp_path / "no_framing.yaml"
    child.write_text("base: full.yaml\nlosses: {framing: null}\n")
    assert "framing" not in load_config(child).losses
    (tmp_path / "full.yaml").write_text("base: other.yaml\n")
    with pytest.raises(UsageError, match="a base names no further base"):
        load_config(child)


@pytest.mark.parametrize(
    "removed", [["losses.filmic_space=null"], ["extractors.scene_flow=null", "search.paper_box={}"]]
)
def test_what_is_written_reads_back_without_what_was_removed(tmp_path: Path, removed: list[str]) -> None:
    config = load_config(overrides=["preset=fast", *removed])
    (tmp_path / "run.yaml").write_text(to_yaml(config))
    assert load_config(tmp_path / "run.yaml") == config


@pytest.mark.parametrize(
    ("file", "again", "section"),
    [
        ("{preset: paper, losses: {framing: null}}", "losses.framing={}", "losses"),
        ("{preset: paper, losses: {camera_movement: null}}", "losses.camera_movement.mode=robust", "losses"),
        ("{preset: jaws_code, search: {paper_box: {}}}", "search.se3_jaws={}", "search"),
    ],
)
def test_what_was_removed_and_is_named_again_reads_back_with_its_defaults(
    tmp_path: Path, file: str, again: str, section: str
) -> None:
    (tmp_path / "mine.yaml").write_text(file)
    config = load_config(tmp_path / "mine.yaml", [again])
    (tmp_path / "run.yaml").write_text(to_yaml(config))
    assert load_config(tmp_path / "run.yaml").build(section) == config.build(section)


def test_a_config_that_sets_every_key_takes_no_other_preset(tmp_path: Path) -> None:
    run, child = tmp_path / "config.yaml", tmp_path / "child.yaml"
    run.write_text(to_yaml(load_config()))
    assert load_config(run, ["preset=balanced", "frames=3"]).frames == 3
    told = f"expected balanced, of which {run} sets every key, got paper (leave that file out, or set the keys)"
    with pytest.raises(UsageError) as caught:
        load_config(run, ["preset=paper"])
    assert str(caught.value) == f"command line: preset: {told}"
    child.write_text("base: config.yaml\npreset: paper\n")
    with pytest.raises(UsageError) as caught:
        load_config(child)
    assert str(caught.value) == f"{child}: preset: {told}"
    run.write_text("preset: balanced\ngenerations: 7\n")
    assert load_config(run, ["preset=paper"]).preset == load_config(child).preset == "paper"


def test_a_base_outside_the_neighbourhood_is_refused(tmp_path: Path) -> None:
    inner = tmp_path / "a" / "b"
    inner.mkdir(parents=True)
    (tmp_path / "secret.yaml").write_text("seed: 1\n")
    (inner / "run.yaml").write_text("base: ../../secret.yaml\n")
    with pytest.raises(UsageError, match="expected a file in this folder or the one above"):
        load_config(inner / "run.yaml")


def test_a_base_that_is_a_link_to_itself_is_not_there(tmp_path: Path) -> None:
    (tmp_path / "loop.yaml").symlink_to("loop.yaml")
    (tmp_path / "run.yaml").write_text("base: loop.yaml\n")
    with pytest.raises(UsageError, match=r"base: loop\.yaml: no such file"):
        load_config(tmp_path / "run.yaml")


@pytest.mark.parametrize(
    ("base", "message"),
    [
        ("nothere.yaml", "nothere.yaml: no such file (name one in this folder or the one above)"),
        (".", ".: expected a file, got a folder (name one in this folder or the one above)"),
        ('""', "expected the name of a file (got '')"),
        ('"a\\0"', "expected the name of a file (got 'a\\x00')"),
        ("[a]", "expected the name of a file (got ['a'])"),
        ("3", "expected the name of a file (got 3)"),
        ("//host/share/a.yaml", "expected a file in this folder or the one above (got //host/share/a.yaml)"),
        (r"'\\host\share\a.yaml'", r"expected a file in this folder or the one above (got \\host\share\a.yaml)"),
    ],
)
def test_a_base_that_is_no_file_is_told_with_the_file_and_key_that_name_it(
    tmp_path: Path, base: str, message: str
) -> None:
    (tmp_path / "run.yaml").write_text(f"base: {base}\n")
    with pytest.raises(UsageError) as caught:
        load_config(tmp_path / "run.yaml")
    assert str(caught.value) == f"{tmp_path / 'run.yaml'}: base: {message}"


def test_a_key_as_the_command_line_has_it_is_told_as_a_file_has_it(tmp_path: Path) -> None:
    (tmp_path / "run.yaml").write_text("losses.framing.weight: 3\n")
    with pytest.raises(UsageError) as caught:
        load_config(tmp_path / "run.yaml")
    told = "losses.framing.weight: no such key (write losses: {framing: {weight: ...}})"
    assert str(caught.value) == f"{tmp_path / 'run.yaml'}: {told}"


def test_naming_another_search_replaces_the_one_below() -> None:
    assert list(load_config(overrides=["search.paper_box={}"]).search) == ["paper_box"]


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("generatons=3", "did you mean 'generations'"),
        ("losses.framin={}", "did you mean 'framing'"),
        ("losses.framing.weigh=3", "did you mean 'weight'"),
        ("extract.iner=image", "extract.iner: no such key (did you mean 'inner'?)"),
        ("preset=balancd", "did you mean 'balanced'"),
        ("generations=many", "command line: generations: expected a whole number, got 'many'"),
        ("generations=0", "expected 1 to 1000000, got 0"),
        ("popsize=2", "expected 4 to 10000, got 2"),
        ("extract.corrections=-5", "command line: extract.corrections: expected 0 to 20, got -5"),
        ("extract.corrections=1000000000", "extract.corrections: expected 0 to 20, got 1000000000"),
        ("extract.inner=telepathy", "expected one of geometric, image, got 'telepathy'"),
        ("adam=3", "command line: adam: expected a mapping of keys to values, got 3"),
        ("generations=???", "generations: is required"),
        ("losses.framing=3", "expected options as a mapping"),
        ("losses=3", "expected name: {options}"),
        ("base=full.yaml", "base: expected in a file, which it lies below (use --config FILE or preset=NAME)"),
        ("seed=${oc.env:HOME}", "interpolation is not part of the grammar"),
        (
            "seed=010",
            "seed: YAML reads 010 in base 8 (write a number without leading zeros and colons, and text in quotes",
        ),
        ("popsize=1:30", "popsize: YAML reads 1:30 in base 60"),
        ("losses={framing: {weight: 1:30.5}}", "losses: YAML reads 1:30.5 in base 60"),
        ("seed=2024-13-01", "seed: not a YAML value: 2024-13-01"),
        ("seed=!!bool x", "seed: not a YAML value: !!bool x"),
        ("losses={framing: {weight: 1, weight: 2}}", "losses: expected each key once, 'weight' is there twice"),
        ("losses=[{a: [{b: 1, b: 2}]}]", "losses: expected each key once, 'b' is there twice"),
        (f"losses={'[' * 5000}", "losses: expected at most"),
        ("seed=&a 3", "seed: expected no anchors and aliases"),
        ("guard=7", "command line: guard: expected true or false, got 7"),
        ("frames", "expected key=value"),
        ("renderer.gaussian_splats=null", "expected exactly one, got 0"),
        ("losses.shot_size._target_=os.system", "no such option"),
        ("losses.shot_size.weight=2020-01-01", "losses.shot_size.weight: expected a number, text, true, false, null,"),
        ("losses={shot_size: {weight: [!!set {a}]}}", "losses: expected a number, text, true, false, null, a list or"),
    ],
)
def test_a_mistake_is_named_with_what_was_meant(override: str, message: str) -> None:
    with pytest.raises(UsageError) as caught:
        load_config(overrides=[override])
    assert message.lower() in str(caught.value).lower()
    assert "\n" not in str(caught.value)


def test_a_part_of_what_was_said_not_to_be_there_is_refused() -> None:
    line = "command line: losses.framing: expected losses as a mapping, losses=null before it says that there is none "
    with pytest.raises(UsageError, match=f"^{line}"):
        parse_overrides(["losses=null", "losses.framing={}"])
    with pytest.raises(UsageError, match=r"^command line: seed.low: expected seed as a mapping, seed=3 before it"):
        parse_overrides(["seed=3", "seed.low=1"])


@pytest.mark.parametrize(
    ("said", "hint"),
    [
        (["losses=null", "losses.framing={}"], "losses.NAME=null, one by one"),
        (["metrics.losses=null", "metrics.losses.framing={}"], "metrics.losses.NAME=null, one by one"),
        (["losses.framing=null", "losses.framing.weight=3"], "leave one of them out"),
        (["seed=3", "seed.low=1"], "leave one of them out"),
    ],
)
def test_what_to_say_in_place_of_a_part_of_nothing_is_a_key_that_there_is(said: list[str], hint: str) -> None:
    with pytest.raises(UsageError) as caught:
        parse_overrides(said)
    assert str(caught.value).endswith(f" ({hint})")


@pytest.mark.parametrize(
    ("said", "search"),
    [
        (["search.paper_box={}", "search.se3_jaws={}"], {"se3_jaws": {}}),
        (["search.paper_box.angle=1.0", "search.se3_jaws.translation=2"], {"se3_jaws": {"translation": 2}}),
        (["search={paper_box: {}}", "search.paper_box.angle=1.0"], {"paper_box": {"angle": 1.0}}),
        (["search.se3_jaws=null", "search.paper_box={}", "search.se3_jaws={}"], {"se3_jaws": {}}),
    ],
)
def test_of_two_searches_on_the_command_line_the_last_one_counts(said: list[str], search: dict[str, Any]) -> None:
    assert load_config(overrides=said).search == search


def test_only_a_section_holds_one_component_and_not_an_option_of_its_name() -> None:
    said = [
        "losses.nest.search.width=2",
        "losses.nest.search={steps: 4}",
        "search.subject_orbit={}",
        "search.paper_box={}",
    ]
    assert parse_overrides(said) == {
        "losses": {"nest": {"search": {"width": 2, "steps": 4}}},
        "search": {"paper_box": {}},
    }
    below = {"losses": {"nest": {"search": {"steps": 3}}}, "search": {"subject_orbit": {}}}
    above = {"losses": {"nest": {"search": {"width": 2}}}, "search": {"paper_box": {}}}
    assert merge(below, above) == {
        "losses": {"nest": {"search": {"steps": 3, "width": 2}}},
        "search": {"paper_box": {}},
    }
    assert merge({"metrics": below}, {"metrics": above})["metrics"]["search"] == {"paper_box": {}}


def test_what_only_resembles_a_number_of_another_base_is_read() -> None:
    for text, value in (("0", 0), ("1_000", 1000), ("0x1f", 31)):
        assert load_config(overrides=[f"seed={text}"]).seed == value
    assert load_config(overrides=["lod=00.5"]).lod == 0.5
    for text in ("'010'", "clip.mp4#t=1:30", "0.5:30x"):
        assert parse_overrides([f"references=[{text}]"]) == {"references": [text.strip("'")]}


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a: [", "not a config"),
        ("frames: 3\n\tseed: 2\n", "line 2: a tab, expected spaces"),
        ("losses:\n\tframing: {}\n", "line 2: a tab, expected spaces"),
        ("losses:\n  framing:\n  \tweight: 2\n  \tmode: robust\n", ": a tab, expected spaces"),
        ("losses: {\n\tframing: {}}\na: [", "not a config"),
        ("- 1\n- 2\n", "expected a mapping"),
        ("seed: !!python/object/apply:os.system ['true']\n", "not a config"),
        ("seed: ${seed}\n", "interpolation"),
        ("seed: 1\nseed: 2\n", "not a config: while constructing a mapping"),
        ("3\n", "not a config: expected keys with values, each a number, text,"),
        ("seed: -0_10\n", "YAML reads -0_10 in base 8"),
        ("null: 1\n", "not a config: expected keys with values, each a number, text,"),
        ("losses: !!set {framing}\n", "not a config: expected keys with values, each a number, text,"),
        ("x" * (2**20 + 1), "expected at most"),
    ],
)
def test_a_hostile_file_is_refused_in_one_line(tmp_path: Path, text: str, message: str) -> None:
    file = tmp_path / "bad.yaml"
    file.write_text(text)
    with pytest.raises(UsageError) as caught:
        load_config(file)
    assert message in str(caught.value)
    assert str(file) in str(caught.value)


BUILT = {
    "losses.framing.weight=heavy": "losses.framing.weight: expected a number, got 'heavy'",
    "losses.framing.weight=.inf": "losses.framing.weight: expected a finite number, got inf",
    "extractors.depth_onnx={model: a.onnx, kind: disparity, align: metric, affine: [1, nan]}": (
        "extractors.depth_onnx.affine[1]: expected a finite number, got nan"
    ),
    "extractors.depth_onnx={model: a.onnx, kind: disparity, align: metric, affine: [1, .inf]}": (
        "extractors.depth_onnx.affine[1]: expected a finite number, got inf"
    ),
    "losses.filmic_space.min_area=2": "losses.filmic_space.min_area: min_area must be in [0, 1], got 2.0",
    "extractors.depth_onnx={}": "extractors.depth_onnx.model: is required (expected text)",
    "extractors.depth_onnx={model: a.onnx}": "depth_onnx.kind: is required (expected one of disparity, depth)",
    "extractors.layers.near_quantile=null": "extractors.layers.near_quantile: expected a number, got null",
    "renderer.gaussian_splats.threads=[1]": "renderer.gaussian_splats.threads: expected a whole number, got [1]",
    "search.subject_orbit.nearest=-1": "search.subject_orbit: expected 0 < nearest < farthest, got -1.0 and 30.0",
}


@pytest.mark.parametrize("override", BUILT)
def test_an_option_that_does_not_fit_is_named_as_it_is_written(override: str) -> None:
    with pytest.raises(UsageError) as caught:
        load_config(overrides=[override]).build(override.partition(".")[0])
    assert str(caught.value).startswith("command line: ")
    assert str(caught.value).endswith(BUILT[override])


def test_an_error_names_the_place_where_the_option_was_written_last(tmp_path: Path) -> None:
    full, child = tmp_path / "full.yaml", tmp_path / "child.yaml"
    full.write_text("losses: {framing: {weight: heavy}}\n")
    child.write_text("base: full.yaml\nlosses: {framing: {mode: faithful}}\n")
    above = tmp_path / "above.yaml"
    above.write_text("base: full.yaml\nlosses: {framing: {weight: large}}\n")
    for place, file, overrides, value in (
        (full, child, [], "heavy"),
        (above, above, ["losses.framing.mode=robust"], "large"),
        ("command line", above, ["losses.framing.weight=huge"], "huge"),
    ):
        with pytest.raises(UsageError) as caught:
            load_config(file, overrides).build("losses")
        assert str(caught.value) == f"{place}: losses.framing.weight: expected a number, got {value!r}"


def test_what_was_written_nowhere_names_no_place() -> None:
    with pytest.raises(UsageError, match=r"^losses\.framing\.weight: expected a number, got 'heavy'$"):
        RunConfig(losses={"framing": {"weight": "heavy"}}).build("losses")


def test_a_mistake_in_a_file_is_the_files_and_one_on_top_is_the_command_lines(tmp_path: Path) -> None:
    (tmp_path / "run.yaml").write_text("generations: 0\n")
    with pytest.raises(UsageError, match=r"run\.yaml: generations: expected 1 to 1000000, got 0$"):
        load_config(tmp_path / "run.yaml", ["frames=3"])
    with pytest.raises(UsageError, match=r"^command line: generations: expected a whole number, got 'x'$"):
        load_config(tmp_path / "run.yaml", ["generations=x"])


def test_the_merged_config_reads_back_as_itself(tmp_path: Path) -> None:
    config = load_config(overrides=["frames=5", "losses.framing.weight=3"])
    file = tmp_path / "config.yaml"
    file.write_text(to_yaml(config))
    assert load_config(file) == config


def test_config_errors_need_no_torch() -> None:
    code = (
        "import sys\nfrom cltransfer.config import load_config\nfrom cltransfer.errors import UsageError\n"
        "try:\n    load_config(overrides=['losses.framin={}'])\nexcept UsageError:\n    pass\n"
        "assert 'torch' not in sys.modules and 'kornia' not in sys.modules, sorted(sys.modules)\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


def test_ranges_are_checked_in_python_too() -> None:
    with pytest.raises(UsageError, match="frames"):
        RunConfig(frames=0)


def test_how_a_plugin_is_let_in_is_told_on_the_command_line_and_in_python() -> None:
    with pytest.raises(
        UsageError, match=r"no such loss \(.*a plugin needs --allow-plugin, in Python cltransfer\.plugins\."
    ):
        load_config(overrides=["losses.headroom.weight=1"])


@pytest.mark.parametrize("key", ["sigma0", "losses.framing.weight"])
def test_a_whole_number_beyond_any_float_is_refused_with_its_key(key):
    with pytest.raises(UsageError, match=f"{re.escape(key)}: expected a number"):
        load_config(overrides=[f"{key}=1{'0' * 400}"]).build("losses")


@pytest.mark.parametrize("key", ["seed", "adam.rate", "losses.framing.weight", "losses.framing.mode"])
def test_a_whole_number_that_cannot_be_shown_is_refused_where_it_is_written(tmp_path: Path, key: str) -> None:
    long, told = f"0x{'F' * 4000}", f"{key}: expected a number of at most 64 bits, got one of 16000 ("
    with pytest.raises(UsageError) as caught:
        load_config(overrides=[f"{key}={long}"])
    assert str(caught.value).startswith(f"command line: {told}")
    words = key.split(".")
    file = tmp_path / "long.yaml"
    file.write_text(": {".join(words) + f": {long}" + "}" * (len(words) - 1))
    with pytest.raises(UsageError) as caught:
        load_config(file)
    assert str(caught.value).startswith(f"{file}: {told}")


@pytest.mark.parametrize("value", ["{? 0xLONG : 1}", "[1, {a: [0xLONG]}]", "!!set {0xLONG}"])
def test_such_a_number_is_refused_wherever_it_stands(value: str) -> None:
    with pytest.raises(UsageError, match=r"^command line: losses[.a]*: expected a number of at most 64 bits"):
        parse_overrides([f"losses={value.replace('LONG', 'F' * 4000)}"])
    assert parse_overrides([f"seed={2**64 - 1}"]) == {"seed": 2**64 - 1}


def test_an_override_is_not_lost_where_a_later_one_names_its_mapping():
    written = ["losses.framing.weight=3", "losses.framing={mode: faithful}"]
    for overrides in (written, written[::-1]):
        assert load_config(overrides=overrides).losses["framing"] == {"weight": 3, "mode": "faithful"}
    assert "framing" not in load_config(overrides=["losses.framing=null", "losses={shot_size: {weight: 3}}"]).losses
    assert load_config(overrides=["adam={iterations: 3}", "adam={rate: 0.1}"]).adam.iterations == 3
    assert list(load_config(overrides=["search.paper_box={}", "search={se3_jaws: {}}"]).search) == ["se3_jaws"]
