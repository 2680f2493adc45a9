"""The workflow file: read, checked as a whole with sentences that help, written back without loss."""

import re
from pathlib import Path
from time import process_time

import pytest
import yaml
from front_door import CATALOGUE, HEAD, MatchingStage, PaintingStage, photograph, project, workflow
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from pydantic import TypeAdapter

from orthomill.pipeline.workflow.workflow_file import LoadedWorkflow, load_workflow, project_root, resolve_workflow, write_workflow
from orthomill.schemas.errors import StoreError, WorkflowError
from orthomill.schemas.project import CameraSource, ControlSource, Positions, Project
from orthomill.tasks import catalogue


@pytest.fixture
def root(tmp_path):
    return project(tmp_path)


def mistakes(root: Path, text: str) -> list[str]:
    """The lines of the one error that a workflow gives; each has file, line and a sentence, and no Python in it."""
    with pytest.raises(WorkflowError) as caught:
        load_workflow(workflow(root, text), CATALOGUE)
    lines = str(caught.value).splitlines()
    for line in lines:
        assert re.match(r"workflows/site\.yaml:\d+: ", line), line
        assert line[-1] in ".?", line
        assert not re.search(r"Traceback|pydantic|Input should|<class|NoneType|__", line), line
    return lines


def only(root: Path, text: str) -> str:
    lines = mistakes(root, text)
    assert len(lines) == 1, lines
    return lines[0]


def test_a_workflow_without_mistakes(root):
    stages = "stages:\n  - kind: matching\n    size: 15\n    window: {kind: ellipse}\n  - painting\n"
    loaded = load_workflow(workflow(root, HEAD + stages), CATALOGUE)
    assert loaded.project.crs == "EPSG:2100"
    assert loaded.root == root
    matching, painting = loaded.stages
    assert isinstance(matching, MatchingStage) and matching.size == 15 and matching.window.max_axis_ratio == 4.0
    assert painting == PaintingStage()


def test_all_mistakes_are_reported_together_with_their_lines(root):
    lines = mistakes(
        root,
        """\
project: Volos Town
crs: EPSG:2100
photograps: {kind: folder, path: photos}
tile: 5000
stages:
  - kind: matching
    windw: {kind: square}
    size: 5000
  - kind: paintig
""",
    )
    assert [int(line.split(":")[1]) for line in lines] == [1, 3, 4, 7, 8, 9]
    assert lines[0].endswith("'volos-town' is possible.")
    assert "photograps: there is no such setting; did you mean 'photographs'?" in lines[1]
    assert "stages > matching > windw: there is no such setting; did you mean 'window'?" in lines[3]
    assert "Settings of matching are: size, cell, centre," in lines[3]
    assert lines[4].endswith("stages > matching > size: is 5000 px; must be at most 255 px.")
    assert "there is no stage 'paintig'; did you mean 'painting'? Allowed: one of matching, painting." in lines[5]


@pytest.mark.parametrize(
    ("setting", "expected"),
    [
        ("size: 1", "size: is 1 px; must be at least 3 px."),
        ("size: 7.5", "size: is 7.5 px; must be a whole number (px), from 3 to 255."),
        ("size: 21 px", "size: is '21 px'; must be a whole number (px), from 3 to 255. Write the number alone, in px: 21."),
        ("size: 5 cm", "Write the number alone, in px."),
        ("size:", "size: is empty; must be a whole number (px), from 3 to 255."),
        ("cell: 0.3 m", "cell: is '0.3 m'; must be a number (m), greater than 0. Write the number alone, in m: 0.3."),
        ("cell: 30 cm", "Write the number alone, in m: 0.3."),
        ("cell: 0,3", "Write the number alone, in m: 0.3."),
        ("cell: 1 km", "in m: 1000."),
        ("cell: .inf", "cell: is '.inf'; must be a number (m), greater than 0."),
        ("cell: nan", "cell: is 'nan'; must be a number (m), greater than 0."),
        ("cell: [1, 2]", "cell: is a list; must be a number (m), greater than 0."),
        ("centre: average", "centre: is 'average'; must be one of mean, median."),
        ("back: perhaps", "back: is 'perhaps'; must be true or false."),
        ("levels: [1, x]", "levels > entry 2: is 'x'; must be a list of numbers."),
        ("limit: far", "limit: is 'far'; must be a number (m) or null."),
        ("window: ellipse", "is 'ellipse'; must be a mapping with kind: one of ellipse, square. Write '{kind: ellipse}'."),
        ("window: {}", "window: has no kind; 'kind' must be one of ellipse, square."),
        ("window: {kind: elipse}", "window > kind: there is no kind of window 'elipse'; did you mean 'ellipse'?"),
        ("window: {kind: ellipse, max_axis_ratio: 9}", "window > max_axis_ratio: is 9; must be at most 8."),
        ("window: {kind: square, side: 3}", "window > side: there is no such setting. window has no settings."),
    ],
)
def test_one_wrong_setting_gives_one_clear_sentence(root, setting, expected):
    line = only(root, f"{HEAD}stages:\n  - kind: matching\n    {setting}\n")
    assert line.startswith("workflows/site.yaml:6: stages > matching > ")
    assert expected in line


@pytest.mark.parametrize(
    ("stages", "expected"),
    [
        ("", "stages: is missing; a workflow lists at least one stage"),
        ("stages: []", "stages: is empty; a workflow lists at least one stage"),
        ("stages: matching", "stages: is not a list; a workflow lists at least one stage"),
        ("stages: [fotos]", "stages > fotos: there is no stage 'fotos'. Allowed: one of matching, painting."),
        ("stages: [matchin]", "did you mean 'matching'?"),
        ("stages: [{size: 3}]", "stages > entry 1: has no kind; 'kind' must be one of matching, painting."),
        ("stages: [{matching: {size: 3}}]", "write 'kind: matching' instead of 'matching:'"),
        ("stages: [3]", "must be a mapping of settings"),
        ("stages: [matching, matching]", "this stage is listed 2 times"),
        ("stages: [painting, matching]", "matching runs before painting, so it must be listed first; the order is matching,"),
    ],
)
def test_the_list_of_stages_must_make_sense(root, stages, expected):
    assert expected in only(root, f"{HEAD}{stages}\n")


@pytest.mark.parametrize(
    ("name", "source", "maker"), [("positions", "simulated", "simulation"), ("control", "scans", "registration")]
)
def test_what_a_stage_provides_needs_that_stage(root, name, source, maker):
    (root / "marks.csv").write_text("")
    more = ", measurements: marks.csv" if source == "scans" else ""
    text = HEAD + f"{name}: {{kind: {source}{more}}}\nstages: [photos]\n"
    said = rf"{name}: is '{source}', but no stage '{maker}'.*add '- kind: {maker}', which provides that, first\.$"
    with pytest.raises(WorkflowError, match=said):
        load_workflow(workflow(root, text), catalogue.STAGES)


def test_a_repeated_key_is_refused_where_it_is_repeated(root):
    assert only(root, f"{HEAD}tile: 512\ntile: 256\nstages: [matching]\n") == (
        "workflows/site.yaml:5: tile: is already set in line 4; set it once."
    )


def test_broken_yaml_is_one_sentence(root):
    assert only(root, "project: site\n  crs: x\n").startswith("workflows/site.yaml:2: this is not valid YAML")
    assert "anchor" in only(root, "project: &a site\n")


@pytest.mark.parametrize("text", ["", "just words", "- a\n- b\n"])
def test_a_file_that_is_no_workflow_says_what_one_is(root, text):
    assert "a workflow is a mapping with the settings project, crs," in only(root, text)


def test_a_workflow_that_is_not_text(root):
    path = root / "workflows" / "site.yaml"
    path.write_bytes(b"\xff\xfe\x00\x01project")
    with pytest.raises(WorkflowError, match="is not UTF-8 text"):
        load_workflow(path, CATALOGUE)
    with pytest.raises(WorkflowError, match="cannot be read"):
        load_workflow(root / "workflows", CATALOGUE)


STAGES = "stages: [matching]\n"


@pytest.mark.parametrize(
    ("crs", "expected"),
    [
        ("EPSG:4326", "(WGS 84) is in degrees, but orthomill needs a projected system in metres; use a national grid"),
        ("EPSG:99999", "'EPSG:99999' is not a coordinate reference system that PROJ knows"),
        ("gibberish", "is not a coordinate reference system that PROJ knows; look up the code at https://epsg.io."),
        ("'2100'", "'2100' is neither a code nor the full name of a system; did you mean EPSG:2100 (GGRS87 / Greek Grid)?"),
        ("EPSG:2263", "is in US survey foot, but orthomill needs metres"),
        ("EPSG:4978", "is geocentric"),
        ("EPSG:2100+6360", "but heights must be in metres, positive upwards"),
        ("2100", "crs: is 2100; must be a text. Put it in quotes."),
    ],
)
def test_a_crs_that_cannot_be_measured_in(root, crs, expected):
    line = only(root, f"project: site\ncrs: {crs}\nphotographs: {{kind: folder, path: photos}}\n{STAGES}")
    assert line.startswith("workflows/site.yaml:2: crs: ") and expected in line


def test_a_crs_in_degrees_comes_with_the_utm_zone_of_the_photographs(root):
    photograph(root / "photos" / "A.jpg", gps=(22.94, 39.36))
    line = only(root, f"project: site\ncrs: EPSG:4326\nphotographs: {{kind: folder, path: photos}}\n{STAGES}")
    assert line.endswith("the GPS tags of the photographs suggest EPSG:32634, the UTM zone they are in.")


@pytest.mark.parametrize("crs", ["EPSG:2100", "EPSG:2100+5773", "EPSG:32634+EPSG:5773"])
def test_plan_and_height_systems_in_metres_are_fine(root, crs):
    text = f"project: a\ncrs: {crs}\nphotographs: {{kind: folder, path: photos}}\n{STAGES}"
    assert load_workflow(workflow(root, text), CATALOGUE).project.crs == crs


@pytest.mark.parametrize(
    ("photographs", "expected"),
    [
        (
            "{kind: folder, path: 'az://flights/shore'}",
            "'orthomill init NAME --photos az://flights/shore', with a new NAME, fetches",
        ),
        ("{kind: folder, path: phtos}", "path: the folder 'phtos' does not exist; did you mean 'photos'?"),
        ("{kind: folder, path: control}", "path: The folder control contains no JPEG, TIFF or PNG images"),
        ("{kind: folder, path: photos, pattern: 'DJI*'}", "None of the 2 images in photos matches the pattern 'DJI*'"),
        (
            "{kind: folder, path: photos, pattern: '*1.JPG'}",
            "'photos/IMG_0001.JPG' is the only photograph; heights come from overlap",
        ),
        ("{kind: folder, path: photos/IMG_0001.JPG}", "is a file; give its folder"),
        ("{kind: folder, path: ../elsewhere}", "is outside the project's folder"),
        ("{kind: folder, path: photos/../../elsewhere}", "is outside the project's folder"),
        ("{kind: folder, path: /etc}", "is outside the project's folder"),
        ("{kind: folder, path: ''}", "is empty; name a file or folder"),
        ('{kind: folder, path: "a\\0b"}', "contains a null character"),
        (
            "{kind: list, paths: [photos/IMG_0001.JPG, photos/IMG_002.JPG]}",
            "paths > entry 2: the photograph 'photos/IMG_002.JPG' does not exist; did you mean 'photos/IMG_0002.JPG'?",
        ),
        ("{kind: list, paths: [photos/IMG_0001.JPG, other/a.jpg]}", "does not exist, nor does its folder 'other'."),
        ("{kind: list, paths: [photos/IMG_0001.JPG, photos/IMG_0001.JPG]}", "is listed twice"),
        ("{kind: list, paths: [photos/IMG_0001.JPG, control/points.csv]}", "is not named like a photograph"),
        ("{kind: list, paths: [photos/IMG_0001.JPG]}", "is the only photograph"),
        ("{kind: list, paths: []}", "paths: is a list; must be a list of texts, not empty."),
        ("{kind: list, paths: [photos/IMG_0001.JPG, '/etc/x.jpg']}", "is outside the project's folder"),
        ("photos", "photographs: is 'photos'; must be a mapping with kind: one of folder, list, simulated."),
        ("{kind: folder}", "path: is missing; it must be a text. Folder with the photographs, relative to the project's root."),
    ],
)
def test_photographs_that_are_not_there(root, photographs, expected):
    line = only(root, f"project: site\ncrs: EPSG:2100\nphotographs: {photographs}\n{STAGES}")
    assert line.startswith("workflows/site.yaml:3: photographs") and expected in line


@pytest.mark.parametrize(
    ("what", "expected"),
    [
        (
            "cameras: {kind: file, path: camera.json}",
            "the file 'camera.json' does not exist; the project's folder contains control,",
        ),
        ("cameras: {kind: file, path: ../camera.json}", "cameras > path: '../camera.json' is outside"),
        ("cameras: {kind: file, path: photos}", "is a folder; a file is needed here."),
        ("cameras: {kind: given, c: 0}", "cameras > c: is 0 px; must be greater than 0 px."),
        ("cameras: {kind: given}", "cameras > c: is missing; it must be a number (px), greater than 0. Camera constant."),
        (
            "cameras: {kind: chessboards, photographs: {kind: folder, path: bords}, corners: [9, 6], square: 0.05}",
            "cameras > photographs > path: the folder 'bords' does not exist",
        ),
        (
            "cameras: {kind: chessboards, photographs: {kind: folder, path: photos}, corners: [9], square: 0.05}",
            "cameras > corners: is a list; must be 2 whole numbers in brackets.",
        ),
        ("positions: {kind: file, path: gnss.csv}", "positions > path: the file 'gnss.csv' does not exist"),
        ("positions: none", "Write '{kind: none}'."),
        (
            "control: {kind: files, points: control/points.csv, measurements: control/point.csv}",
            "control > measurements: the file 'control/point.csv' does not exist; did you mean 'control/points.csv'?",
        ),
        (
            "control: {kind: files, points: 'control\\points.csv', measurements: control/points.csv}",
            "separate folders by '/', not by a",
        ),
    ],
)
def test_files_of_the_other_parts(root, what, expected):
    line = only(root, f"{HEAD}{what}\n{STAGES}")
    assert line.startswith("workflows/site.yaml:4: ") and expected in line


def test_files_in_settings_of_stages_are_looked_for_as_well(root):
    text = f"{HEAD}stages:\n  - matching\n  - kind: painting\n    colours_path: ../colours.csv\n"
    assert "workflows/site.yaml:7: stages > painting > colours_path: '../colours.csv' is outside" in only(root, text)


def test_a_link_inside_the_project_may_lead_outside(root, tmp_path_factory):
    outside = tmp_path_factory.mktemp("disk")
    photograph(outside / "a.jpg")
    photograph(outside / "b.tif")
    (root / "card").symlink_to(outside)
    text = f"project: a\ncrs: EPSG:2100\nphotographs: {{kind: folder, path: card}}\n{STAGES}"
    loaded = load_workflow(workflow(root, text), CATALOGUE)
    assert loaded.project.photographs.path == "card"


def test_an_absolute_path_inside_the_project_is_fine(root):
    text = f"project: a\ncrs: EPSG:2100\nphotographs: {{kind: folder, path: '{root / 'photos'}'}}\n{STAGES}"
    assert load_workflow(workflow(root, text), CATALOGUE)


def test_other_parts_are_checked_although_one_is_wrong(root):
    head = "project: 3\ncrs: EPSG:4326\nphotographs: {kind: folder, path: nowhere}\n"
    lines = mistakes(root, head + "stages: [{kind: painting, note: 5}]\n")
    assert [int(line.split(":")[1]) for line in lines] == [1, 2, 3, 4]


def test_names_of_workflows(root):
    path = workflow(root, HEAD + STAGES, "volos.yaml")
    assert resolve_workflow("volos", root) == path
    assert resolve_workflow("workflows/volos.yaml", root) == path
    assert resolve_workflow(str(path), Path("/")) == path
    with pytest.raises(WorkflowError, match=r"did you mean 'volos'\? Workflows here: volos\."):
        resolve_workflow("vlos", root)
    with pytest.raises(WorkflowError, match=r"did you mean 'volos'\?"):
        resolve_workflow("workflows/vollos.yaml", root)
    with pytest.raises(WorkflowError, match="orthomill init"):
        resolve_workflow("volos", root / "photos")


def test_the_root_of_a_project(tmp_path):
    assert project_root(tmp_path / "workflows" / "a.yaml") == tmp_path
    assert project_root(tmp_path / "runs" / "a" / "workflow.yaml") == tmp_path
    assert project_root(tmp_path / "a.yaml") == tmp_path


TEXT = st.text(st.characters(codec="utf-8", exclude_characters="\0"), max_size=20)
NUMBER = st.floats(allow_nan=False, allow_infinity=False)
WINDOW = st.one_of(st.just({"kind": "square"}), st.builds(lambda r: {"kind": "ellipse", "max_axis_ratio": r}, st.floats(1.001, 8)))
MATCHING = st.fixed_dictionaries(
    {},
    optional={
        "size": st.integers(3, 255),
        "cell": st.floats(1e-300, 1e300),
        "centre": st.sampled_from(["mean", "median"]),
        "window": WINDOW,
        "levels": st.lists(NUMBER, max_size=4),
        "limit": st.one_of(st.none(), NUMBER),
        "back": st.booleans(),
    },
)
GIVEN = st.builds(lambda c, k: {"kind": "given", "c": c, "k1": k, "pixel_um": None}, st.floats(1e-9, 1e9), NUMBER)
CAMERA = st.one_of(st.just({"kind": "exif"}), GIVEN)
NAME = st.from_regex(r"[a-z0-9][a-z0-9_-]{0,8}", fullmatch=True)
POSITIONS = st.builds(lambda s: {"kind": "exif", "sigma_plan": s}, st.floats(1e-9, 1e9))


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(matching=MATCHING, note=TEXT, camera=CAMERA, positions=POSITIONS, name=NAME)
def test_the_workflow_as_run_reads_back_as_the_same_models(root, matching, note, camera, positions, name):
    """Any settings: written with every default filled in, and read again, nothing has changed."""
    stages = (MatchingStage(**matching), PaintingStage(note=note))
    chosen = Project(
        project=name,
        crs="EPSG:2100",
        photographs={"kind": "folder", "path": "photos"},
        tile=640,
        cameras=TypeAdapter(CameraSource).validate_python(camera),
        positions=TypeAdapter(Positions).validate_python(positions),
        control=TypeAdapter(ControlSource).validate_python({"kind": "none"}),
    )
    folder = root / "runs" / "site"
    folder.mkdir(parents=True, exist_ok=True)
    write_workflow(LoadedWorkflow(chosen, stages, Path("site.yaml"), root, ""), folder / "workflow.yaml")
    again = load_workflow(folder / "workflow.yaml", CATALOGUE)
    assert again.project == chosen
    assert again.stages == stages
    assert again.root == root


WORDS = st.sampled_from(["folder", "ellipse", "matching", "kind", "a\nb"])
SCALARS = st.one_of(st.none(), st.booleans(), st.integers(), NUMBER, TEXT, WORDS)
KEYS = st.one_of(TEXT, st.sampled_from([*Project.model_fields, *MatchingStage.model_fields, "stages", "path", "paths", "c"]))
TREES = st.recursive(SCALARS, lambda inner: st.lists(inner, max_size=3) | st.dictionaries(KEYS, inner, max_size=4), max_leaves=12)
FILES = st.fixed_dictionaries({}, optional=dict.fromkeys((*Project.model_fields, "stages", "stagse"), TREES))


@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(content=FILES)
def test_whatever_the_file_contains_the_answer_is_sentences(root, content):
    """Any tree of YAML: a workflow, or a WorkflowError whose every line has a file and a line number; never anything else."""
    path = workflow(root, yaml.safe_dump(content, allow_unicode=True))
    try:
        load_workflow(path, CATALOGUE)
    except WorkflowError as error:
        for line in str(error).splitlines():
            assert re.match(r"workflows/site\.yaml:\d+: |\.\.\. and \d+ more\.$", line)


@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(place=st.integers(0, 200), cut=st.integers(0, 8), inserted=st.text("{}[]:-#&*!'\"|\n\t >%@`,ax1", max_size=4))
def test_a_slip_of_the_keyboard_is_answered_with_sentences(root, place, cut, inserted):
    text = HEAD + "stages:\n  - kind: matching\n    window: {kind: ellipse}\n    levels: [1, 2]\n  - painting\n"
    place = place % len(text)
    try:
        load_workflow(workflow(root, text[:place] + inserted + text[place + cut :]), CATALOGUE)
    except WorkflowError as error:
        assert str(error).startswith("workflows/site.yaml:")


def test_the_workflow_as_run_says_every_default_with_its_sentence_and_unit(root):
    loaded = load_workflow(workflow(root, f"{HEAD}stages: [matching, painting]\n"), CATALOGUE)
    write_workflow(loaded, root / "workflow.yaml")
    text = (root / "workflow.yaml").read_text()
    assert "    size: 21  # Side of the window. [px]\n" in text
    assert "    window:  # Shape of the window.\n      kind: square\n" in text
    assert "  sigma_plan: null  # Standard error in X and Y; by default" in text
    assert not (root / "workflow.yaml.part").exists()


def test_a_folder_that_cannot_be_written_to(root):
    loaded = load_workflow(workflow(root, HEAD + STAGES), CATALOGUE)
    with pytest.raises(StoreError, match="cannot be written"):
        write_workflow(loaded, root / "workflows" / "site.yaml" / "workflow.yaml")


@pytest.mark.slow
def test_twenty_thousand_unknown_settings_are_answered_in_seconds(root):
    path = workflow(root, HEAD + STAGES + "".join(f"key{number}: 1\n" for number in range(20_000)))
    begun = process_time()
    with pytest.raises(WorkflowError) as caught:
        load_workflow(path, CATALOGUE)
    lines = str(caught.value).splitlines()
    assert len(lines) == 11 and lines[-1] == "... and 19990 more."
    assert process_time() - begun < 20, "it took a minute when every mistake was compared with all others"


RENAMED = {"shape": "window", "side": "size"}


def test_settings_under_former_names_are_taken_with_a_note_at_their_line(root, monkeypatch):
    monkeypatch.setattr(MatchingStage, "renamed", RENAMED)
    text = HEAD + "stages:\n  - kind: matching\n    side: 9\n  - kind: painting\n"
    loaded = load_workflow(workflow(root, text), CATALOGUE)
    assert loaded.stages[0] == MatchingStage(size=9)
    line = text.splitlines().index("    side: 9") + 1
    assert len(loaded.notes) == 1
    assert loaded.notes[0].startswith(f"workflows/site.yaml:{line}: stages > matching > side: is called 'size' now")


def test_a_file_with_present_names_has_no_notes(root):
    assert load_workflow(workflow(root, HEAD + "stages:\n  - kind: matching\n    size: 9\n"), CATALOGUE).notes == ()


def test_mistakes_at_former_names_say_what_was_found(root, monkeypatch):
    monkeypatch.setattr(MatchingStage, "renamed", RENAMED)
    head = HEAD + "stages:\n  - kind: matching\n"
    assert "is 2 px; must be at least 3 px" in only(root, head + "    side: 2\n")
    assert "no kind of window 'circle'" in only(root, head + "    shape: {kind: circle}\n")
    assert "'side' is called 'size' now, and both are set" in only(root, head + "    side: 9\n    size: 9\n")
