"""What a trial is: drawn without end, the same for every method, told apart by its key."""

import hashlib
import math
from collections import Counter
from dataclasses import asdict, replace

import pytest

from cltransfer.bench.chart import CHART_TIERS
from cltransfer.bench.measures import clip_of, is_self
from cltransfer.bench.methods import METHODS, config_of, config_text, renderer_override
from cltransfer.bench.protocol import CROSS, FIRST_SEED, SELF, STARTS, TIERS, Trial, drawn_start
from cltransfer.bench.trial import Clip
from cltransfer.errors import UsageError
from cltransfer.shots import SHOTS

FIRST = ["LS", "CU", "LS", "MS", "LS", "CU"]  # where a pan in room-0 begins, by seeds 0 to 5
TABLE1, CHART = list(TIERS["standard"].clips()), list(CHART_TIERS["standard"].clips([1000, 1001]))  # as published
CLIP = ("pan", "plaza-2000", "room-2001", 1000)
TRIAL = Trial("fast", *CLIP)


def test_cma_is_balanced_but_for_the_search_of_its_frames_and_paper_leaves_its_path_as_found():
    ours, cma, paper = (asdict(config_of(name, "room-0", 0)) for name in ("balanced", "cma", "paper"))
    assert {key for key in ours if ours[key] != cma[key]} == {"engine", "generations", "patience", "popsize"}
    assert (cma["path"], paper["path"]) == ("smooth", "exact")  # docs/protocol.md says so


def test_starts_are_drawn_evenly_and_repeat():
    names = Counter(drawn_start(shot, "room-0", seed)[0] for shot in SHOTS for seed in range(30))
    assert set(names) == set(STARTS)
    assert min(names.values()) > 90
    assert [drawn_start("pan", "room-0", seed)[0] for seed in range(6)] == FIRST  # on every machine and at every time
    assert drawn_start("pan", "room-0", 4) != drawn_start("pan", "stage-0", 4)


def test_a_close_up_starts_closer_than_a_long_shot_and_at_the_face():
    drawn = dict(drawn_start("pan", "room-0", seed) for seed in range(20))
    assert drawn["CU"].coverage > drawn["MS"].coverage > drawn["LS"].coverage
    assert drawn["CU"].distance < drawn["MS"].distance < drawn["LS"].distance
    assert drawn["CU"].aim > drawn["LS"].aim == 0


def test_the_standard_tier_has_every_shot_and_every_pair_of_scenes():
    clips = list(TIERS["standard"].clips())
    assert {shot for shot, *_ in clips} == set(SHOTS)
    pairs = {(teacher.split("-")[0], pupil.split("-")[0]) for _, teacher, pupil, _ in clips}
    assert pairs == set(CROSS + SELF)
    assert all(seed >= FIRST_SEED for *_, seed in clips)


def test_reference_and_target_have_other_people_except_in_a_self_transfer():
    for _, teacher, pupil, _ in TIERS["full"].clips([7]):
        same = teacher.split("-")[0] == pupil.split("-")[0]
        assert (teacher == pupil) == same


def test_no_reference_is_taught_twice():
    clips = list(TIERS["full"].clips())
    assert len({(shot, teacher, seed) for shot, teacher, _, seed in clips}) == len(clips) == 1040
    assert len({(shot, pupil, seed) for shot, _, pupil, seed in clips}) == len(clips)


def test_a_seed_that_is_named_twice_counts_once():
    for tier in ("standard", "full"):
        assert list(TIERS[tier].clips([1000, 1000])) == list(TIERS[tier].clips([1000]))


def test_the_clips_of_a_seed_do_not_depend_on_the_seeds_beside_it():
    alone, beside = set(TIERS["full"].clips([1001])), set(TIERS["full"].clips([1000, 1001]))
    assert alone == {clip for clip in beside if clip[-1] == 1001}


@pytest.mark.parametrize(
    ("tier", "digest"),
    [
        (TIERS["standard"], "990d4d7b06b68658"),
        (CHART_TIERS["standard"], "cfa59c6e082625e0"),
        (CHART_TIERS["full"], "3ccb9bb703eb2c60"),
    ],
)
def test_the_clips_that_were_published_keep_their_names(tier, digest):
    assert hashlib.sha256(repr(list(tier.clips())).encode()).hexdigest()[:16] == digest


@pytest.mark.parametrize(
    ("clip", "name", "degrees", "offset", "rest"),
    [  # azimuth and elevation; distance, coverage, aim and reach
        (TABLE1[0], "MS", (45.5193, 4.1097), (-0.0098, 0.0447), (2.582, 1.08, 0.24, 0.4167)),
        (TABLE1[13], "CU", (-32.0647, 5.8369), (0.0175, 0.0057), (1.5652, 1.8, 0.38, 0.2)),
        (TABLE1[-1], "LS", (19.6748, 2.5701), (0.0859, 0.0245), (2.8, 0.62, 0.0, 1.0)),
        (CHART[-1], "LS", (7.1003, 6.4851), (0.0618, -0.0287), (2.8, 0.62, 0.0, 1.0)),
    ],
)
def test_the_clips_that_were_published_are_drawn_as_they_were(clip, name, degrees, offset, rest):
    shot, teacher, _, seed = clip
    start, setup = drawn_start(shot, teacher, seed)
    assert (start, setup.seed) == (name, seed)
    assert (math.degrees(setup.azimuth), math.degrees(setup.elevation)) == pytest.approx(degrees, abs=1e-4)
    assert setup.offset == pytest.approx(offset, abs=1e-4)
    assert (setup.distance, setup.coverage, setup.aim, setup.reach) == pytest.approx(rest, abs=1e-4)


def test_the_cameras_of_a_published_clip_stay_where_they_were():
    clip = Clip.drawn(Trial("fast", *TABLE1[9]))  # an orbit, from a stage into a room
    ends = [
        [*path.camera.center[i].tolist(), *path.camera.focal[i].flatten().tolist()]
        for path in (clip.reference, clip.true)
        for i in (0, -1)
    ]
    assert clip.reference.camera.size == (640, 360)
    assert clip.reference.times.tolist() == pytest.approx([i / 12 for i in range(24)])
    assert ends == [
        pytest.approx([3.2753, -1.8174, 1.0624, 1015.0315], abs=1e-3),
        pytest.approx([0.7268, -1.8174, 3.3517, 1015.0315], abs=1e-3),
        pytest.approx([3.2643, 1.0541, 1.8015, 1015.0315], abs=1e-3),
        pytest.approx([0.7356, 3.3257, 1.8015, 1015.0315], abs=1e-3),
    ]


def test_every_method_gets_the_same_clips():
    trials = TIERS["smoke"].trials(["fast", "balanced"])
    assert [clip_of(asdict(t)) for t in trials[::2]] == [clip_of(asdict(t)) for t in trials[1::2]]
    assert len(trials) == 6


def test_a_key_tells_trials_and_configs_apart():
    others = [
        Trial("balanced", *CLIP),
        Trial("fast", *CLIP, options=("steps=2",)),
        Trial("fast", *CLIP, frames=8),
        Trial("fast", "tilt", *CLIP[1:]),
    ]
    assert len({TRIAL.key(), *(trial.key() for trial in others)}) == 5
    assert TRIAL.key() == Trial("fast", *CLIP).key()
    assert TRIAL.key(networks=True) != TRIAL.key()


def test_a_row_that_other_networks_read_is_another_one(monkeypatch):
    before = TRIAL.key(), TRIAL.key(networks=True)
    monkeypatch.setattr("cltransfer.models.content.model_content", lambda name: f"other {name}")
    assert TRIAL.key() == before[0]
    assert TRIAL.key(networks=True) != before[1]


def test_a_key_tells_how_far_a_replay_drifts(monkeypatch):
    trial = Trial("replay_drift", *CLIP)
    before = trial.key()
    monkeypatch.setitem(METHODS, "replay_drift", replace(METHODS["replay_drift"], drift=3.0))
    config_text.cache_clear()
    assert trial.key() != before
    config_text.cache_clear()


def test_a_key_tells_whether_what_is_replayed_was_rebuilt():
    keys = {Trial(name, *CLIP).key() for name in ("replay", "replay_rebuilt")}
    texts = {config_text(name, "room-1", 3, ()) for name in ("replay", "replay_rebuilt")}
    assert len(keys) == len(texts) == 2


@pytest.mark.parametrize("name", METHODS)
def test_every_method_searches_the_same_features_at_the_same_size(name):
    config = config_of(name, "room-1", 3)
    assert (config.extract.inner, config.search_side, config.threads, config.seed) == ("geometric", 160, 1, 3)


def test_a_scene_s_form_chooses_its_renderer():
    assert renderer_override("room-3") == ()
    assert list(config_of("fast", "room-3-mesh", 0).renderer) == ["mesh"]
    assert list(config_of("fast", "room-3-grid", 0).renderer) == ["nerf_grid"]


def test_an_unknown_method_names_the_known():
    with pytest.raises(UsageError, match="method 'magic': no such method"):
        config_of("magic", "room-1", 0)


def test_a_form_is_of_the_scene_that_is_taught_and_leaves_the_clip():
    splats, mesh = (TIERS["full"].trials(["fast"], [7], form) for form in ("splats", "mesh"))
    assert all(m.pupil == f"{s.pupil}-mesh" and m.teacher == s.teacher for s, m in zip(splats, mesh))
    rows = [{"teacher": trial.teacher, "pupil": trial.pupil} for trial in mesh]
    assert sum(is_self(row) for row in rows) == len(SHOTS) * 4
