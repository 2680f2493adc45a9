"""The plan of the stage and its settings: what each one changes in the jobs, and that the jobs fit their functions."""

from math import inf
from types import SimpleNamespace

import pytest
from box_scene import CENTRES, DSM, block, heights
from pydantic import ValidationError

from orthomill.pipeline.engine.job_signature import misfit
from orthomill.schemas.job import Export, Job, Raster
from orthomill.schemas.orientation import BLOCK
from orthomill.schemas.photo import PHOTOS, Photo, Photos
from orthomill.schemas.raster import RasterSpec, Window
from orthomill.schemas.surface import CHECKED_SURFACE, CORRECTED, GIVEN_HEIGHT, HEIGHT, ORTHO, SURFACE, Surface
from orthomill.tasks.colouring.blending.blending import Blend
from orthomill.tasks.colouring.blending.rejection import Rejection
from orthomill.tasks.colouring.colour_settings import SAMPLES_AT_MOST
from orthomill.tasks.texture.ground.relief import RELIEF, tile_relief
from orthomill.tasks.texture.plan import orthoimage_jobs
from orthomill.tasks.texture.stage import TextureStage


class View:
    """The box scene at planning time."""

    def __init__(self, tile: int = 128, dtype: str = "uint8", check: bool = False, measured: bool = True) -> None:
        self.project = SimpleNamespace(tile=tile)
        self.dtype, self.stages = dtype, ("dsm_check",) * check + ("densification",) * measured
        facts = {"width": 420, "height": 420, "bands": 3, "dtype": dtype, "camera": "test", "levels": 4}
        shown = Photos(photos=tuple(Photo(name=name, path=name, **facts) for name in CENTRES))
        surface = Surface(grid=DSM, height_low=-2.0, height_high=16.0)
        relief = tile_relief(heights(), Window(0, 0, *DSM.shape))
        given = SURFACE if measured else CHECKED_SURFACE
        self.known = {BLOCK.path: block(), PHOTOS.path: shown, given.path: surface, RELIEF.path: relief}

    def table(self, table):
        return self.known[table.path]

    def raster(self, name):
        level = int(name.rpartition("/")[2])
        return RasterSpec(name=name, shape=(-(-420 // 2**level), -(-420 // 2**level), 3), dtype=self.dtype, chunk=128)

    def has_stage(self, kind):
        return kind in self.stages


def planned(view: View | None = None, **settings) -> list:
    return list(TextureStage(**settings).plan(view or View()))


def jobs(made: list, item: str) -> list[Job]:
    return [one for one in made if isinstance(one, Job) and one.item == item]


def rules(**settings):
    (found,) = {job.params["rules"] for job in jobs(planned(**settings), "ortho")}
    return found


def test_all_jobs_fit_their_functions_and_have_names_of_their_own():
    made = [one for one in planned() if isinstance(one, Job)]
    assert [misfit(job) for job in made if misfit(job)] == []
    assert len({job.key for job in made}) == len(made)
    assert len(jobs(made, "ortho")) == len(jobs(made, "samples")) == 4


def test_rasters_are_announced_before_the_jobs_that_write_them():
    made = planned()
    names = [one.name for one in made if isinstance(one, RasterSpec)]
    assert names[:5] == ["texture/ortho", "texture/coverage", "texture/rejected", "texture/height_source", "texture/source"]
    assert names[5:] == ["texture/block_heights", "texture/block_weights", "texture/ground"]
    assert [isinstance(one, RasterSpec) for one in made[:7]] == [True] * 7
    assert {raster.name for job in jobs(made, "ortho") for raster in job.writes.values() if isinstance(raster, Raster)} == set(
        names[:5]
    )


@pytest.mark.parametrize(("check", "raster"), [(False, HEIGHT), (True, CORRECTED)])
def test_corrected_heights_are_used_where_there_is_a_check(check, raster):
    made = planned(View(check=check))
    assert {job.reads["heights"].name for job in jobs(made, "ortho")} == {raster}
    (cells,) = (one for one in made if isinstance(one, Export) and one.path == "products/dsm_cells.laz")
    assert cells.rasters["z"] == raster


def test_a_surface_that_was_only_checked_is_painted_without_a_matched_one():
    made = planned(View(check=True, measured=False))
    read = {raster.name for one in made if isinstance(one, Job) for raster in one.reads.values() if isinstance(raster, Raster)}
    assert GIVEN_HEIGHT in read and not [name for name in read if name.startswith("densification")]
    paths = {one.path for one in made if isinstance(one, Export)}
    assert "products/ortho.tif" in paths and not [path for path in paths if path.endswith(".laz")]


@pytest.mark.parametrize(("cell", "expected"), [("auto", 0.5), (1.0, 1.0), (0.25, 0.25)])
def test_the_cell_of_the_orthoimage(cell, expected):
    made = planned(cell=cell)
    assert jobs(made, "ortho")[0].params["extent"].ortho.cell == expected
    (spec,) = (one for one in made if isinstance(one, RasterSpec) and one.name == "texture/coverage")
    assert spec.shape == (round(120 / expected), round(120 / expected))


def test_samples_come_from_a_coarser_level_than_colours():
    made = planned(cell=0.5)
    levels = {
        item: {part.level for job in jobs(made, item) for part in job.params["extent"].photos} for item in ("ortho", "samples")
    }
    assert levels == {"ortho": {0}, "samples": {2}}


@pytest.mark.parametrize(
    ("holes", "cells"), [({"kind": "leave"}, 0), ({"kind": "drape", "max_gap": 7.5}, 7.5), ({"kind": "drape"}, inf), (None, inf)]
)
def test_holes_are_draped_up_to_the_gap(holes, cells):
    assert rules(**({"holes": holes} if holes else {})).drape_reach == cells


def test_the_ground_is_made_and_read_only_for_draping():
    draped, left = planned(), planned(holes={"kind": "leave"})
    assert len(jobs(draped, "blocks")) == len(jobs(draped, "ground")) == 1 and not jobs(left, "blocks") + jobs(left, "ground")
    assert all("ground" in job.reads for job in jobs(draped, "ortho")) and not any(
        "ground" in job.reads for job in jobs(left, "ortho")
    )


def test_points_are_the_matched_ones_of_all_tiles():
    (points,) = (one for one in planned(View(tile=64)) if isinstance(one, Export) and one.path == "products/points.laz")
    assert [table.path for table in points.tables] == [
        f"densification/points/{row}-{col}.parquet" for row in (0, 1) for col in (0, 1)
    ]
    assert points.rasters == {"rgb": "texture/ortho"}


def test_points_of_a_large_model_are_one_file_for_each_tile(monkeypatch):
    monkeypatch.setattr(orthoimage_jobs, "CELLS_OF_ONE_FILE", 119 * 120)
    clouds = [one for one in planned(View(tile=64)) if isinstance(one, Export) and "points" in one.path]
    assert [one.path for one in clouds] == [f"products/points/{row}-{col}.laz" for row in (0, 1) for col in (0, 1)]
    assert [len(one.tables) for one in clouds] == [1] * 4 and len({one.key for one in clouds}) == 4


def test_the_source_of_heights_is_a_product():
    (product,) = (one for one in planned() if isinstance(one, Export) and one.path == "products/ortho_height_source.tif")
    assert product.rasters == {"height_source": "texture/height_source"}


@pytest.mark.parametrize(("kind", "power"), [("area", 1), ("area_squared", 2)])
def test_the_power_of_the_area(kind, power):
    assert rules(weights={"kind": kind}).colours.blend.power == power


@pytest.mark.parametrize(
    ("settings", "rule"),
    [
        ({"kind": "none"}, Rejection("none")),
        ({"kind": "mean", "k": 1.5, "least": 7.0}, Rejection("mean", 1.5, 7.0)),
        ({"kind": "median", "least": 3.0}, Rejection("median", 1.0, 3.0)),
        ({"kind": "robust", "least": 9.0}, Rejection("deviation", 3.0, 9.0)),
    ],
)
def test_rejection_has_its_centre_its_limit_and_its_least_deviation(settings, rule):
    assert rules(rejection=settings).colours.blend.rejection == rule


@pytest.mark.parametrize(("settings", "limit"), [({"kind": "average"}, 0.0), ({"kind": "prefer", "limit": 25.0}, 25.0)])
def test_two_colours_are_averaged_or_the_heavier_one_preferred(settings, limit):
    assert rules(two_colours=settings).colours.blend.two_limit == limit


def test_the_photo_at_a_break_of_its_depth_may_be_the_one_that_goes():
    broken = rules(two_colours={"kind": "depth_break", "limit": 30.0})
    assert broken.colours.breaks and broken.colours.blend.two_limit == 30.0
    assert not rules(two_colours={"kind": "prefer"}).colours.breaks


def test_the_number_of_blended_photos():
    assert rules(best=3).colours.blend == Blend(Rejection("mean", 1.0, 12.0), 1, 3, 0.0)


@pytest.mark.parametrize(("margin", "ramp", "rim"), [(0.0, 0.0, 2), (1.0, 2.0, 5), (3.5, 4.0, 10)])
def test_the_rim_of_occlusions_widens_what_a_tile_reads(margin, ramp, rim):
    found = rules(occlusion_margin=margin, occlusion_ramp=ramp, edges={"kind": "keep"})
    assert (found.widening_margin, found.widening_ramp, found.rim) == (margin, ramp, rim)
    assert found.halo == 32 + rim + 1


def test_edges_are_sharpened_unless_they_are_kept():
    """What takes part in the choice of a surface lies up to 9 cells (colours) and 17 (heights) beyond the rim."""
    sharp, kept = rules(), rules(edges={"kind": "keep"})
    assert sharp.sharpen and sharp.around == sharp.rim + 9 and sharp.halo == kept.halo + 17
    assert not kept.sharpen and kept.around == 0


@pytest.mark.parametrize(("tolerance", "expected"), [("auto", 0.5), (0.0, 0.0), (1.25, 1.25)])
def test_the_tolerance_of_visibility(tolerance, expected):
    assert rules(tolerance=tolerance).tolerance == expected


def test_the_bridge_and_the_feather():
    found = rules(bridge=50, feather=0.3, edges={"kind": "keep"})
    assert found.bridge == 50 and found.colours.feather == 0.3 and found.halo == 50 + found.rim + 1


@pytest.mark.parametrize(
    ("settings", "params"),
    [
        ({"kind": "block"}, {"deep": False, "method": "block", "vignetting": True}),
        ({"kind": "block", "vignetting": False}, {"deep": False, "method": "block", "vignetting": False}),
        ({"kind": "none"}, {"deep": False, "method": "none", "vignetting": False}),
    ],
)
def test_the_method_of_the_balance(settings, params):
    (job,) = jobs(planned(balance=settings), "balance")
    assert job.params == params


def test_sixteen_bits_are_stretched():
    specs = planned(View(dtype="uint16"))
    (job,) = jobs(specs, "balance")
    assert job.params["deep"] is True
    assert {job.params["rules"].bits for job in jobs(specs, "ortho")} == {16}
    assert [spec.dtype for spec in specs if isinstance(spec, RasterSpec) and spec.name == ORTHO] == ["uint16"]


@pytest.mark.parametrize(
    ("settings", "spacing"), [({"kind": "block", "spacing": 10}, 10), ({"kind": "block"}, 24), ({"kind": "none"}, 64)]
)
def test_the_spacing_of_samples(settings, spacing):
    assert {job.params["spacing"] for job in jobs(planned(balance=settings), "samples")} == {spacing}


def test_a_large_orthoimage_has_samples_farther_apart():
    spacing = jobs(planned(View(tile=2048), cell=0.05, balance={"kind": "block", "spacing": 4}), "samples")[0].params["spacing"]
    assert spacing == 10 and 2400 * 2400 / spacing**2 <= SAMPLES_AT_MOST < 2400 * 2400 / (spacing - 1) ** 2


def test_two_colours_without_effect_are_refused():
    with pytest.raises(ValidationError, match="two_colours: prefer without effect with best: 1"):
        TextureStage(two_colours={"kind": "prefer"}, best=1)
    assert TextureStage(two_colours={"kind": "prefer"}, best=2).best == 2
