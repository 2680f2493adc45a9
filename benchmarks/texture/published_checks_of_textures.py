"""Where each published check of textures (sources/blending.md, A-01 to A-28) is made, and what is found there: a test, or a page.

`python -m benchmarks texture_checks` writes `benchmarks/results/texture_checks.md`; tests record what they
find as a property `found`. Another test sees to it that every test and page that is named exists.
"""

import subprocess
import sys
import tempfile
from pathlib import Path
from xml.etree import ElementTree

from benchmarks.instrument.result_page import write_page
from benchmarks.measured_run import ROOT

_STAGE, _SCAN = "tests/projection/test_projection_stage.py", "tests/visibility/test_scanline.py"
_BLEND, _TILES = "tests/colouring/test_blending.py", "tests/texture/test_texture_tiles.py"
_PAGE = "benchmarks/results/texture_acceptance.md"
CHECKS = {
    "A-01": ("the nearer of two stacked squares", f"{_SCAN}::test_of_two_stacked_squares_the_nearer_one_is_kept_everywhere"),
    "A-02": ("scanline conversion and grid look-up agree", f"{_SCAN}::test_scanline_and_grid_look_up_agree"),
    "A-03": ("depth of a sloped triangle", f"{_SCAN}::test_a_sloped_plane_has_the_depth_of_its_equation"),
    "A-04": (
        "of two rays one is blocked",
        f"{_STAGE}::test_of_two_photographs_only_the_one_without_anything_before_the_place_shows_it",
    ),
    "A-05": ("hidden area beside ray casting", f"{_STAGE}::test_coverage_is_what_rays_to_every_photograph_tell"),
    "A-06": ("several depths at one place", "tests/projection/test_unrolled_cylinder.py::test_an_unrolled_column_and_shaft"),
    "A-07": (
        "depth picture from 0 to 255",
        "tests/projection/model/test_coloured_model.py::test_depth_pictures_run_from_white_to_black",
    ),
    "A-08": ("bicubic reproduces a ramp", f"{_TILES}::test_bicubic_reproduces_a_ramp"),
    "A-09": ("250 among five, fewer than three values", f"{_BLEND}::test_a_gross_error_among_five_is_rejected"),
    "A-10": ("median, k, k without limit", f"{_BLEND}::test_a_large_k_rejects_nothing"),
    "A-11": ("175 and 190", f"{_BLEND}::test_weights_by_area_and_squared_area"),
    "A-12": ("the best N", f"{_BLEND}::test_best_n"),
    "A-13": ("coverage and its colours", f"{_STAGE}::test_the_report_counts_every_pixel_and_names_the_share_of_each_photograph"),
    "A-14": ("none > M7 > M10 + M7", _PAGE),
    "A-15": (
        "opening by its window",
        "tests/colouring/test_hidden_edges.py::test_opening_removes_what_is_smaller_than_its_window_and_keeps_the_rest_in_place",
    ),
    "A-16": ("holes with and without removal of specks", _PAGE),
    "A-17": ("distortion ignored", _PAGE),
    "A-18": (
        "self-calibration of seven photographs",
        "tests/adjustment/test_published_bundles.py::test_seven_photographs_and_eighteen_points_calibrate_the_camera",
    ),
    "A-19": (
        "weak control, little relief",
        "tests/adjustment/test_published_bundles.py::test_control_from_scans_and_a_low_wall_weaken_the_camera_but_not_the_texture",
    ),
    "A-20": (
        "nine scans",
        "tests/adjustment/registration/test_joint_registration.py::test_nine_scans_are_registered_within_their_standard_errors",
    ),
    "A-21": ("section", f"{_STAGE}::test_a_section_shows_the_wall_behind_the_box_coloured_by_those_that_see_it"),
    "A-22": ("leave one out", f"{_STAGE}::test_a_photograph_left_out_is_made_again_and_blending_is_no_worse_than_the_nearest"),
    "A-23": ("view with distortion", f"{_STAGE}::test_a_view_with_distortion_is_what_the_camera_there_would_see"),
    "A-24": (
        "pixels and paper scale",
        "tests/projection/test_projection_frames.py::test_two_millimetres_of_an_area_are_so_many_pixels_and_so_much_paper",
    ),
    "A-25": (
        "millions of triangles: memory follows the tile",
        f"{_STAGE}::test_a_tile_holds_the_depths_of_one_photograph_at_a_time",
    ),
    "A-26": ("saved and read settings", f"{_STAGE}::test_settings_that_were_written_and_read_again_give_the_same_picture"),
    "A-27": ("one mesh in every format", "tests/pipeline/storage/test_mesh_files.py::test_every_format_gives_the_same_triangles"),
    "A-28": ("pixels seen by none", f"{_STAGE}::test_the_report_counts_every_pixel_and_names_the_share_of_each_photograph"),
}


def figures_of_tests() -> dict[str, list[str]]:
    """test -> what each of its cases recorded as found. Runs the tests."""
    wanted = sorted({where for _, where in CHECKS.values() if "::" in where})
    with tempfile.TemporaryDirectory() as scratch:
        log = Path(scratch) / "tests.xml"
        command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", f"--junit-xml={log}", *wanted]
        done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
        if done.returncode != 0:
            raise SystemExit(done.stdout)
        cases = ElementTree.parse(log).getroot().iter("testcase")
    out: dict[str, list[str]] = {}
    for case in cases:
        name = f"{case.get('classname', '').replace('.', '/')}.py::{case.get('name', '').partition('[')[0]}"
        out.setdefault(name, []).extend(one.get("value", "") for one in case.iter("property") if one.get("name") == "found")
    return out


def figures_of_page(check: str, page: str) -> list[str]:
    """What a page of figures says of a check: in rows of its tables, or after its name."""
    lines = [line for line in (ROOT / page).read_text().splitlines() if check in line]
    rows = [line.split("|") for line in lines if line.startswith("|")]
    sentences = [line.partition(f"{check}: ")[2] for line in lines if not line.startswith("|")]
    return [f"{row[1].strip().rpartition(': ')[2]}: {row[2].strip()}" for row in rows] + sentences


def main(words: list[str]) -> None:
    """Write the page."""
    tests = figures_of_tests()
    found = {name: tests[where] if "::" in where else figures_of_page(name, where) for name, (_, where) in CHECKS.items()}
    lines = [
        "# Published checks of textures",
        "",
        "From tests, which it runs, and from the page `texture_acceptance.md`.",
        "",
        "| check | what | found | where |",
        "| --- | --- | --- | --- |",
        *(f"| {name} | {what} | {'; '.join(dict.fromkeys(found[name]))} | `{where}` |" for name, (what, where) in CHECKS.items()),
    ]
    write_page("texture_checks", words, "\n".join(lines))
