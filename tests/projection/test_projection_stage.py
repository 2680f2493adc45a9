"""The whole stage in memory on a wall with a box in front of it, whose colours and shadows are known."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from orthomill.schemas.camera import BrownLens, Camera
from orthomill.schemas.errors import WorkflowError
from orthomill.schemas.job import Job, Stream
from orthomill.schemas.raster import MapGrid, RasterSpec
from orthomill.schemas.solid.mesh import TriangleMesh
from orthomill.schemas.stage_contract import NotYet
from orthomill.schemas.stage_report import Topic
from orthomill.schemas.surface import HEIGHT, SURFACE, Surface
from orthomill.tasks.colouring.blending.blending import RESERVE
from orthomill.tasks.colouring.blending.reserves import ZONE_WEIGHT, fading, reserved
from orthomill.tasks.colouring.sight.sight_rasters import sight_tile
from orthomill.tasks.geometry.view import View, block_view
from orthomill.tasks.projection.frames.projection_frames import looking_at
from orthomill.tasks.projection.report.projection_report import projection_report
from orthomill.tasks.projection.stage import ProjectionStage
from orthomill.tasks.visibility.sight import PlaceSight
from tests.support.engine.memory_runner import MemoryProject
from tests.support.solid import wall_and_box as scene

FRONT = {
    "kind": "plane",
    "name": "front",
    "plane": {"kind": "normal", "point": (0.0, 0.0, 1.5), "normal": (0.0, -1.0, 0.0)},
    "pixel": 0.025,
    "size": (4.0, 3.0),
}


def stage(**more) -> ProjectionStage:
    given = {"surface": {"kind": "mesh", "path": "mesh.ply"}, "outputs": [FRONT], "balance": {"kind": "none"}}
    # Beside the wall its photographs are black, which is no border here: what is seen is compared with what rays tell.
    given |= {"model": {"kind": "none"}, "depth_pictures": False, "masks": {"kind": "none"}, **more}
    return ProjectionStage.model_validate(given)


def front_truth() -> tuple[np.ndarray, np.ndarray]:
    """Points (rows, cols, 3) that the front shows, and their colours."""
    x, z = np.meshgrid(-2 + (np.arange(160) + 0.5) * 0.025, 3 - (np.arange(120) + 0.5) * 0.025)
    start = np.column_stack([x.ravel(), np.full(x.size, -50.0), z.ravel()])
    points, box, _ = scene.traced(start, np.tile([0.0, 1.0, 0.0], (x.size, 1)))
    return points.reshape(120, 160, 3), scene.colour(points, box).reshape(120, 160, 3)


@pytest.fixture(scope="module")
def plain() -> MemoryProject:
    project = scene.project_of(MemoryProject)
    project.run(stage())
    return project


def test_front_has_the_colours_of_the_wall_and_of_the_box(plain):
    ortho, (_, truth) = plain.rasters["projection/front/ortho"], front_truth()
    known = ortho[..., 3] > 0
    error = np.abs(ortho[..., :3] - truth).mean(axis=2)[known]
    assert known.mean() > 0.97
    assert np.percentile(error, 95) < 3.0


def test_coverage_is_what_rays_to_every_photograph_tell(plain, record_property):
    points, _ = front_truth()
    views = [block_view(scene.block(), name) for name in scene.NAMES]
    expected = sum(scene.sees(view, points.reshape(-1, 3)).astype(int) for view in views).reshape(120, 160)
    same = np.mean(plain.rasters["projection/front/coverage"] == expected)
    record_property("found", f"the same at {same:.2%} of the pixels")
    assert same > 0.995


def test_depth_is_the_distance_from_the_plane(plain):
    points, _ = front_truth()
    np.testing.assert_allclose(plain.rasters["projection/front/nearness"], -points[..., 1], atol=1e-6)


def test_a_photograph_left_out_is_made_again_and_blending_is_no_worse_than_the_nearest(plain, record_property):
    for number, name in enumerate(scene.NAMES):
        result = plain.tables[f"projection/left_out_{number}.json"]
        assert result.photo == name and result.covered > 0.35
        best, single = result.blended, result.nearest
        record_property("found", f"{best.psnr:.1f} dB ({single.psnr:.1f}), SSIM {best.ssim:.3f}, gradient {best.gradient:.0%}")
        assert result.blended.psnr > 27 and result.blended.ssim > 0.95
        assert result.blended.gradient > 0.9
        assert result.blended.psnr > result.nearest.psnr - 0.5


def test_tiles_of_any_size_give_the_same_picture(plain):
    other = scene.project_of(MemoryProject, tile=64)
    other.run(stage(leave_one_out={"kind": "none"}))
    for layer in ("ortho", "coverage", "sight", "triangle", "rejected"):
        assert np.array_equal(other.rasters[f"projection/front/{layer}"], plain.rasters[f"projection/front/{layer}"]), layer
    assert "projection/left_out_0/blended" not in other.rasters


def of(outputs=None, **more) -> dict[str, np.ndarray]:
    """The rasters of a run with other settings."""
    project = scene.project_of(MemoryProject)
    project.run(stage(leave_one_out={"kind": "none"}, outputs=outputs or [FRONT], **more))
    return project.rasters


def test_a_tile_holds_the_depths_of_one_photograph_at_a_time(plain, record_property):
    """A tile of a coarse picture shows the whole of every photograph: two dozen of them would not fit into a worker."""
    jobs = [job for job in stage().plan(plain) if isinstance(job, Job) and job.function is sight_tile]
    photographs = max(len(job.reads["nearness"].regions) for job in jobs)
    record_property("found", f"{photographs} photographs in a tile, the depths of one at a time, stored in tiles")
    assert photographs > 2
    assert all(isinstance(job.reads[key], Stream) for job in jobs for key in ("nearness", "drawn"))
    stored = [spec for name, spec in plain.specs.items() if name.endswith("/nearness") and "photographs" in name]
    assert stored and all(max(spec.chunks) <= 128 for spec in stored)
    masked = scene.project_of(MemoryProject)
    masked.files["masks/b.png"] = np.full((180, 240, 1), 255, np.uint8)
    given = stage(leave_one_out={"kind": "none"}, masks={"kind": "folder", "path": "masks"})
    masked.run(given)
    jobs = [job for job in given.plan(masked) if isinstance(job, Job) and job.function is sight_tile]
    assert {len(job.reads["masks"].regions) for job in jobs} == {1}


def test_planning_waits_for_no_single_tile(plain):
    """Each table that planning waits for is a reason to plan again, from the beginning: hundreds of tiles would be hundreds."""
    waiting = replace(plain, tables={path: table for path, table in plain.tables.items() if "/surface/" not in path})
    assert len(waiting.tables) < len(plain.tables)
    assert sum(isinstance(thing, Job) for thing in stage().plan(waiting)) == len(plain.keys)
    without = replace(plain, tables={path: table for path, table in plain.tables.items() if path != "projection/surfaces.json"})
    with pytest.raises(NotYet, match="surfaces"):
        list(stage().plan(without))


def test_photographs_switched_off_contribute_nothing():
    rasters = of(without=("b", "[cd]"))
    assert rasters["projection/front/sight"].shape == (120, 160, 1)
    assert rasters["projection/front/coverage"][rasters["projection/front/triangle"] >= 0].max() == 1


def test_a_pattern_that_matches_no_photograph_is_refused():
    with pytest.raises(WorkflowError, match="names x, but no oriented photograph"):
        of(without=("x",))
    with pytest.raises(WorkflowError, match="leaves none of the 4"):
        of(without=("*",))


def test_masked_pixels_are_not_used():
    project = scene.project_of(MemoryProject)
    mask = np.full((180, 240, 1), 255, np.uint8)
    mask[:, :120] = 0
    project.files["masks/b.png"] = mask
    project.run(stage(leave_one_out={"kind": "none"}, masks={"kind": "folder", "path": "masks"}))
    sight = project.rasters["projection/front/sight"]
    view, (points, _) = block_view(scene.block(), "b"), front_truth()
    pixels = view.project(points.reshape(-1, 3)).reshape(120, 160, 2)
    masked = sight[..., 1] == PlaceSight.MASKED
    assert masked.any() and pixels[masked][:, 0].max() < 120 and not (sight[..., [0, 2, 3]] == PlaceSight.MASKED).any()
    seen = sight[..., 1] >= PlaceSight.AT_BREAK
    assert pixels[seen][:, 0].min() >= 119.5


@pytest.mark.parametrize(
    "section",
    [
        {"kind": "plane", "point": (0.0, -0.4, 0.0), "normal": (0.0, -2.0, 0.0)},
        {"kind": "box", "low": (-0.5, -1.2, -0.1), "high": (0.5, -0.5, 2.2), "keep": "outside"},
        {"kind": "prism", "polygon": ((-0.5, -1.2), (0.5, -1.2), (0.5, -0.5), (-0.5, -0.5)), "keep": "outside"},
        {"kind": "prism", "polygon": ((-3, 1), (3, 1), (3, -0.4), (-3, -0.4)), "keep": "inside"},
    ],
    ids=lambda section: section["kind"],
)
def test_a_section_shows_the_wall_behind_the_box_coloured_by_those_that_see_it(section, record_property):
    rasters = of([{**FRONT, "section": section}])
    points, _ = front_truth()
    wall = np.stack([points[..., 0], np.zeros((120, 160)), points[..., 2]], axis=2).reshape(-1, 3)
    seen = sum(scene.sees(block_view(scene.block(), name), wall).astype(int) for name in scene.NAMES).reshape(120, 160)
    truth = scene.colour(wall, np.zeros(len(wall), bool)).reshape(120, 160, 3)
    ortho = rasters["projection/front/ortho"]
    np.testing.assert_allclose(rasters["projection/front/nearness"], 0.0, atol=1e-6)
    same = np.mean(rasters["projection/front/coverage"] == seen)
    error = np.percentile(np.abs(ortho[..., :3] - truth).mean(axis=2)[ortho[..., 3] > 0], 95)
    record_property("found", f"those that see it at {same:.2%} of the pixels; colour within {error:.1f} grey levels at 95 %")
    assert same > 0.995 and error < 3.0


def test_a_view_with_distortion_is_what_the_camera_there_would_see(record_property):
    output = {"kind": "photograph", "name": "again", "photo": "b", "itself": True, "distortion": "kept"}
    ortho = of([output])["projection/again/ortho"]
    own = scene.photograph(block_view(scene.block(), "b"))
    known = (ortho[..., 3] > 0) & (own.max(axis=2) > 0)
    assert known.mean() > 0.4
    worst = np.percentile(np.abs(ortho[..., :3].astype(float) - own).mean(axis=2)[known], 95)
    window = np.s_[40:140, 60:180]
    (dx, dy), _ = cv2.phaseCorrelate(*(grey[window].astype(float).mean(axis=2) for grey in (own, ortho[..., :3])))
    record_property("found", f"{np.hypot(dx, dy):.2f} px; {worst:.1f} grey levels at 95 %")
    assert worst < 4.0 and np.hypot(dx, dy) < 0.5


def test_a_photograph_without_itself_and_without_distortion():
    output = {"kind": "photograph", "name": "again", "photo": "b", "itself": False, "distortion": "removed"}
    rasters = of([output])
    assert rasters["projection/again/sight"].shape == (180, 240, 3)
    ideal = scene.CAMERA.model_copy(update={"lens": BrownLens()})
    own = scene.photograph(block_view(scene.block(camera=ideal), "b"))
    ortho = rasters["projection/again/ortho"]
    known = (ortho[..., 3] > 0) & (own.max(axis=2) > 0)
    assert np.percentile(np.abs(ortho[..., :3].astype(float) - own).mean(axis=2)[known], 90) < 4.0


def test_a_perspective_view_looks_at_its_target():
    output = {"kind": "perspective", "name": "view", "position": (1.0, -4.0, 2.0), "target": (0.0, 0.0, 1.4)}
    ortho = of([{**output, "width": 200, "height": 150, "c": 160.0, "k1": -0.04, "k2": 0.01}])["projection/view/ortho"]
    camera = Camera(name="view", width=200, height=150, c=160.0, k1=-0.04, k2=0.01)
    turn = looking_at(np.array([1.0, -4.0, 2.0]), np.array([0.0, 0.0, 1.4]))
    own = scene.photograph(View("view", camera, turn, np.array([1.0, -4.0, 2.0])))
    known = (ortho[..., 3] > 0) & (own.max(axis=2) > 0)
    assert known.mean() > 0.3
    assert np.percentile(np.abs(ortho[..., :3].astype(float) - own).mean(axis=2)[known], 95) < 4.0


def test_the_map_shows_the_top_of_the_box_and_no_wall():
    rasters = of([{"kind": "map", "name": "plan", "pixel": 0.05}])
    heights = rasters["projection/plan/nearness"]
    assert np.nanmax(heights) - np.nanmin(heights) < 3.01
    assert rasters["projection/plan/sight"].max() <= PlaceSight.SEEN


def test_an_oblique_picture_shows_what_oblique_rays_meet_and_one_photograph_only_what_it_sees():
    oblique = {**FRONT, "name": "oblique", "towards": (0.5, -1.0, 0.3), "pixel": 0.05}
    rasters = of([oblique, {**oblique, "name": "alone", "only": "b"}])
    towards = np.array([0.5, -1.0, 0.3]) / np.linalg.norm([0.5, -1.0, 0.3])
    x, z = np.meshgrid(-2 + (np.arange(80) + 0.5) * 0.05, 3 - (np.arange(60) + 0.5) * 0.05)
    start = np.column_stack([x.ravel(), np.zeros(x.size), z.ravel()]) + 50.0 * towards
    points, box, _ = scene.traced(start, np.tile(-towards, (x.size, 1)))
    truth = scene.colour(points, box).reshape(60, 80, 3)
    blended, alone = (rasters[f"projection/{name}/ortho"] for name in ("oblique", "alone"))
    for ortho in (blended, alone):
        known = ortho[..., 3] > 0
        assert known.mean() > 0.3
        assert np.percentile(np.abs(ortho[..., :3].astype(float) - truth).mean(axis=2)[known], 85) < 4.0
    assert (alone[..., 3] > 0).sum() < (blended[..., 3] > 0).sum(), "holes where it sees nothing"


def test_holes_of_a_photograph_that_was_asked_for_alone_are_no_doubt():
    project = scene.project_of(MemoryProject)
    outputs = [{**FRONT, "pixel": 0.1}, {**FRONT, "name": "alone", "only": "b", "pixel": 0.1}]
    project.run(stage(outputs=outputs, leave_one_out={"kind": "none"}))
    report = project.tables["projection/report.json"]
    assert "'front'" in report.verdict.sentence and not any("alone" in one for one in (*report.warnings, *report.losses))


def test_inward_faces_are_turned_and_a_way_that_is_set_is_kept():
    project = scene.project_of(MemoryProject)
    mesh = project.files["mesh.ply"]
    project.files["mesh.ply"] = TriangleMesh(mesh.vertices, mesh.triangles[:, ::-1].copy())
    project.run(stage(leave_one_out={"kind": "none"}))
    assert project.tables["projection/facing.json"].turned
    assert project.rasters["projection/front/ortho"][..., 3].mean() > 240
    kept = of(surface={"kind": "mesh", "path": "mesh.ply", "faces": "inwards"})
    assert not kept["projection/front/ortho"].any()


def test_sight_settings_reach_the_test():
    assert (of(sight={"break_at": 1e-3})["projection/front/sight"] == PlaceSight.SEEN).sum() == 0
    everything = of(sight={"depth": 1e4, "rough": 1e4})["projection/front/sight"]
    assert not (everything == PlaceSight.HIDDEN).any()


def test_widening_keeps_clear_of_the_limits():
    near = of(widening={"kind": "limits", "window": 1, "speck": 0, "dilation": 6.0})
    assert sum(int(values.any()) for name, values in near.items() if "/limits/" in name) == 4
    speckless = of(widening={"kind": "limits", "speck": 10_000, "dilation": 6.0})
    assert not any(values.any() for name, values in speckless.items() if "/limits/" in name)
    assert not any("/limits/" in name for name in of(widening={"kind": "none"}))


def test_photographs_made_again_keep_clear_of_breaks_in_the_depth():
    """No picture of theirs tells what is hidden: what the others show next to a break of their depth does not count."""
    without = scene.project_of(MemoryProject)
    without.run(stage(widening={"kind": "none"}, model={"kind": "none"}))
    given = scene.project_of(MemoryProject)
    given.run(stage(widening={"kind": "limits", "dilation": 3.0}, model={"kind": "none"}))
    changed = [(given.rasters[name] != values).any(axis=2) for name, values in without.rasters.items() if name.endswith("/blended")]
    sights = [values for name, values in without.rasters.items() if "left_out" in name and name.endswith("/sight")]
    assert sum(one.sum() for one in changed) > 20
    for one, sight in zip(changed, sights, strict=True):
        assert not one[~(sight == PlaceSight.AT_BREAK).any(axis=2)].any()
    assert not any((given.rasters[name] != without.rasters[name]).any() for name in without.rasters if name.endswith("/nearest"))


def test_next_to_limits_colours_vote_while_the_others_are_few():
    weights = np.array([4.0, 1.0, 8.0, 2.0, 3.0], np.float32)[:, None, None]
    near = np.zeros((5, 1, 1), bool)
    near[:2] = True
    # Three others find gross errors among themselves.
    assert reserved(weights, near).ravel().tolist() == [0.0, 0.0, 8.0, 2.0, 3.0]
    near[:3] = True
    # Two others do not: the light ones next to the limit vote as the heavy ones do.
    assert reserved(weights, near).ravel() == pytest.approx([ZONE_WEIGHT * 3.0] * 3 + [2.0, 3.0])
    assert ZONE_WEIGHT > RESERVE
    near[:] = True
    assert np.array_equal(reserved(weights, near), weights)
    unseen = np.where(np.arange(5)[:, None, None] == 0, np.float32(0.0), weights)
    assert reserved(unseen, np.arange(5)[:, None, None] < 4)[0] == 0


@pytest.mark.parametrize(("factor", "sentence"), [(1 / 0.3048, "show different things"), (0.11, "% of a photograph at most")])
def test_a_surface_in_another_unit_is_doubted_where_photographs_still_meet_it(factor, sentence):
    mesh = scene.mesh()
    project = scene.project_of(MemoryProject, surface=TriangleMesh(mesh.vertices * factor, mesh.triangles))
    project.run(stage(outputs=[{**FRONT, "pixel": 0.1 * factor, "size": (4 * factor, 3 * factor)}]))
    assert sentence in " ".join(project.tables["projection/report.json"].warnings)


def test_the_right_surface_is_not_doubted(plain):
    report = plain.tables["projection/report.json"]
    assert report.verdict.level == "good" and not any("unit" in warning for warning in report.warnings)


@pytest.mark.parametrize(
    ("energy", "words"),
    [
        (0.98, "as sharp as they were taken"),
        (0.64, "blurred: 80 % of the contrast between neighbouring pixels is left"),
        (1.44, "rougher than they were taken, with 120 % of the contrast between neighbouring pixels: others show more, or edges"),
    ],
)
def test_the_verdict_tells_sharpness_in_plain_words(plain, energy, words):
    """The square root of the gradient energy is what one sees."""
    compared = tuple(
        one.model_copy(update={"blended": one.blended.model_copy(update={"gradient": energy})})
        for one in (plain.tables[f"projection/left_out_{number}.json"] for number in range(4))
    )
    facts, statistics = (
        next(job for job in stage().plan(plain) if isinstance(job, Job) and job.item == "report").params,
        [table for path, table in plain.tables.items() if "/statistics/" in path],
    )
    tables = {name: plain.tables[f"projection/{name}.json"] for name in ("census", "facing", "radiometry")}
    report = projection_report(**tables, statistics=tuple(statistics), left_out=compared, textures=(), **facts)
    assert report.verdict.sentence.partition("; ")[2].startswith(f"photographs made again from the others are {words}")


def test_section_lines_are_exported_in_two_formats():
    project = scene.project_of(MemoryProject)
    lines = [{"name": "upright", "point": (0.0, 0.0, 0.0), "normal": (1.0, 0.0, 0.0)}]
    project.run(stage(leave_one_out={"kind": "none"}, section_lines=lines))
    assert {export.path for export in project.exports.values()} >= {"products/upright.dxf", "products/upright.geojson"}
    assert "POLYLINE" in project.tables["projection/lines/upright-dxf.json"].text


def test_the_report_counts_every_pixel_and_names_the_share_of_each_photograph(plain, record_property):
    report = plain.tables["projection/report.json"]
    figures = {figure.name: figure.value for figure in report.figures}
    seen = [figures[f"front_seen_by_{count}"] for count in ("no", "one", "two", "three_or_more")]
    record_property("found", f"none {seen[0]} %, one {seen[1]} %, two {seen[2]} %, more {seen[3]} %: {sum(seen):.2f} %")
    assert sum(seen) == pytest.approx(100.0, abs=0.05)
    assert figures["triangles"] == 24 * 24 * 2 + 12
    answers = {answer.topic: answer.text for answer in report.answers}
    assert answers[Topic.GROUND_PIXEL].endswith("mm on the surface") and "triangles" in answers[Topic.AREA]
    assert "not measured from the photographs" in answers[Topic.HEIGHTS]
    assert [picture.title for picture in report.pictures if picture.first_page] == ["True orthoimage 'front'"]
    table = next(grid for grid in report.grids if grid.title == "Photographs in 'front'")
    assert sum(row[1] for row in table.rows) == pytest.approx(100.0, abs=0.1)
    assert next(p for p in report.pictures if "Coverage" in p.title).classes[:4] == (
        (0, "#d7191c", "seen by no photo"),
        (1, "#1a9641", "seen by one photo"),
        (2, "#2b5fd9", "seen by two photos"),
        (3, "#9a9a9a", "seen by 3 photos"),
    )


def test_a_section_that_removes_everything_is_told():
    project = scene.project_of(MemoryProject)
    nothing = {"kind": "box", "low": (-9, -9, -9), "high": (9, 9, 9), "keep": "outside"}
    project.run(stage(outputs=[{**FRONT, "section": nothing}], leave_one_out={"kind": "none"}))
    assert any(
        "'front' shows no surface: its section removes all" in warning
        for warning in project.tables["projection/report.json"].warnings
    )


def warnings_of(surface: TriangleMesh, **more) -> tuple[str, ...]:
    project = scene.project_of(MemoryProject, surface=surface)
    project.run(stage(leave_one_out={"kind": "none"}, **more))
    return project.tables["projection/report.json"].warnings


def test_a_view_from_inside_a_wall_is_told():
    inside = tuple(map(float, 0.5 * (scene.LOW + scene.HIGH)))
    view = {"kind": "perspective", "name": "inside", "position": inside, "target": (0.2, -0.75, 1.5)}
    told = warnings_of(scene.mesh(), outputs=[{**view, "width": 64, "height": 48, "c": 50}])
    assert any("'inside' shows its back" in one and "Move the position" in one for one in told)


def test_a_mesh_of_one_triangle_is_projected_and_asked_about():
    single = TriangleMesh(np.array([[-2.0, 0, 0], [2, 0, 0], [0, 0, 3]]), np.array([[0, 1, 2]], np.int32))
    assert any(
        "The surface has one triangle only, 5 m large: is it the right file, or was it decimated" in one
        for one in warnings_of(single)
    )


def test_points_without_triangles_and_parts_inside_out_are_told():
    mesh = scene.mesh()
    wall = TriangleMesh(mesh.vertices[: 25 * 25], np.zeros((0, 3), np.int32))
    assert any("has no triangles: its 625 points were joined" in one for one in warnings_of(wall))
    triangles = mesh.triangles.copy()
    triangles[100:300] = triangles[100:300, ::-1]
    told = warnings_of(TriangleMesh(mesh.vertices, triangles))
    assert any("face opposite ways: parts of it are inside out" in one for one in told)


def test_a_glb_stands_up_and_a_system_and_an_axis_that_are_set_reach_the_mesh():
    mesh = scene.mesh()
    lying = TriangleMesh(mesh.vertices @ np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]), mesh.triangles)
    for path, more in (("mesh.glb", {}), ("mesh.ply", {"up": "y"}), ("mesh.ply", {"up": "y", "crs": "EPSG:2100"})):
        project = scene.project_of(MemoryProject)
        project.files[path] = lying
        project.run(stage(surface={"kind": "mesh", "path": path, **more}, leave_one_out={"kind": "none"}))
        census = project.tables["projection/census.json"]
        np.testing.assert_allclose(census.high, mesh.bounds[1], atol=1e-6)
        assert census.system == more.get("crs", "")


def test_the_height_model_of_the_project_goes_through_the_same_jobs():
    grid = MapGrid(west=-2.0, north=-0.2, cell=0.1, rows=10, cols=40)
    heights = np.full(grid.shape, 1.0, np.float32) + 0.1 * np.arange(40, dtype=np.float32)
    project = scene.project_of(MemoryProject)
    project.tables[SURFACE.path] = Surface(grid=grid, height_low=0.0, height_high=3.0)
    project.put(HEIGHT, heights)
    project.specs[HEIGHT] = RasterSpec(name=HEIGHT, shape=grid.shape, dtype="float32", chunk=128)
    given = {"surface": {"kind": "height_model", "every": 1}, "outputs": [{"kind": "map", "pixel": 0.1}]}
    project.run(stage(**given, leave_one_out={"kind": "none"}))
    found = project.rasters["projection/map/nearness"]
    frame = project.tables["projection/frames.json"].frames[0]
    x = frame.corner[0] + (np.arange(frame.cols) + 0.5) * frame.pixel
    level, known = frame.corner[2], np.isfinite(found)
    assert known.any()
    np.testing.assert_allclose((found + level)[known], np.tile(1.0 + (x - grid.west - 0.05), (frame.rows, 1))[known], atol=1e-5)


def test_photographs_with_much_larger_pixels_fade_out_and_still_vote():
    # Pixels of the same size, 1.9, 2.5 and 10 times as large.
    weights = np.array([1.0, 1 / 1.9**2, 1 / 2.5**2, 1 / 100.0], np.float32).reshape(-1, 1, 1)
    faded = fading(weights).ravel()
    assert faded[0] == 1.0 and faded[1] == weights[1, 0, 0]
    assert RESERVE < faded[2] < weights[2, 0, 0] and faded[3] == weights[3, 0, 0]
    assert RESERVE < fading(np.array([1.0, 1 / 3.5**2], np.float32).reshape(-1, 1, 1))[1, 0, 0] < 0.011
    assert not fading(np.zeros((2, 1, 1), np.float32)).any()


@pytest.mark.parametrize("kind", ["block", "histogram"])
def test_a_darker_photograph_is_balanced(kind):
    pictures = {name: scene.photograph(block_view(scene.block(), name)) for name in scene.NAMES}
    pictures["b"] = (0.7 * pictures["b"]).astype(np.uint8)
    project = scene.project_of(MemoryProject, pictures=pictures)
    project.run(stage(balance={"kind": kind, "spacing": 4}, leave_one_out={"kind": "none"}))
    radiometry = project.tables["projection/radiometry.json"]
    assert radiometry.difference_after < 0.35 * radiometry.difference_before


def test_the_best_photographs_are_chosen_by_number_or_by_scale():
    poses = list(scene.POSITIONS)
    poses[3] = tuple(4.0 * value for value in poses[3])
    block = scene.block(tuple(poses))
    shares = {}
    for best in (0, 1, "auto"):
        project = scene.project_of(MemoryProject, blocked=block)
        project.run(stage(best=best, leave_one_out={"kind": "none"}))
        report = project.tables["projection/report.json"]
        table = next(grid for grid in report.grids if grid.title == "Photographs in 'front'")
        shares[best] = {row[0]: row[1] for row in table.rows}
    assert shares[0]["d"] > 2 * shares["auto"]["d"] and shares["auto"]["a"] > 10
    assert shares[1]["d"] < 3


def test_of_two_photographs_only_the_one_without_anything_before_the_place_shows_it(record_property):
    # The published figure: one ray meets the box first, the other one the wall.
    blocked, free = (-0.05, -5.0, 1.0), (2.4, -4.6, 1.6)
    project = scene.project_of(MemoryProject, ("a", "b"), scene.block((blocked, free)))
    project.run(
        stage(
            leave_one_out={"kind": "none"},
            outputs=[{**FRONT, "section": {"kind": "plane", "point": (0, -0.4, 0), "normal": (0, -1, 0)}}],
        )
    )
    # On the wall, behind the middle of the box.
    row, col = round((3.0 - 1.0) / 0.025), round(2.0 / 0.025)
    blocked_sight, free_sight = map(PlaceSight, project.rasters["projection/front/sight"][row, col].tolist())
    record_property("found", f"{blocked_sight.name.lower()} and {free_sight.name.lower()}")
    assert blocked_sight == PlaceSight.HIDDEN and free_sight >= PlaceSight.AT_BREAK
    assert project.rasters["projection/front/coverage"][row, col] == 1


def test_settings_that_were_written_and_read_again_give_the_same_picture(plain, record_property):
    written = stage().model_dump(mode="json")
    project = scene.project_of(MemoryProject)
    project.run(ProjectionStage.model_validate(written))
    assert ProjectionStage.model_validate(written) == stage()
    differing = np.count_nonzero(project.rasters["projection/front/ortho"] != plain.rasters["projection/front/ortho"])
    record_property("found", f"{differing} bytes differ")
    assert not differing
