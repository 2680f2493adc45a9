"""Skarlatos: the check of a surface without reference data, and the tables that judge its parts."""

from benchmarks.mission.published_row import Found, Row, Tested

_CHECK = "orthomill check SURFACE --project PROJECT"
_CHECKED = (
    "The pair is not public: a rendered town, whose points err by 0.35 m and which has fewer trees and no shadows, so that less is "
    "left after the correction."
)
_STAND_IN = "The pair is not public; errors of surfaces, matches and manual points are those of a stand-in (page)."
_TRIMMED = "trimmed: mean"
_NOISE = ("clean", "noise of 2 grey values, gain 0.9")

CHECK = (
    Row(
        "The deterministic check of the synthetic pair, deformation of +-41 m",
        "surface_check.md#deterministic",
        "{kind: dsm_check, correction: {kind: plan}}",
        "95 % kept, RMSE 0.036 m",
        Found(
            "published_pair",
            "The published pair",
            tuple((f"{noise}, +25 to +41 m, one pass", value) for noise in _NOISE for value in ("kept", "RMSE")),
            "{} % kept, RMSE {} m without noise; {} %, {} m with noise of 2 grey values (rigorous rays)",
        ),
        "The noise of the published rendering is not printed: ours without and with noise lie on both sides.",
    ),
    Row(
        "Norvelle's iterative refinement",
        "surface_check.md#iterative",
        "{kind: dsm_check, correction: {kind: norvelle}}",
        "superseded by the deterministic form",
        Tested("the deterministic form needs fewer rounds", "benchmarks/results/norvelle_rounds.md"),
    ),
    Row(
        "Table 4.20: a deformed surface",
        "surface_check.md#table-4-20",
        _CHECK,
        "RMS 1.82 m given, 0.60 m corrected",
        Found(
            "checked_tables",
            "Table 4.20",
            (("deformed, all | given", "RMS"), ("deformed, all | corrected", "RMS")),
            "RMS {} m given, {} m corrected",
        ),
        _CHECKED,
    ),
    Row(
        "Table 4.20: commercial grid, commercial triangles",
        "surface_check.md#table-4-20",
        _CHECK,
        "RMS 0.94 to 0.59 m; 0.88 to 0.56 m",
        Found(
            "checked_tables",
            "Table 4.20",
            tuple(
                (f"commercial {kind}, all | {state}", "RMS")
                for kind in ("grid", "triangulation")
                for state in ("given", "corrected")
            ),
            "RMS {} to {} m; {} to {} m",
        ),
        _CHECKED,
    ),
    Row(
        "Table 4.21: manual points, by the shape of the window",
        "surface_check.md#table-4-21",
        _CHECK,
        "std 0.579, 0.576, 0.572 m; within 0.75 m by the law 76.46, 76.64, 76.91 %",
        Found(
            "checked_tables",
            "Table 4.21",
            tuple((shape, column) for column in ("std", "within") for shape in ("square", "ellipse along", "ellipse across")),
            "std {}, {}, {} m; within 0.75 m by the law {}, {}, {} %",
        ),
        f"{_CHECKED} The shapes differ as little as printed, square windows being the worst.",
    ),
    Row(
        "Table 4.22: what the check finds, below limits",
        "surface_check.md#table-4-22",
        _CHECK,
        "34.70, 64.67, 93.86, 98.81, 99.69 %",
        Found(
            "checked_tables",
            "Table 4.22",
            tuple((limit, "all") for limit in ("0.3", "0.6", "1.5", "3.0", "5.0")),
            "{}, {}, {}, {}, {} %",
        ),
        _CHECKED,
    ),
    Row(
        "Table 4.13: matched points and their rejection",
        "surface_check.md#table-4-13",
        "{kind: dsm_check}",
        "rejected 4.35, 5.16, 5.03 % (square, ellipse, across)",
        Found(
            "published_pair_tables",
            "Table 4.13",
            tuple((shape, "rejected") for shape in ("square", "ellipse", "across")),
            "rejected {}, {}, {} %",
        ),
        "A tenth of the points, and noise of our own.",
    ),
    Row(
        "Table 4.14: surfaces against 18343 points",
        "surface_check.md#table-4-14",
        "{kind: evaluation, reference: {kind: file, points: reference/points.csv}}",
        "RMS 0.877, 0.902, 0.898 m; commercial 0.874 to 1.023 m",
        Found(
            "published_pair_tables",
            "Table 4.14",
            (("square", "RMS"), ("ellipse", "RMS"), ("across", "RMS"), ("SSK TIN", "RMS"), ("Softplotter DTM", "RMS")),
            "RMS {}, {}, {} m; stand-ins of the commercial ones {} to {} m",
        ),
        "The synthetic pair has no houses, trees and shadows, so that fewer heights are wrong.",
    ),
    Row(
        "Table 4.15: relative orientation of the synthetic pair",
        "surface_check.md#table-4-15",
        "orthomill relative PROJECT A B",
        "kappa 0.0010, phi 0.0008 and 0.0011, omega 0.0006 degrees off",
        Found(
            "published_pair_tables",
            "Table 4.15",
            (("kappa 1", "ours"), ("phi 1", "ours"), ("omega 2", "ours")),
            "{}, {}, {} degrees off (kappa, phi, omega)",
        ),
        "The printed table contradicts itself by a factor of ten (page).",
    ),
    Row(
        "Table 4.17: relative orientation of the real pair",
        "surface_check.md#table-4-17",
        "orthomill relative PROJECT A B",
        "sigma0 20.8 um matched, 1.1 um manual",
        Found(
            "published_pair_tables",
            "Table 4.17",
            (("sigma0", "matched"), ("sigma0", "manual")),
            "sigma0 {} um matched, {} um manual",
        ),
        _STAND_IN,
    ),
    Row(
        "Tables 4.18, 4.19: sigma0 of intersections",
        "surface_check.md#table-4-18",
        "orthomill covariance PROJECT --points POINTS",
        "manual points 14, 9, 13 um; matched 16.5, 24.4, 9.3 um",
        Found(
            "published_pair_tables",
            "Tables 4.18",
            tuple((points, column) for points in ("manual", "matched") for column in (1, 5, 9)),
            "manual points {}, {}, {} um; matched {}, {}, {} um",
        ),
        "The printed orientations from manual points contradict each other (page).",
    ),
)
