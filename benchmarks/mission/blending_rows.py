"""Petsa et al. 2007: true orthoimages, views and sections of a mesh, with blended texture."""

from benchmarks.mission.published_row import PICTURES, Cannot, Found, Row, Tested

_PROJECTION = "{kind: projection, surface: {kind: mesh, path: church.ply}, outputs: [{kind: plane, name: front}]}"
_OURS = "Objects and stations are ours, as the report prints neither."
_PAGE = "Published checks"


def _view(more: str) -> str:
    return f"{{kind: projection, surface: {{kind: mesh, path: church.ply}}, outputs: [{{{more}}}]}}"


def _with(more: str) -> str:
    return _PROJECTION[:-1] + ", " + more + "}"


def _check(system: str, anchor: str, reach: str, code: str, published: str) -> Row:
    """A system whose acceptance check is on the page of checks."""
    return Row(system, f"blending.md#{anchor}", reach, published, Found("texture_checks", _PAGE, ((code, "found"),)))


BLENDING = (
    Row(
        "M1. The whole",
        "blending.md#m1",
        _PROJECTION,
        PICTURES,
        Found(
            "texture_acceptance",
            "Solid surfaces",
            (("seed 11, 1:6: M10 + M7 (default)", "PSNR"),),
            "{} dB beside the truth of a portal",
        ),
    ),
    _check("M2. Look-up by cells, and scanline conversion", "m2b", _PROJECTION, "A-02", "markedly faster; no figure"),
    _check("M3. Depths of the new image", "m3", _PROJECTION, "A-01", "one depth a pixel"),
    _check("M4. Depths as pictures", "m4", _with("depth_pictures: true"), "A-07", "0 to 255"),
    _check("M5. Visibility in every photograph", "m5", _PROJECTION, "A-05", "no double projection"),
    _check("M6. Bicubic colours", "m6", _PROJECTION, "A-08", "4 x 4 pixels"),
    _check("M7. Rejection of colours", "m7", _with("rejection: {kind: median}"), "A-09", "mean or median, k sigma"),
    _check("M8. Coverage", "m8", _PROJECTION, "A-13", "red, green, blue, grey"),
    Row(
        "M9. Two colours",
        "blending.md#m9",
        _with("two_colours: {kind: depth_break}"),
        "a possibility; no limits printed",
        Tested("the photograph at a break of its depth gives way", "tests/colouring/test_blending.py"),
    ),
    _check("M10. Widened occlusions", "m10", _with("widening: {kind: limits}"), "A-14", "M10 + M7 better than M7 alone"),
    Row(
        "M11. One photograph alone",
        "blending.md#m11",
        _view("kind: plane, name: one, only: DSC_0012"),
        "holes where it may not contribute",
        Tested("holes where it sees nothing, the truth elsewhere", "tests/projection/test_projection_stage.py"),
    ),
    _check("M12. Blending by area", "m12", _with("weights: {kind: area_squared}"), "A-11", "175 and 190"),
    _check("M13. The best N", "m13", _with("best: 3"), "A-12", "N = 3 is sharper"),
    Row(
        "M14. Distortion in the projection",
        "blending.md#m14",
        _PROJECTION,
        "disastrous where it is ignored",
        Found(
            "texture_acceptance",
            "Solid surfaces",
            (("seed 11, 1:6: distortion ignored", "PSNR"), ("seed 11, 1:6: M10 + M7 (default)", "PSNR")),
            "{} dB ignored, {} dB applied",
        ),
    ),
    _check(
        "M15. Sections",
        "m15",
        _view("kind: plane, name: front, section: {kind: plane, point: [0, 0, 1], normal: [0, -1, 0]}"),
        "A-21",
        "shows the wall behind",
    ),
    _check(
        "M16. Views",
        "m16",
        _view("kind: perspective, name: view, position: [6, -7, 2], omega_phi_kappa: [80, 10, 0]"),
        "A-23",
        "as sharp as a photograph",
    ),
    Row(
        "Oblique projections",
        "blending.md#m1",
        _view("kind: plane, name: oblique, towards: [0.5, -1, 0.5]"),
        "said to be possible",
        Tested("what oblique rays meet is what is shown", "tests/projection/test_views_and_directions.py"),
    ),
    _check("Leave one out (figure 35)", "data", _with("leave_one_out: {kind: photographs}"), "A-22", "as sharp as the original"),
    Row(
        "M17. Table 1, seven photographs of a church",
        "blending.md#table-1",
        "{kind: orientation, interior: {kind: free}}",
        "sigma c / x0 / y0 1.36 / 1.03 / 0.87 px",
        Found("published_bundles", "Self-calibrating", (("1 church", "sigma c"),), "{} px"),
        _OURS,
    ),
    Row(
        "M17. sigma of k1 and k2, control 0.3 mm, tie points 1.3 mm",
        "blending.md#table-1",
        "{kind: orientation, interior: {kind: free}}",
        "0.04e-8, 0.19e-15; 0.3 mm; 1.3 mm",
        Found(
            "published_points",
            "Coefficients",
            (("1 church", "sigma k1"), ("1 church", "control"), ("1 church", "tie points")),
            "{}; {} mm; {} mm",
        ),
        f"{_OURS} Residuals at control follow its standard error (1 mm here), which is not printed.",
    ),
    Row(
        "M17. Table 2, control from scans",
        "blending.md#table-1",
        "{kind: orientation, interior: {kind: free}}",
        "2.30 / 2.11 / 3.74 px; k1, k2 0.07e-8, 0.26e-15; control and tie points 1.5 mm",
        Found(
            "published_points",
            "Coefficients",
            (("2 entrance", "sigma k1"), ("2 entrance", "control"), ("2 entrance", "tie points")),
            "k1 / k2 {}; {} mm; {} mm (c, x0, y0: published_bundles.md)",
        ),
        _OURS,
    ),
    Row(
        "M17. Table 3, parts 1 and 2",
        "blending.md#table-3",
        "{kind: orientation, interior: {kind: free}}",
        "4.9 / 3.1 / 7.3 and 6.3 / 3.2 / 4.3 px",
        Found("published_bundles", "Self-calibrating", (("3.1", "sigma c"), ("3.2", "sigma c")), "{} and {} px"),
        _OURS,
    ),
    Row(
        "M17. Table 3, part 3",
        "blending.md#table-3",
        "{kind: orientation, interior: {kind: free}}",
        "17.4 / 10.3 / 13.3 px",
        Found(
            "published_bundles",
            "Self-calibrating",
            (("3.3 low", "sigma c"), ("3.3 with 1.5", "sigma c"), ("3.3 with 2", "sigma c")),
            "{} px; with 1.5 and twice the relief {}; {} px",
        ),
        f"{_OURS} How much relief the third part has decides c, and is not printed. That c is weak, and the texture sharp all "
        "the same, is the published pattern.",
    ),
    Row(
        "M18. Joint registration of nine scans",
        "blending.md#m18",
        "{kind: registration, paths: [scans/one.csv, scans/two.csv]}",
        "+-7 mm",
        Found(
            "scan_registration",
            "Joint registration",
            (("places", "figure"), ("sigma0", "figure")),
            "with 4 mm of noise within 1 / 2 / 3 standard errors {}; sigma0 over true {}",
        ),
        "Noise and targets of the published scans are not printed.",
    ),
    Row(
        "M19. Histograms",
        "blending.md#m19",
        _with("balance: {kind: histogram}"),
        PICTURES,
        Tested("equal histograms where photographs overlap", "tests/colouring/test_histogram_matching.py"),
    ),
    _check("M20. Project files", "m20", "orthomill run PROJECT", "A-26", "INI files"),
    Row(
        "Applications 2 and 3 as pictures",
        "blending.md#data",
        "orthomill run portal",
        "orthoimages and sections of 2 mm",
        Cannot(
            "their scans and photographs are not public; the portal (`workflows/portal.yaml`) has their columns, depth and a "
            "section, and "
            "its pictures are those of the run",
            "workflows/portal.yaml",
        ),
    ),
)
