"""Skarlatos: least-squares matching with windows of chosen size and shape, region growing."""

from benchmarks.mission.published_row import NO_FIGURE, Found, Row, Tested

_SIZES = "{kind: densification, matching: {kind: region_growing, growing: {matching: {window: {kind: %s}}}}}"
_SQUARE = "{kind: densification, matching: {kind: region_growing, growing: {matching: {window: 27, formulation: {kind: forward}}}}}"
_ELLIPSE = (
    "{kind: densification, matching: {kind: region_growing, growing: {matching: {window: 27, shape: {kind: ellipse}, "
    "formulation: {kind: forward}}}}}"
)
_TEXTURE = (
    "The photograph of the publication is not public, and one recipe differs as much from texture to texture as from the printed "
    "tables (page, readings); the text does not say where gradients were taken."
)

MATCHING = (
    Row(
        "Fixed squares (table 4.6)",
        "matching.md#table-4-6",
        _SQUARE,
        "27 px: 98.98 % returned, 1.32 % blunders, 97.67 % correct",
        Found(
            "matching",
            "Table 4.6",
            (("27", "returned"), ("27", "blunders"), ("27", "correct"), ("11", "correct")),
            "measured / published: returned {}, blunders {}, correct {}; 11 px {} (the largest difference)",
        ),
        _TEXTURE,
    ),
    Row(
        "Fixed ellipses (table 4.8)",
        "matching.md#table-4-6",
        _ELLIPSE,
        "27 px: 99.47 % returned, 98.36 % correct; fewer blunders than squares at all sizes",
        Found("matching", "Published claims", (("ellipses give fewer", "here"),), "fewer blunders {}"),
        _TEXTURE,
    ),
    Row(
        "Ellipses across (table 4.11)",
        "matching.md#window-shape",
        "{kind: densification, matching: {kind: region_growing, growing: {matching: {shape: {kind: ellipse, major_axis: "
        "across}}}}}",
        "fewer blunders than along at 13 of 15 sizes",
        Found("matching", "Published claims", (("ellipses across", "here"),)),
        "Which axis is better changes with the size; where gradients are taken matters more (page, readings).",
    ),
    Row(
        "Sizes by statistics (tables 4.7, 4.9)",
        "matching.md#statistics",
        _SIZES % "statistical",
        "S1 to S8: 60 to 80 % of the points get a window",
        Found(
            "matching",
            "Table 4.7",
            (("S1", "assigned"), ("S4", "assigned"), ("S7", "assigned")),
            "S1 {}, S4 {}, S7 {} % (measured / published)",
        ),
        "The rules repeat the five printed samples; with the contrast of our texture doubled they come within 4 points of the "
        "printed "
        "shares (page, readings): it is flatter.",
    ),
    Row(
        "Sizes by entropy",
        "matching.md#entropy",
        _SIZES % "entropy",
        "E1 to E15: 52 to 100 % assigned",
        Found("matching", "Tables 4.7 and 4.9", (("E2", "correct"), ("E5", "correct")), "correct of tested E2 {}, E5 {} %"),
        "Limits are calibrated to the printed shares, as the thresholds in grey values belong to another texture.",
    ),
    Row(
        "Sizes by the modified Foerstner operator",
        "matching.md#foerstner",
        _SIZES % "foerstner",
        "F3: 93.74 % assigned",
        Found("matching", "Table 4.7", (("F3", "assigned"),), "{} % (calibrated)"),
    ),
    Row(
        "Combined sizes; assign a share of the points",
        "matching.md#window-size",
        "{kind: densification, matching: {kind: region_growing, assigned: 95, growing: {matching: {window: {kind: combined}}}}}",
        NO_FIGURE,
        Found(
            "window_sizes",
            "Calibrated limits",
            (("statistical", "limit"), ("entropy", "limit"), ("foerstner", "limit")),
            "for 95 %: {}; {}; {}",
        ),
    ),
    Row(
        "Map of sizes",
        "matching.md#size-map",
        "orthomill inspect window-size PHOTO",
        "grey levels, 255 where none passes",
        Tested("levels and five printed samples", "tests/inspections/test_window_size_map.py"),
    ),
    Row(
        "Limited corrections (table 4.10)",
        "matching.md#table-4-10",
        _SQUARE,
        "7 px: FGDC 2.0 / 4.0 m to 0.2 / 0.5 m",
        Found("matching", "Published claims", (("the limiter mends", "here"),)),
        "The gross errors of the publication are windows that the affine mirrors; these are refused here.",
    ),
    Row(
        "Region growing (table 4.12), squares",
        "matching.md#table-4-12",
        _SQUARE,
        "96.38 % correct, RMS Z 0.09 m",
        Found(
            "matching",
            "Full extraction",
            (("published recipe 27, square", "correct"), ("published recipe 27, square", "RMS")),
            "{}; RMS Z {} (ours / published)",
        ),
        "More nodes are correct here than printed; the RMS is that of the 0.3 % that are not.",
    ),
    Row(
        "Region growing (table 4.12), ellipses",
        "matching.md#region-growing",
        _ELLIPSE,
        "99.29 % correct, RMS Z 0.05 m",
        Found(
            "matching",
            "Full extraction",
            (("published recipe 27, ellipse", "correct"), ("published recipe 27, ellipse", "RMS")),
            "{}; RMS Z {} (ours / published)",
        ),
        "As above: an error along the base leaves no y-parallax by which it could be rejected.",
    ),
    Row(
        "The best of now on the same nodes",
        "matching.md#pyramids",
        "{kind: densification, matching: {kind: pyramid}}",
        "99.29 %, 0.05 m",
        Found("matching", "Full extraction", (("pyramid", "correct"), ("pyramid", "RMS")), "{}; RMS Z {} (ours / published)"),
        "Another way than the published one, on the nodes of the row above.",
    ),
    Row(
        "Seeds by hand or found, photographs without orientation",
        "matching.md#region-growing",
        "orthomill grow LEFT RIGHT --seeds SEEDS",
        "relative orientation from the grown points (tables 4.15, 4.17)",
        Tested(
            "photographs turned by 23 degrees against each other: 95 % of the nodes within 0.3 px, and related",
            "tests/matching/strategies/test_grown_pair.py",
        ),
    ),
    Row(
        "Region growing ties the raw photographs of a block",
        "matching.md#region-growing",
        "{kind: tie_points, search: {kind: region_growing}}",
        "relative orientation from the grown points (tables 4.15, 4.17)",
        Tested(
            "photographs turned by 23 degrees against each other: before their refinement half of the matches within 0.6 px, 97 % "
            "within 2.5 px",
            "tests/tie_points/test_grown_search.py",
        ),
    ),
    Row(
        "Six, eight and two parameters; when it ends",
        "matching.md#six-parameters",
        "{kind: tie_points, refinement: {radiometry: estimated, geometry: affine}}",
        "0.1 px after 14 iterations",
        Tested(
            "known warps come back to hundredths of a pixel, what diverges has a code",
            "tests/matching/least_squares/test_least_squares_matching.py",
        ),
    ),
)
