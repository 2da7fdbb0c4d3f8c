"""Making the page: videos encoded alike under their tokens, one HTML file, and a key that stays elsewhere."""

from __future__ import annotations

import hashlib
import json
import os
import re
import shlex
import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations, zip_longest
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import cv2
import torch
from markupsafe import Markup

from ..clips.clip import write_video
from ..clips.open_clip import ASSUMED, rate_assumed
from ..clips.source import ClipSource
from ..computer.memory import require_free
from ..errors import UsageError
from ..report.policy import csp_hash
from ..report.template import rendered
from ..storage.alone import alone
from ..storage.files import write_json, write_text
from ..storage.pages import INDEX, check_page
from ..storage.unfinished import clear_left
from .design import NO_STUDY, QUESTIONS, Study, design
from .folder import MARK, check_key, key_of
from .shown import SHORTER, Shown, clip_of, digest_of, kept, reference_of, source_of

FILES = re.compile(r"index\.html|README\.txt")  # that are written into the folder under a temporary name
SIDE = 720  # largest height of a video [px]
WRITTEN = 946_684_800  # [s] when every video is said to have been: the year 2000, since a zip holds none before 1980


@dataclass(frozen=True)
class Wanted:
    """What a study is made from.

    Args:
        runs: run folders or clips; each ``len(methods)`` of them, in the order of the methods, are one sample.
        methods: names.
        references: a clip for each sample; may be empty where all are run folders, which show their own.
        seed: of the tokens.

    Clips are named as :class:`cltransfer.clips.source.ClipSource` says; they are shown as they are, black bars and cuts
    included, unless asked otherwise.
    """

    runs: tuple[str | Path, ...]
    methods: tuple[str, ...]
    references: tuple[str | Path, ...] = ()
    seed: int = 0

    def notes(self) -> list[str]:
        """What its maker should know: which clips play at a rate that nothing says."""
        named = dict.fromkeys(map(str, (*self.runs, *self.references)))
        return [f"{source}: {ASSUMED}" for source in named if rate_assumed(kept(source_of(source)))]


def build_study(wanted: Wanted, out: Path) -> tuple[Study, Path]:
    """Write the page into the folder ``out`` and its key beside it; returns the study and the key file.

    Raises:
        UsageError: runs, methods and references do not go together, one clip is compared with itself, the folder holds
            something else, or the key beside it is that of another study.
        InputError: a clip cannot be read, or the runs of a sample have different references; nothing was written.
        ResourceError: there is no memory for the frames of a sample; nothing was written.
    """
    out = out.resolve()  # its name tells the key's, "." has none
    groups, references = _groups(wanted)
    check_page(out, MARK, "a page of a study")
    samples = [f"sample{i + 1}" for i in range(len(groups))]
    content = [digest_of(where) for shown in (*groups, references) for where in shown]
    study = design(samples, wanted.methods, content, wanted.seed)
    for i, group in enumerate(groups):
        _check_apart(group, content[i * len(group) :])
    check_key(out, study)
    # apart: a clip that cannot be read leaves no half a page
    with alone(out, "makes a page"), TemporaryDirectory(prefix=".tmp-", dir=out.parent) as made:
        clear_left(out, FILES)
        for sample, group, reference in zip_longest(samples, groups, references):
            _write_sample(Path(made), study, sample, group, reference)
        # first: a page without one is worth nothing
        write_json(key_of(out), {**study.to_json(), "runs": _sources(wanted)})
        write_text(out / INDEX, page(study))
        (out / "videos").mkdir(exist_ok=True)
        for video in Path(made).iterdir():
            os.utime(video, (WRITTEN, WRITTEN))  # the order in which they were made would tell methods apart
            shutil.move(video, out / "videos" / video.name)  # a folder that is mounted lies on another disk
        write_text(out / "README.txt", _readme(study, out))
    return study, key_of(out)


def _write_sample(
    folder: Path, study: Study, sample: str, group: Sequence[ClipSource], given: ClipSource | None
) -> None:
    """Write the videos of one sample, all equally high, under their tokens."""
    token_of = {clip.method: clip.token for clip in study.clips.values() if clip.sample == sample}
    reference = reference_of(group, given)
    clips = [clip_of(where) for where in group]
    height = min(SIDE, *(clip.image.shape[2] for clip in clips))
    for method, clip in zip(study.methods, clips):
        write_level(folder / f"{token_of[method]}.mp4", clip, height)
    write_level(folder / f"{_reference_token(study, sample)}.mp4", reference, height)


def _groups(wanted: Wanted) -> tuple[list[list[ClipSource]], list[ClipSource]]:
    """What is shown of each sample, in the order of the methods, and their references."""
    size = len(wanted.methods)
    if not wanted.runs or len(wanted.runs) % size:
        raise UsageError("", "RUN", f"expected {size} for each sample ({', '.join(wanted.methods)})", _got(wanted.runs))
    runs = [source_of(source) for source in wanted.runs]
    groups = [runs[i : i + size] for i in range(0, len(runs), size)]
    if wanted.references and len(wanted.references) != len(groups):
        raise UsageError("", "--reference", f"expected one for each of {len(groups)} samples", _got(wanted.references))
    return groups, [source_of(source) for source in wanted.references]


def _check_apart(group: Sequence[ClipSource], content: Sequence[str]) -> None:
    """Refuse a sample in which two methods show one clip: all that is answered on it would be chance."""
    for (one, first), (other, second) in combinations(zip(group, content), 2):
        if first == second or kept(one) == kept(other):
            what = "is there twice" if one == other else f"shows the very frames of {one.named}"
            raise UsageError(other.named, "", f"{what}, expected different ones", "or leave this sample out")


def _got(sources: Sequence[str | Path]) -> str:
    return f"got {len(sources)}"


def write_level(path: Path, clip: Shown, height: int) -> None:
    """The clip at one height for all, by one encoder: neither size nor compression tells whose it is.

    Raises:
        ResourceError: there is no memory for its frames at that height.
    """
    count, source = len(clip.times), clip.image.shape[2:]
    width, height = max(2, round(source[1] * height / source[0] / 2) * 2), height - height % 2
    image = clip.image
    if image.shape[2:] != (height, width):
        what = f"{count} frames at {width}x{height}, beside those that were read,"
        require_free(3 * count * width * height, clip.named, what, SHORTER)
        image = torch.empty((count, 3, height, width), dtype=torch.uint8)
        for level, frame in zip(image, clip.image.permute(0, 2, 3, 1)):
            resized = cv2.resize(frame.numpy(), (width, height), interpolation=cv2.INTER_AREA)
            level[:] = torch.from_numpy(resized).permute(2, 0, 1)
    write_video(path, image, clip.times)


def _reference_token(study: Study, sample: str) -> str:
    return hashlib.sha256(f"{study.name}:{sample}".encode()).hexdigest()[:6] + "r"


def _sources(wanted: Wanted) -> list[dict[str, str]]:
    size, named = len(wanted.methods), [str(source) for source in wanted.runs]
    return [dict(zip(wanted.methods, named[i : i + size])) for i in range(0, len(named), size)]


def page(study: Study) -> str:
    """The page as HTML: one file that fetches nothing but the videos beside it."""
    here = Path(__file__)
    script, style = (here.with_name(name).read_text(encoding="utf-8") for name in ("page.js", "page.css"))
    return rendered(
        here.with_name("page.html"),
        script=Markup(script),  # Markup: our own files, and JSON without a bracket
        style=Markup(style),
        script_hash=csp_hash(script),
        style_hash=csp_hash(style),
        data=Markup(json.dumps(_shown(study)).replace("<", "\\u003c")),
        mark=MARK,
        no_study=NO_STUDY,
        comparisons=len(study.items),
        questions=len(QUESTIONS),
    )


def _shown(study: Study) -> dict[str, Any]:
    """What the page knows: tokens, in an order that says nothing about methods."""
    return {
        "study": study.name,
        "questions": [{"name": name, "text": text} for name, text in QUESTIONS.items()],
        "items": [
            {
                "name": item.name,
                "reference": _reference_token(study, item.sample),
                "clips": sorted([item.first, item.second]),
            }
            for item in study.items
        ],
    }


def counted(study: Study) -> str:
    """How many comparisons there are, as ``1 comparison``."""
    return f"{len(study.items)} comparison{'s' * (len(study.items) != 1)}"


def _readme(study: Study, out: Path) -> str:
    return (
        f"Study {study.name}: {counted(study)}, {len(QUESTIONS)} questions each.\n\n"
        "Open index.html in a browser; it needs no network and no server. Every participant downloads a CSV file at\n"
        "the end, or on stopping before; both may be given, unless an answer was taken back between them: then the\n"
        "later file alone.\n"
        f"Keep {out.name}.key.json, which says whose video is whose, away from them.\n\n"
        f"  cltransfer study --analyse answers/*.csv --key {shlex.quote(out.name + '.key.json')}\n\n{NO_STUDY}\n"
    )
