"""Karfis 2009: relative orientation, epipolar images, guided densification."""

from benchmarks.mission.published_row import NO_FIGURE, Cannot, Found, Row, Tested

_GUIDED = "{kind: densification, matching: {kind: guided}}"
_RELATIVE = "orthomill relative PROJECT A B"
_NO_FILM = "docs/sources/epipolar.md"
_TRUTH = "points of the last level, against the truth"
_ALIKE = "points of the last level, against the default"

EPIPOLAR = (
    Row(
        "The whole: orientation, epipolar images, points from level to level, every pixel",
        "epipolar.md#levels",
        _GUIDED,
        "Volos, rough: RMS 1.90 m; below 1, 3, 10 sigma 10.7, 79.9, 100.0 %",
        Found(
            "guided",
            "Differences",
            ((_ALIKE, "RMS"), (_ALIKE, "< 1 sigma"), (_ALIKE, "< 3"), (_ALIKE, "> 10"), (_TRUTH, "RMS")),
            "against another matcher's surface, as published: RMS {} m; below 1, 3 sigma {}, {} %, above 10 sigma {} %; against "
            "the truth RMS {} m",
        ),
        "The scene is a simulated town; the published reference, another matcher's surface, has no heights where matching is "
        "hardest, and those of ours that are farthest from the truth lie there.",
    ),
    Row(
        "Bands from 4 sigma outwards",
        "epipolar.md#results-differences",
        _GUIDED,
        "Volos, rough: below 4, 5, 6 sigma 95.5, 98.9, 99.7 %",
        Found(
            "guided",
            "Differences",
            (
                *((_ALIKE, band) for band in ("< 4", "< 5", "< 6")),
                *(("points of the last level, of open ground", band) for band in ("< 4", "< 5", "< 6")),
                *((_TRUTH, band) for band in ("< 4", "< 5", "< 6")),
            ),
            "against another matcher's surface {}, {}, {} %; open ground against the truth {}, {}, {} %; all of it {}, {}, {} %",
        ),
        "The tail against the truth is walls and roofs, which a matched reference does not know.",
    ),
    Row(
        "Every pixel, with an entropy mask",
        "epipolar.md#per-pixel",
        "{kind: densification, matching: {kind: guided, pixels: {step: 1, min_entropy: 4.0}}}",
        "Volos, dense: RMS 0.71 m, below 3 sigma 82.9 %; Kea 0.96, 0.81 m",
        Found(
            "guided",
            "Differences",
            (
                ("every pixel, as surface, against the default", "RMS"),
                ("every pixel, as surface, against the default", "< 3"),
                ("every pixel, as surface, against the truth", "RMS"),
            ),
            "against another matcher's surface RMS {} m, below 3 sigma {} %; against the truth RMS {} m",
        ),
        "Pixels of 64 um here, of 15 and 11 um there: in its own sigma of a height (1.08 and 0.18 m) ours is 1.2, theirs 3.9, 4.8 "
        "and 4.0.",
    ),
    Row(
        "Points by level, rocky ground",
        "epipolar.md#results-densification",
        _GUIDED,
        "Kea: 1007, 1489, 2249, 4414, 4414, 7412, 14325; rough RMS 1.1 m",
        Found(
            "guided",
            "Points by level",
            tuple((level, "points") for level in ("2", "3", "4", "5", "6", "7")),
            "from the second level on {}, {}, {}, {}, {}, {}",
        ),
        "The pair of Kea is not public and the thresholds of its levels are not printed; the counts grow as steadily on the "
        "simulated "
        "town.",
    ),
    Row(
        "Matches and their rejection",
        "epipolar.md#rejection",
        "{kind: tie_points, search: {kind: correlation}}",
        "Volos 1096 -> 1078 -> 1062 matches; Kea 154 -> 36",
        Found(
            "orientation_simulated", "Kea with 118", (), "36 right ones of 154 found again in 100 of 100 seeds (page, section Kea)"
        ),
        "The scans are not public; the simulated pairs have the printed numbers of points, noise and wrong matches.",
    ),
    Row(
        "sigma0 by correlation, and after least-squares matching",
        "epipolar.md#results-orientation",
        _RELATIVE,
        "0.25 -> 0.17 px (Volos), 0.27 -> 0.20 px (Kea)",
        Found(
            "orientation_simulated",
            "Pairs: noise-free",
            (("Volos", "bias of sigma0"), ("Kea", "bias of sigma0")),
            "sigma0 of planted noise comes back within {} (Volos), {} (Kea)",
        ),
        "What noise correlation leaves on those scans cannot be measured without them; "
        "`tests/tie_points/test_correlation_search.py` "
        "holds that least-squares matching lowers it.",
    ),
    Row(
        "Dependent relative orientation from zero, mixed equations",
        "epipolar.md#relative-orientation",
        _RELATIVE,
        "b_y, b_z, omega, phi, kappa with standard errors 0.0018, 0.0022, 0.0007 degrees (Volos)",
        Found(
            "orientation_simulated",
            "Pairs: noise-free",
            (("Volos", "largest error"), ("Volos", "iterations"), ("Volos", "estimates within 3"), ("Kea", "estimates within 3")),
            "noise-free {} off in {} iterations; within 3 standard errors {} (Volos), {} (Kea)",
        ),
    ),
    Row(
        "Pixels, image coordinates, scans with fiducial marks",
        "epipolar.md#coordinates",
        "{kind: photos, coordinates: {kind: digital}}",
        NO_FIGURE,
        Tested("scanned film is read through its fiducial marks, as an affinity", "tests/photos/test_fiducial_marks.py"),
    ),
    Row(
        "Interest points (Harris in Noble's form)",
        "epipolar.md#interest-points",
        "{kind: tie_points, search: {kind: correlation, points: {kind: harris}}}",
        "thresholds 20000 to 1000; no count",
        Tested(
            "a flat image and an edge have none, a square four corners; fewer with a higher threshold",
            "tests/matching/points/test_interest_points.py",
        ),
    ),
    Row(
        "Start by the mean parallax; correlation; back-matching",
        "epipolar.md#correlation",
        "{kind: tie_points, search: {kind: correlation}}",
        "template 21, search 201 and 401 px, 0.85, return within 2 px",
        Found("window_sizes", "Interest points", (), "done with these settings; times on the page"),
    ),
    Row(
        "Least-squares matching to 0.1 px",
        "epipolar.md#least-squares",
        "{kind: tie_points, refinement: {window: 21}}",
        "stop at 0.1 px; no radiometric terms",
        Found(
            "matching",
            "Strategies",
            (("recommended, square 21 | clean", "correct"), ("recommended, square 21 | noise", "correct")),
            "{} % correct clean, {} % with noise",
        ),
    ),
    Row(
        "Epipolar images and their test",
        "epipolar.md#epipolar-images",
        "{kind: epipolar}",
        "rows equal within the orientation's error",
        Tested("rows of homologous points agree to 1e-6 px with an exact orientation", "tests/epipolar/test_epipolar_images.py"),
        "The printed rotations leave up to 8.5 px (sources/epipolar.md); the right ones are used.",
    ),
    Row(
        "Rows to be searched",
        "epipolar.md#row-band",
        "{kind: densification, matching: {kind: guided, rows: auto}}",
        "0.2, 0.7 and 0.7 px printed; 0.10, 0.41 and 2.35 px by its own formula",
        Tested("0.10, 0.41 and 2.35 px", "tests/epipolar/test_row_precision.py"),
        "The printed column does not follow from the printed standard errors.",
    ),
    Row(
        "Monoplotting, columns to be searched",
        "epipolar.md#column-interval",
        "orthomill monoplot PROJECT PHOTO --points PIXELS",
        "a square of 20 m",
        Tested("the true column lies in the interval", "tests/matching/guided/test_column_interval.py"),
    ),
    Row(
        "Removal of spikes",
        "epipolar.md#spikes",
        "{kind: densification, matching: {kind: guided, outliers: {}}}",
        "3 sigma, radius 10, 5, 1 m; counts not printed",
        Tested("isolated spikes go, planes stay, a second pass removes nothing", "tests/matching/guided/test_outlier_detector.py"),
    ),
    Row(
        "Evaluation against a reference, in bands of sigma",
        "epipolar.md#evaluation",
        "{kind: evaluation, reference: {kind: file, points: reference/points.csv, sigma: 0.15}}",
        "expected 0.769 and 0.180 m (Volos), 0.901 and 0.202 m (Kea)",
        Tested(
            "bands of 1 to 10 standard errors of surface and reference together, at cells and at points",
            "tests/evaluation/test_reference_points.py",
        ),
    ),
    Row(
        "Kea, dense patches",
        "epipolar.md#results-differences",
        _GUIDED,
        "RMS 0.96 m (section 1), 0.81 m (building)",
        Cannot(
            "the pair of Kea and its surface are not public, and a surface by another program of a simulated pair would be no "
            "reference",
            _NO_FILM,
        ),
    ),
)
