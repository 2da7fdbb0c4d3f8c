"""Scene files that a plugin reads: whose they are, what a geometry lacks, and what stays ours."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar

import pytest
import torch
from torch import Tensor

from cltransfer.ablate.content import digest
from cltransfer.bench.synthetic_room import synthetic_room
from cltransfer.camera import Camera
from cltransfer.convert_scene import Simplification, simplify_file
from cltransfer.drawing import drawn_by, renderer_of
from cltransfer.errors import InputError, ModelError, UsageError
from cltransfer.features import Features
from cltransfer.plugins import allow
from cltransfer.registry import RENDERERS
from cltransfer.registry.declared import SCENE_SUFFIXES
from cltransfer.renderers.gaussian_splats import GaussianSplats
from cltransfer.scenes import Scene
from cltransfer.scenes.floaters import without_floaters
from cltransfer.scenes.geometry import Geometry, lacking
from cltransfer.scenes.load import load_scene
from cltransfer.scenes.meshes.mesh import Mesh
from cltransfer.scenes.person.lifted import cached_lift
from cltransfer.scenes.simplify import working_set
from cltransfer.scenes.splats import Splats
from cltransfer.testing import sample_cameras

pytestmark = pytest.mark.usefixtures("forgotten_renderers")


@dataclass(frozen=True, eq=False)
class Points:
    """A geometry that is as it is made, right or wrong."""

    renderer: ClassVar[str] = "points"

    means: Any
    label: Any

    def __len__(self) -> int:
        return len(self.means)

    def with_label(self, label: Tensor) -> Points:
        return replace(self, label=label)


RIGHT = Points(torch.rand(5, 3), torch.zeros(5))


class Drawer:
    """What all renderers have."""

    provides: ClassVar[frozenset[str]] = frozenset({"image"})

    def render(self, scene: Scene, cameras: Camera, buffers: frozenset[str]) -> Features:
        raise NotImplementedError


def register(name: str, give: Callable[[Path], Any], suffix: str = ".pts") -> None:
    """A renderer of a plugin that reads what ``give`` gives."""

    @dataclass(frozen=True)
    class Reader(Drawer):
        suffixes: ClassVar[tuple[str, ...]] = (suffix,)

        @staticmethod
        def read(path: Path) -> Any:
            return give(path)

    RENDERERS.register(name)(Reader)


@pytest.fixture
def file(tmp_path: Path) -> Path:
    (tmp_path / "stage.PTS").write_bytes(b"1 2 3")
    return tmp_path / "stage.PTS"


def test_a_file_is_read_by_its_suffix_in_small_letters(file: Path) -> None:
    register("points", lambda path: RIGHT)
    scene = load_scene(file)
    assert scene.geometry is RIGHT
    assert scene.up.tolist() == [0, -1, 0]


def test_a_plugin_may_read_another_format_of_what_we_draw(file: Path) -> None:
    register("points", lambda path: synthetic_room(50))
    assert isinstance(load_scene(file).geometry, Splats)


def test_two_readers_of_one_suffix_are_told_where_it_is_read(file: Path) -> None:
    register("points", lambda path: RIGHT)
    register("dots", lambda path: RIGHT)
    with pytest.raises(ModelError, match=r"\.pts is read by renderers dots and points, expected one \(allow only one"):
        load_scene(file)


WRONG = [
    (None, "got NoneType without renderer, means, label, __len__, with_label"),
    (replace(RIGHT, means=torch.zeros(0, 3), label=torch.zeros(0)), "got no primitive"),
    (
        replace(RIGHT, means=torch.zeros(5, 2)),
        r"got means \(5, 2\) torch.float32, not \(5, 3\) floating point on the CPU",
    ),
    (replace(RIGHT, means=RIGHT.means * torch.nan), "got means that is not finite"),
    (replace(RIGHT, label=torch.zeros(4)), r"got label \(4,\) torch.float32, not \(5,\)"),
    (replace(RIGHT, label=torch.zeros(5, dtype=torch.int64)), r"got label \(5,\) torch.int64"),
    (replace(RIGHT, label=[0.0] * 5), "got label that is list and no tensor"),
    (replace(RIGHT, label=torch.zeros(5, requires_grad=True)), "got label on cpu with gradient"),
    (replace(RIGHT, label=torch.full((5,), 2.0)), r"got label outside \[0, 1\]"),
]


@pytest.mark.parametrize(("geometry", "line"), WRONG)
def test_what_is_no_geometry_is_told_with_what_it_lacks(file: Path, geometry: Any, line: str) -> None:
    register("points", lambda path: geometry)
    with pytest.raises(ModelError, match=f"stage.PTS: renderer points: expected a geometry, {line}.*geometry.py"):
        load_scene(file)


def test_a_geometry_that_no_renderer_draws_is_refused(file: Path) -> None:
    register("dots", lambda path: RIGHT)
    with pytest.raises(ModelError, match="got renderer = 'points', which nobody has registered"):
        load_scene(file)


def test_a_label_that_gets_lost_is_told_before_the_lift(file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    register("points", lambda path: RIGHT)
    monkeypatch.setattr(Points, "with_label", lambda self, label: None)
    with pytest.raises(ModelError, match="got after with_label NoneType without renderer"):
        load_scene(file)


def test_what_a_reader_raises_is_told_with_its_name_and_the_file(file: Path) -> None:
    def raising(path: Path) -> Any:
        raise KeyError("sky")

    def damaged(path: Path) -> Any:
        raise InputError(path, "header", "expected points")

    register("points", raising)
    with pytest.raises(
        ModelError, match=r"stage\.PTS: renderer points: expected a geometry from read, it raised KeyErr"
    ):
        load_scene(file)
    register("dots", damaged, ".dots")
    with pytest.raises(InputError, match=r"stage\.dots: header: expected points"):
        load_scene(file.rename(file.with_suffix(".dots")))
    with pytest.raises(InputError, match=r"gone\.pts: no such file"):
        load_scene(file.with_name("gone.pts"))


@pytest.mark.parametrize("suffix", [*SCENE_SUFFIXES, "pts", ".PTS", "", ".tar.gz"])
def test_a_suffix_of_ours_or_none_cannot_be_taken(suffix: str) -> None:
    with pytest.raises(ModelError, match=r"class Reader has suffixes = .*write suffixes = \(\"\.mine\",\)"):
        register("points", lambda path: RIGHT, suffix)


def test_a_reader_that_needs_options_or_is_missing_is_refused() -> None:
    @dataclass(frozen=True)
    class Forgot(Drawer):
        suffixes: ClassVar[tuple[str, ...]] = (".pts",)

    @dataclass(frozen=True)
    class Bound(Forgot):
        def read(self, path: Path) -> Any:
            return RIGHT

    for cls, found in ((Forgot, "Forgot has no read"), (Bound, "Bound has read = ")):
        with pytest.raises(ModelError, match=rf"{found}.*expected a static or class method"):
            RENDERERS.register("points")(cls)


def test_suffixes_that_only_a_component_could_tell_are_refused() -> None:
    @dataclass(frozen=True)
    class Late(Drawer):
        read = staticmethod(lambda path: RIGHT)

        @property
        def suffixes(self) -> tuple[str, ...]:
            return (".pts",)

    with pytest.raises(ModelError, match=r"class Late has suffixes = <property.*write suffixes = \(\"\.mine\",\)"):
        RENDERERS.register("points")(Late)


def test_every_suffix_that_cannot_be_taken_is_read_by_us(tmp_path: Path) -> None:
    for suffix in SCENE_SUFFIXES:
        with pytest.raises(InputError, match="no such file"):
            load_scene(tmp_path / f"gone{suffix}")


def test_what_only_splats_have_is_skipped_or_refused_in_one_line(file: Path) -> None:
    register("points", lambda path: RIGHT)
    scene = load_scene(file)
    assert without_floaters(scene) is scene
    with pytest.raises(UsageError, match=r"stage: lod: expected Gaussian splats, got Points \(set lod=0\)"):
        working_set(scene, sample_cameras(0, 1), 2.0)
    with pytest.raises(UsageError, match=r"expected Gaussian splats, got Points \(only these can be simplified\)"):
        simplify_file(str(file), file.with_name("out.ply"), [], Simplification("drop", k=0))


def test_what_we_read_ourselves_is_a_geometry() -> None:
    mesh = Mesh.plain(torch.rand(3, 3), torch.tensor([[0, 1, 2]]))
    ours: list[Geometry] = [synthetic_room(20), mesh]  # mypy holds them against the protocol
    assert [lacking(geometry, RENDERERS.names()) for geometry in ours] == ["", ""]


def test_a_scene_is_drawn_by_what_has_read_it_whatever_the_config_is_about(file: Path) -> None:
    register("points", lambda path: RIGHT)
    points, splats = RENDERERS.build("points"), RENDERERS.build("gaussian_splats")
    ours, theirs = load_scene("builtin:plaza"), load_scene(file)
    for scene, renderer in ((ours, splats), (theirs, points)):
        assert [renderer_of(scene, configured) for configured in (points, splats)] == [renderer, renderer]
    another = Drawer()  # of our splats, as it reads nothing
    assert renderer_of(ours, another) is another
    assert renderer_of(theirs, another) == points


def test_a_renderer_that_says_what_it_draws_is_given_no_other_scene() -> None:
    @dataclass(frozen=True)
    class Dots(Drawer):
        draws: ClassVar[tuple[str, ...]] = ("gaussian_splats",)

    RENDERERS.register("dots")(Dots)
    splats, dots, cameras = load_scene("builtin:plaza"), Dots(), sample_cameras(0, 1)
    mesh = replace(splats, geometry=Mesh.plain(torch.rand(3, 3), torch.tensor([[0, 1, 2]])))
    assert renderer_of(splats, dots) is dots
    assert renderer_of(mesh, dots) == RENDERERS.build("mesh")
    with pytest.raises(ModelError, match=r"^renderer dots: expected image, it raised NotImplementedError"):
        drawn_by(dots, splats, cameras, frozenset({"image"}))
    with pytest.raises(UsageError, match=r"^plaza: renderer dots: does not draw Mesh \(choose: renderer.mesh=\{\}\)$"):
        drawn_by(dots, mesh, cameras, frozenset({"image"}))
    Dots.draws = "gaussian_splats"  # type: ignore[assignment]  # as it is easily written
    with pytest.raises(ModelError, match=r"has draws = .*expected a tuple .*write draws = \(\"gaussian_splats\",\)"):
        RENDERERS.register("dots")(Dots)


READER = """
from dataclasses import dataclass, replace
import torch
from cltransfer import RENDERERS

@dataclass(frozen=True, eq=False)
class Dots:
    renderer, means, label = "dots", torch.zeros(4, 3), torch.zeros(4)
    __len__ = lambda self: 4
    with_label = lambda self, label: self

@RENDERERS.register("dots")
@dataclass(frozen=True)
class Drawer:
    option: int
    provides, suffixes, render = ("image",), (".dots",), print
    read = staticmethod(lambda path: Dots())
"""


OURS = "from cltransfer.bench.synthetic_room import synthetic_room\n"


@pytest.mark.parametrize("source", [READER, OURS + READER.replace("Dots()", "synthetic_room(50)")])
def test_what_is_kept_of_a_scene_is_kept_for_the_code_that_has_read_it(tmp_path: Path, source: str) -> None:
    (tmp_path / "stage.dots").write_bytes(b"")
    seen = set()
    for change in ("", "# it reads other primitives now\n"):
        (tmp_path / "dots.py").write_text(source + change)
        allow([tmp_path / "dots.py"])
        kept = cached_lift(load_scene(tmp_path / "stage.dots"), GaussianSplats(), {})
        seen |= {str(kept), digest(str(tmp_path / "stage.dots"))}
        del RENDERERS._classes["dots"]
    assert len(seen) == 4
