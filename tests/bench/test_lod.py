from __future__ import annotations

import csv
from dataclasses import replace
from pathlib import Path

import pytest
import torch

from cltransfer.bench.lod import LodRow, composition, labelled_scene, population, room_scene, run_lod, write_csv
from cltransfer.bench.lod_chart import write_chart, write_lod
from cltransfer.bench.synthetic_room import synthetic_room
from cltransfer.errors import InputError
from cltransfer.features import Features
from cltransfer.scenes.ply import write_splats


@pytest.fixture(scope="module")
def rows() -> list[LodRow]:
    return list(run_lod([room_scene(5_000)], [0], (0.0, 8.0)))


def test_the_full_scene_agrees_with_itself(rows: list[LodRow]) -> None:
    full = rows[0]
    assert (full.early, full.middle, full.late, full.photometric, full.depth) == pytest.approx((1,) * 5)
    assert (full.depth_median, full.mask_area) == pytest.approx((0, 1))
    assert full.psnr > 100


def test_a_merged_scene_is_smaller_and_ranks_nearly_alike(rows: list[LodRow]) -> None:
    merged = rows[1]
    assert merged.gaussians < 0.95 * rows[0].gaussians
    assert 15 < merged.psnr < 60
    assert 0.5 < merged.early <= 1


def test_composition_is_the_centroid_and_area_of_the_subject() -> None:
    label = torch.zeros(1, 4, 8)
    label[0, 1:3, 4:6] = 1
    centroid, area = composition(Features((8, 4), label=label))
    assert centroid[0].tolist() == pytest.approx([5 / 8, 2 / 4])
    assert float(area) == pytest.approx(4 / 32)


def test_candidates_see_the_subject_and_the_first_is_what_they_are_after() -> None:
    scene = room_scene(2_000)
    still, crowd = population(scene, 0.0, 0), population(scene, 0.03, 0)
    middle = scene.geometry.means[scene.geometry.label > 0.5].double().median(0).values
    pixels = crowd.project(middle[None])[0][:, 0]
    assert bool(((pixels > 0) & (pixels < torch.tensor([160, 90]))).all())
    height = float((still.center[0] - middle).norm()) / (2 * 1.04**0.5)
    away = (crowd.center - still.center[0]).norm(dim=1)
    assert float(away[0]) == pytest.approx(2 * 0.03 * height, rel=1e-6)


def test_rows_are_written_as_csv_and_drawn(rows: list[LodRow], tmp_path: Path) -> None:
    write_lod(rows, tmp_path, "bench lod")
    with (tmp_path / "lod.csv").open(newline="") as stream:
        read = list(csv.DictReader(stream))
    assert [float(row["k"]) for row in read] == [0, 8]
    assert float(read[1]["psnr"]) == pytest.approx(rows[1].psnr, rel=1e-4)
    first = (tmp_path / "lod.svg").read_bytes()
    write_chart(rows, tmp_path / "lod.svg")
    assert (tmp_path / "lod.svg").read_bytes() == first
    assert b">8<" in first
    page = (tmp_path / "benchmarks.md").read_text()
    assert "## Level of detail" in page
    assert "Made by `bench lod`." in page
    assert f"| room 5k | 8 | {rows[1].gaussians:,} |" in page


def test_no_scene_is_a_formula_and_every_number_stays_one(rows: list[LodRow], tmp_path: Path) -> None:
    write_csv([replace(rows[0], scene="=1+1", early=-0.5)], tmp_path / "lod.csv")
    (row,) = csv.DictReader((tmp_path / "lod.csv").read_text().splitlines())
    assert (row["scene"], row["early"]) == ("'=1+1", "-0.5")


def test_a_file_needs_members_that_are_its_subject(tmp_path: Path) -> None:
    write_splats(tmp_path / "room.ply", synthetic_room(200))
    assert float(labelled_scene(tmp_path / "room.ply", 50).geometry.label.sum()) == 50
    with pytest.raises(InputError, match="--members: expected 1 to 199, got 200"):
        labelled_scene(tmp_path / "room.ply", 200)
