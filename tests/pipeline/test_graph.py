"""Only what an active loss reaches is computed, in an order that works."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import pytest
import torch

from cltransfer.errors import ModelError, UsageError
from cltransfer.features import SHAPES, Features
from cltransfer.pipeline.graph import Load, run, run_clip
from cltransfer.pipeline.plan import make_plan
from cltransfer.progress import Progress, silent


def shaped(name: str, values: torch.Tensor) -> torch.Tensor:
    """Feature ``name`` of which every element is the one of ``values`` (N,) of its frame."""
    shape = [want or 1 for want in SHAPES.get(name, (1,))]
    return values.reshape(-1, *[1] * len(shape)).expand(-1, *shape)


@dataclass(frozen=True)
class Making:
    """An extractor that writes how many frames it saw, and whether it saw an optional input."""

    provides: tuple[str, ...]
    requires: tuple[str, ...] = ("image",)
    family: str = "image"
    uses: tuple[str, ...] = ()
    needs_before: bool = False
    passes: int = 1

    def __call__(self, now: Features, before: Features | None) -> Features:
        image = now.require("image") if now.has("image") else torch.zeros(len(now), 1)
        base = image.flatten(1).mean(1)
        if self.needs_before:
            assert before is not None
            base = base - before.require("image").flatten(1).mean(1)
        seen = sum(now.has(name) for name in self.uses)
        made = {n: shaped(n, base + 100 * seen) for n in self.provides}
        own = {n: v for n, v in made.items() if n in Features.__dataclass_fields__}
        return replace(now, **own, extras={**now.extras, **{n: v for n, v in made.items() if n not in own}})


IMAGE = frozenset({"image"})


def plan(wanted: set[str], extractors: dict[str, Making], source: frozenset[str] = IMAGE, **more):
    return make_plan(frozenset(wanted), extractors, source, more.pop("family", "image"), **more)


def test_only_what_is_wanted_runs_and_in_order() -> None:
    chain = {"b": Making(("orientation",), ("box",)), "a": Making(("box",)), "c": Making(("gaze",))}
    made = plan({"orientation"}, chain)
    assert [s.name for s in made.steps] == ["a", "b"]
    assert made.passes == 2


def test_a_source_is_asked_only_for_the_buffers_reached() -> None:
    source = frozenset({"image", "depth", "label", "camera"})
    made = plan({"flow"}, {"f": Making(("flow",), ("depth", "camera"), "scene")}, source, family="scene")
    assert made.buffers == {"depth", "camera"}


def test_what_cannot_be_had_is_told_and_costs_nothing() -> None:
    made = plan({"depth", "box"}, {"a": Making(("box",)), "d": Making(("depth",), ("lidar",))})
    assert [s.name for s in made.steps] == ["a"]
    assert made.missing == {"depth": "d needs 'lidar': no image extractor provides 'lidar'"}


def test_what_cannot_be_had_leaves_nothing_behind_that_another_feature_needs() -> None:
    extractors = {
        "a": Making(("box",)),
        "d": Making(("depth",), ("box", "label", "lidar")),
        "g": Making(("gaze",), ("box",)),
    }
    made = plan({"depth", "gaze"}, extractors, IMAGE | {"label"})
    assert [s.name for s in made.steps] == ["a", "g"]
    assert made.buffers == {"image"}


@dataclass(frozen=True)
class Detecting(Making):
    """An extractor that sees all persons of a frame."""

    def persons(self, now: Features) -> list[object]:
        return []


def test_along_a_clip_a_mere_detector_looks_once_and_one_that_tells_more_once_again() -> None:
    pose = Making(("keypoints",), ("image", "box"))
    mere = plan({"keypoints"}, {"net": Detecting(("box",)), "pose": pose})
    assert (mere.passes, mere.clip_passes) == (2, 2)
    assert [step.name for step in mere.person_known.steps] == ["pose"]
    more = plan({"keypoints", "subject"}, {"net": Detecting(("box", "subject")), "pose": pose})
    assert (more.passes, more.clip_passes) == (2, 3)
    assert [step.name for step in more.person_known.steps] == ["net", "pose"]


def test_what_a_renderer_alone_can_draw_is_not_asked_of_an_extractor() -> None:
    joints = {"joints": Making(("keypoints",), ("label", "camera"), "scene")}
    made = plan({"keypoints"}, joints, frozenset({"image", "camera"}), family="scene")
    told = "joints needs 'label': the renderer draws no 'label' (it is to be named in its provides)"
    assert made.missing == {"keypoints": told}


def test_a_scene_prefers_scene_extractors_and_an_image_never_uses_them() -> None:
    both = {"net": Making(("box",)), "geo": Making(("box",), ("camera",), "scene")}
    assert [s.name for s in plan({"box"}, both, IMAGE | {"camera"}, family="scene").steps] == ["geo"]
    assert [s.name for s in plan({"box"}, both).steps] == ["net"]


def test_two_providers_of_one_feature_are_ambiguous() -> None:
    with pytest.raises(UsageError, match="one and two both provide 'box'"):
        plan({"box"}, {"one": Making(("box",)), "two": Making(("box",))})


def test_two_providers_are_ambiguous_even_where_one_runs_for_another_feature() -> None:
    both = {"pose": Making(("box", "subject")), "mask": Making(("subject",))}
    with pytest.raises(UsageError, match="pose and mask both provide 'subject'"):
        plan({"box", "subject"}, both)
    assert [s.name for s in plan({"box"}, both).steps] == ["pose"]


class OfTorch(Making):
    """A plugin's extractor with a network of torch."""

    @cached_property
    def network(self) -> torch.nn.Module:
        if not self.uses:
            raise FileNotFoundError("w.pt")
        return torch.nn.Sequential(torch.nn.Flatten())


def test_the_network_of_a_plugin_is_whatever_it_is_and_loaded_before_any_frame_is_read() -> None:
    loaded = OfTorch(("gaze",), uses=("depth",))
    plan({"gaze"}, {"net": loaded}).load_networks()
    assert "network" in vars(loaded)
    line = "extractor net: expected gaze, it raised FileNotFoundError: w.pt "
    with pytest.raises(ModelError, match=f"^{line}"):
        plan({"gaze"}, {"net": OfTorch(("gaze",))}).load_networks()


@dataclass(frozen=True)
class Spoiling(Making):
    """An extractor that does something to what it was given."""

    how: str = ""
    whole_clip: bool = False

    def __call__(self, now: Features, before: Features | None) -> Features:
        made = super().__call__(now, before)
        return {"frames": made[:1], "size": replace(made, size=(2, 2)), "dropped": made.only(self.provides)}[self.how]

    def read_clip(self, found: Features, load: Load) -> Features:
        return self(load(0, 3), None)


@pytest.mark.parametrize(
    ("how", "line"),
    [("frames", "expected the 3 frames that it was given, got 1"),
     ("size", "expected frames of 8 x 8 px as it was given, got 2 x 2"),
     ("dropped", "expected what it was given and its own, 'image' is gone")],
)  # fmt: skip
def test_an_extractor_that_gives_other_frames_than_it_was_given_is_named(how: str, line: str) -> None:
    made = plan({"gaze"}, {"mine": Spoiling(("gaze",), how=how)})
    now = Features((8, 8), image=torch.zeros(3, 3, 8, 8))
    with pytest.raises(ModelError, match=f"^extractor mine: {line}"):
        run(made, now, None)


def test_an_extractor_of_whole_clips_that_gives_other_frames_is_named_too() -> None:
    made = plan({"gaze"}, {"mine": Spoiling(("gaze",), how="frames", whole_clip=True)})
    now = Features((8, 8), image=torch.zeros(3, 3, 8, 8))
    with pytest.raises(ModelError, match=r"^extractor mine: expected the 3 frames that it was given, got 1 "):
        run_clip(made, lambda start, stop: now[start:stop], 3)


def test_a_circle_is_named() -> None:
    with pytest.raises(UsageError, match="circle: box -> gaze -> box"):
        plan({"box"}, {"a": Making(("box",), ("gaze",)), "b": Making(("gaze",), ("box",))})


@pytest.mark.parametrize(("shared", "seen"), [(None, 100), (frozenset({"box"}), 0), (frozenset({"depth"}), 100)])
def test_an_optional_input_is_hidden_unless_both_sides_have_it(shared: frozenset[str] | None, seen: int) -> None:
    source = frozenset({"image", "depth"})
    both = {"a": Making(("box",), uses=("depth",), family="both"), "f": Making(("gaze",), ("depth",), "scene")}
    made = plan({"box", "gaze"}, both, source, family="scene", shared=shared)
    got = run(made, Features((2, 2), image=torch.zeros(1, 3, 2, 2), depth=torch.ones(1, 2, 2)), None)
    assert float(got.require("box")[0, 0]) == seen
    assert got.has("depth")  # hidden from one step, not lost


def test_what_a_step_has_used_is_kept_for_the_other_side_to_be_read_by_the_same_rule() -> None:
    source = frozenset({"image", "depth"})
    makers = {"a": Making(("box",), uses=("depth", "gaze"), family="both")}
    first = plan({"box"}, makers, source, family="scene")
    assert first.wanted == {"box", "depth"}
    assert plan({"box"}, makers, family="image").wanted == {"box"}
    features = Features((2, 2), image=torch.zeros(2, 3, 2, 2), depth=torch.ones(2, 2, 2))
    read = run_clip(first, lambda a, b: features[a:b], 2)
    second = plan({"box"}, makers, source, family="scene", shared=read.names())
    torch.testing.assert_close(run(second, features[0], None).require("box"), read.require("box")[:1])


def test_a_plugin_s_own_feature_is_hidden_too() -> None:
    chain = {"a": Making(("heat",)), "b": Making(("glow",), uses=("heat",))}
    image = torch.zeros(1, 3, 2, 2)
    for shared, seen in ((frozenset[str](), 0), (frozenset({"heat"}), 1)):
        made = plan({"heat", "glow"}, chain, shared=shared)
        got = run(made, Features((2, 2), image=image), None)
        assert float(got.require("glow")) == 100 * seen
        assert got.has("heat")


def test_what_a_loss_merely_uses_is_computed_where_it_can_be_had_and_never_missed() -> None:
    makers = {"a": Making(("box",)), "f": Making(("flow", "flow_confidence"))}
    made = plan({"box"}, makers, uses=frozenset({"flow_confidence", "gaze"}))
    assert made.wanted == {"box", "flow_confidence"}
    assert [s.name for s in made.steps] == ["a", "f"]
    assert made.missing == {}


def test_what_a_loss_merely_uses_never_replaces_what_it_requires() -> None:
    exact = Making(("flow",), ("depth",), "scene")
    makers = {"exact": exact, "read": Making(("flow", "flow_confidence"))}
    source = frozenset({"image", "depth"})
    made = plan({"flow"}, makers, source, family="scene", uses=frozenset({"flow_confidence"}))
    assert [s.name for s in made.steps] == ["exact"]
    assert made.buffers == {"depth"}
    read = plan({"flow"}, makers, family="image", uses=frozenset({"flow_confidence"}))
    assert read.wanted == {"flow", "flow_confidence"}


@dataclass(frozen=True)
class Halved(Making):
    """Flow of every second pixel."""

    def __call__(self, now: Features, before: Features | None) -> Features:
        size = (len(now), 2, now.size[1] // 2, now.size[0] // 2)
        return replace(now, flow=torch.ones(size), flow_confidence=torch.ones(size[0], *size[2:]))


def test_a_first_frame_has_maps_of_the_size_of_the_others() -> None:
    made = plan({"flow", "flow_confidence"}, {"f": Halved(("flow", "flow_confidence"), needs_before=True)})
    still = Features((4, 2), image=torch.zeros(3, 3, 2, 4))
    first = run(made, still, None)
    got = Features.concatenate([first, run(made, still[:1], first[:1])])
    assert got.require("flow").isnan().flatten(1).all(1).tolist() == [True, True, True, False]


def test_a_first_frame_has_no_flow_and_the_others_compare_with_the_one_before() -> None:
    image = torch.arange(20.0)[:, None, None, None].expand(20, 3, 2, 2)  # longer than one chunk
    made = plan({"gaze"}, {"f": Making(("gaze",), needs_before=True)})
    got = run_clip(made, lambda a, b: Features((2, 2), image=image[a:b]), 20).require("gaze")[:, 0]
    assert bool(torch.isnan(got[0]))
    torch.testing.assert_close(got[1:], torch.ones(19))


def test_a_first_frame_has_nan_of_the_shape_of_the_others() -> None:
    made = plan({"beat"}, {"f": Beat()})
    first = run(made, Features((4, 2), image=torch.zeros(1, 3, 2, 4)), None)
    second = run(made, Features((4, 2), image=torch.ones(1, 3, 2, 4)), first)
    beat = Features.concatenate([first, second]).require("beat")
    assert bool(beat[0].isnan().all())
    assert beat[1].tolist() == [1, 1, 1]


@dataclass(frozen=True)
class Beat:
    """An extractor that compares with the frame before, and gives three numbers."""

    provides: tuple[str, ...] = ("beat",)
    requires: tuple[str, ...] = ("image",)
    family: str = "image"
    needs_before: bool = True

    def __call__(self, now: Features, before: Features | None) -> Features:
        assert before is not None
        change = (now.require("image") - before.require("image")).mean((2, 3))
        return replace(now, extras={**now.extras, "beat": change})


@dataclass(frozen=True)
class Whole:
    """An extractor that reads a whole clip: the mean of all its pixels, or a reason."""

    provides: tuple[str, ...] = ("depth", "trust")
    requires: tuple[str, ...] = ("image", "box")
    family: str = "image"
    whole_clip: bool = True
    reason: str = ""

    def read_clip(self, found: Features, load) -> Features:
        assert not found.has("image")
        if self.reason:
            return replace(found, reasons=dict.fromkeys(self.provides, self.reason))
        mean = torch.stack([load(i, i + 1).image.mean() for i in range(len(found))]).mean()
        boxes = found.require("box")
        return replace(found, depth=boxes[:, :1, None] + mean, extras={**found.extras, "trust": boxes})


def along_clip(whole: Whole, wanted: set[str], progress: Progress = silent) -> Features:
    image = torch.arange(20.0)[:, None, None, None].expand(20, 3, 2, 2)
    steps = {
        "a": Making(("box",)), "whole": whole, "l": Making(("score",), ("image",), uses=("depth",)),
        "n": Making(("flow",), needs_before=True), "d": Making(("gaze",), ("depth",)),
    }  # fmt: skip
    made = plan(wanted, steps)
    return run_clip(made, lambda a, b: Features((2, 2), image=image[a:b]), 20, progress)


def test_the_progress_of_a_clip_that_is_gone_through_twice_never_falls() -> None:
    told: list[tuple[str, int, int]] = []
    along_clip(Whole(), {"score", "depth"}, lambda *call: told.append(call))
    assert told == [
        *(("reading frames", done, 40) for done in (8, 16, 20)),
        ("reading the clip: whole", 0, 0),
        *(("reading frames", 20 + done, 40) for done in (8, 16, 20)),
    ]


def test_the_progress_of_a_clip_counts_no_stage_that_has_nothing_to_do() -> None:
    told: list[tuple[str, int, int]] = []
    along_clip(Whole(), {"depth"}, lambda *call: told.append(call))
    assert told == [*(("reading frames", done, 20) for done in (8, 16, 20)), ("reading the clip: whole", 0, 0)]


def test_a_step_that_reads_the_whole_clip_has_what_came_before_and_gives_to_what_comes_after() -> None:
    got = along_clip(Whole(), {"score", "flow", "depth"})
    assert got.names() == {"score", "flow", "depth", "trust"}  # what it made is kept, it was dear
    torch.testing.assert_close(got.require("depth")[:, 0, 0], torch.arange(20.0) + 9.5)
    assert bool((got.require("score")[:, 0] >= 100).all())  # they saw the depth
    torch.testing.assert_close(got.require("flow")[1:, 0, 0, 0], torch.ones(19))  # across chunks too


@pytest.mark.parametrize("hidden", [frozenset[str](), frozenset({"score"})])
def test_a_whole_clip_step_sees_nothing_that_is_hidden_and_loses_none_of_it(hidden: frozenset[str]) -> None:
    saw = []

    @dataclass(frozen=True)
    class Watching(Whole):
        uses: tuple[str, ...] = ("score",)

        def read_clip(self, found: Features, load) -> Features:
            saw.append(found.has("score"))
            return super().read_clip(found, load)

    made = plan({"score", "depth"}, {"a": Making(("box", "score")), "whole": Watching()}).hiding(hidden)
    got = run_clip(made, lambda a, b: Features((2, 2), image=torch.zeros(b - a, 3, 2, 2)), 2)
    assert saw == [not hidden]
    assert got.names() >= {"score", "depth"}


def test_what_a_whole_clip_does_not_tell_is_told_and_so_is_what_needs_it() -> None:
    got = along_clip(Whole(reason="it stands still"), {"score", "depth", "gaze"})
    assert got.names() == {"score"}
    assert dict(got.reasons) == dict.fromkeys(("depth", "trust", "gaze"), "it stands still")
    assert bool((got.require("score")[:, 0] < 100).all())


def test_a_whole_clip_step_that_says_nothing_is_named() -> None:
    @dataclass(frozen=True)
    class Silent(Whole):
        def read_clip(self, found: Features, load) -> Features:
            return found

    with pytest.raises(UsageError, match="extractor whole: gave neither 'depth' nor a reason"):
        along_clip(Silent(), {"depth"})


def test_a_single_frame_is_not_for_a_step_that_reads_whole_clips() -> None:
    made = plan({"depth"}, {"a": Making(("box",)), "whole": Whole()})
    with pytest.raises(UsageError, match="extractor whole: reads a whole clip, not single renders"):
        run(made, Features((2, 2), image=torch.zeros(1, 3, 2, 2)), None)


def test_a_clip_keeps_what_was_wanted_and_not_its_pixels() -> None:
    made = plan({"box"}, {"a": Making(("box",))})
    got = run_clip(made, lambda a, b: Features((2, 2), image=torch.zeros(b - a, 3, 2, 2)), 3)
    assert got.names() == {"box"}


def test_an_extractor_that_breaks_its_promise_is_named() -> None:
    @dataclass(frozen=True)
    class Idle(Making):
        def __call__(self, now: Features, before: Features | None) -> Features:
            return now

    made = plan({"box"}, {"idle": Idle(("box",))})
    with pytest.raises(UsageError, match="extractor idle: promised 'box'"):
        run(made, Features((2, 2), image=torch.zeros(1, 3, 2, 2)), None)


def test_an_extractor_that_fails_is_named_and_what_it_raised_is_kept() -> None:
    @dataclass(frozen=True)
    class Broken(Making):
        def __call__(self, now: Features, before: Features | None) -> Features:
            raise IndexError("no  such\nframe")

    made = plan({"box"}, {"broken": Broken(("box",))})
    with pytest.raises(ModelError, match="extractor broken: expected box, it raised IndexError: no such frame") as told:
        run(made, Features((2, 2), image=torch.zeros(1, 3, 2, 2)), None)
    assert isinstance(told.value.__cause__, IndexError)


def test_an_extractor_that_gives_nothing_is_named() -> None:
    class Forgetful(Making):
        def __call__(self, now: Features, before: Features | None) -> Features:
            return None  # type: ignore[return-value]

    class Late(Whole):
        def read_clip(self, found: Features, load: Load) -> Features:
            return {}  # type: ignore[return-value]

    line = r"^extractor forgetful: expected box, got NoneType \(return Features\)$"
    with pytest.raises(ModelError, match=line):
        run(plan({"box"}, {"forgetful": Forgetful(("box",))}), Features((2, 2), image=torch.zeros(1, 3, 2, 2)), None)
    with pytest.raises(ModelError, match=r"^extractor whole: expected depth, trust, got dict"):
        along_clip(Late(), {"depth"})


def test_an_extractor_of_whole_clips_that_fails_is_named() -> None:
    class Broken(Whole):
        def read_clip(self, found: Features, load: Load) -> Features:
            raise ValueError("torn")

    with pytest.raises(ModelError, match="extractor whole: expected depth, trust, it raised ValueError: torn"):
        along_clip(Broken(), {"depth"})


@dataclass(frozen=True)
class Moving:
    """The person is what changes from frame to frame; and how many pixels do."""

    requires: tuple[str, ...] = ("image",)
    provides: tuple[str, ...] = ("subject", "changed")
    family: str = "image"
    needs_before: bool = True

    def __call__(self, now: Features, before: Features) -> Features:
        moved = (now.require("image") - before.require("image")).abs().amax(1) > 0.05
        return now.having("subject", moved).having("changed", moved.flatten(1).sum(1))


@pytest.mark.parametrize("count", [1, 2, 9, 10])  # alone, one chunk, and a chunk of one behind it
def test_a_first_frame_has_no_pixel_of_a_mask_and_no_count(count: int) -> None:
    made = plan({"subject", "changed"}, {"m": Moving()})
    still = torch.zeros(1, 3, 2, 4)
    got = run_clip(made, lambda a, b: Features((4, 2), image=still.expand(b - a, -1, -1, -1)), count)
    assert got.require("subject").dtype is torch.bool
    assert not bool(got.require("subject").any())
    assert bool(got.require("changed")[0].isnan())
    assert got.require("changed")[1:].tolist() == [0] * (count - 1)
    assert not bool(run(made, Features((4, 2), image=still), None).require("subject").any())


@dataclass(frozen=True)
class Twice:
    """Compares with the frame before; writes which of its features it saw in either."""

    saw: list[tuple[bool, ...]]
    provides = ("twice",)
    requires = ("image",)
    family = "both"
    uses = ("depth",)
    needs_before = True

    def __call__(self, now: Features, before: Features | None) -> Features:
        assert before is not None
        self.saw.append((now.has("depth"), before.has("depth"), before.has("twice")))
        return now.having("twice", now.require("image").flatten(1).mean(1))


@pytest.mark.parametrize("shared", [IMAGE, IMAGE | {"depth"}])
def test_of_the_frame_before_no_more_is_shown_than_of_the_frame(shared: frozenset[str]) -> None:
    """Along a clip and in a search alike, or one extractor reads the two sides by two rules."""
    features = Features((4, 4), image=torch.rand(3, 3, 4, 4), depth=torch.ones(3, 4, 4))
    step = Twice([])
    made = make_plan(frozenset({"twice"}), {"twice": step}, IMAGE | {"depth"}, "scene", shared=shared)
    before = run(made, features[0], None)
    step.saw.clear()
    run(made, features[1], before)
    run_clip(made, lambda start, stop: features[start:stop], 3)
    there = "depth" in shared
    assert set(step.saw) == {(there, there, False)}


def test_an_extractor_that_holds_weights_is_read_without_gradients() -> None:
    weight = torch.nn.Parameter(torch.tensor(2.0))

    class Learnt(Making):
        def __call__(self, now: Features, before: Features | None) -> Features:
            return now.having("gaze", weight * now.require("image").flatten(1).mean(1))

    features = Features((4, 4), image=torch.rand(3, 3, 4, 4))
    made = plan({"gaze"}, {"learnt": Learnt(("gaze",))})
    assert not run(made, features, None).require("gaze").requires_grad
