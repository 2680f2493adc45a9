"""Kawka 2021: calibration from several chessboards in unknown arrangement."""

from benchmarks.mission.published_row import NO_FIGURE, Cannot, Found, Row, Tested

_CALIBRATE = "orthomill calibrate FOLDER --corners 9x6 --square 0.05"
_PARAMETERS = "{kind: calibration, model: brown, parameters: [c, x0, y0, k1, k2]}"
_OTHERS = "The published photographs and the layout of their boards are not public: orders and rates compare, not digits."
_TILTS = (
    "Tilts of the published subsets are not printed. Ours are 3 to 8 degrees (weak) and 20 to 38 (strong): weak perspective "
    "costs a "
    "factor of five to thirteen, as in tables 4-10 and 4-25; in three of the five sets the published weak ones determine c as "
    "well as the "
    "strong ones."
)
_PAGE = "Published calibrations"


def _set(table: str, set_up: str, photos: tuple[int, int], printed: str, cause: str = _OTHERS) -> Row:
    """A table of interior orientations against the number of photographs."""
    ends = tuple((f"{table} | {set_up} | {number}", "sigma c") for number in photos)
    found = Found(
        "published_calibrations",
        _PAGE,
        (*ends, (f"{table} | falls", "sigma c")),
        "published / simulated: {}; {} px; falls {} times",
    )
    return Row(
        f"Table {table}, {photos[0]} to {photos[1]} photographs", "calibration.md#table-4-8", _PARAMETERS, printed, found, cause
    )


def _subsets(title: str, tables: tuple[str, ...], printed: str) -> Row:
    """Subsets of weak and strong perspective."""
    found = Found(
        "published_subsets",
        "Published calibrations of few",
        tuple((table, "sigma c") for table in tables),
        "published / simulated: " + "; ".join(["{}"] * len(tables)),
    )
    return Row(title, "calibration.md#table-4-8", _PARAMETERS, printed, found, _TILTS)


CALIBRATION = (
    Row(
        "S1. Boards and corners",
        "calibration.md#s1",
        _CALIBRATE,
        "images without all boards are left out",
        Found(
            "calibration",
            "Corners of rendered",
            (("1228", "boards found"), ("1228", "RMS")),
            "{}; RMS {} px; cut boards are used too",
        ),
    ),
    Row(
        "S2 to S6. Central board, homographies, matching by PCA, motions, together",
        "calibration.md#s4",
        _CALIBRATE,
        NO_FIGURE,
        Found(
            "calibration",
            "Published set-ups",
            (("twelve", "all named"), ("five", "all named")),
            "all boards named in {} and {} seeds",
        ),
    ),
    Row(
        "S7, S8. First constant (tables 3-1 to 3-6)",
        "calibration.md#table-3-1",
        _CALIBRATE,
        "3652.67, 4201.82, 4910.55 px from the printed values of each image",
        Tested("the same to 0.01 px", "tests/calibration/solving/test_initial_values.py"),
    ),
    Row(
        "S9, S10. First exterior orientation",
        "calibration.md#s10",
        _CALIBRATE,
        NO_FIGURE,
        Found(
            "published_calibrations",
            "Starts",
            (("six_boards", "S9 from S10"), ("twelve", "S9 from S10")),
            "the two ways {} and {} m apart",
        ),
    ),
    Row(
        "S11, S12. Adjustment with self-calibration, precision",
        "calibration.md#s11",
        _PARAMETERS,
        "sigma c 1.4, 0.5, 0.6, 0.5 px (7, 14, 16, 34 photographs)",
        Found(
            "calibration",
            "Published set-ups",
            tuple((name, "sigma of c") for name in ("twelve", "six_boards", "six_boards_longer", "five")),
            "{}, {}, {}, {} px",
        ),
        _OTHERS,
    ),
    _set("4-8", "twelve_boards", (3, 7), "sigma c 1.8 to 1.4 px"),
    _set(
        "4-16",
        "five_boards",
        (3, 34),
        "sigma c 1.7 to 0.5 px, 3.4 times less",
        f"{_OTHERS} Three of 34 that were as good as any would fall by the root of 34 / 3, 3.4, as printed; which three a table "
        "begins with decides the rest (row of the falls below).",
    ),
    _set("4-23", "six_boards", (3, 14), "sigma c 2.6 to 0.5 px"),
    _set("4-36", "six_boards_longer", (3, 16), "sigma c 2.6 to 0.6 px"),
    _set(
        "4-40",
        "six_boards, one board",
        (3, 11),
        "sigma c 1.7 to 0.6 px (FAUCCAL)",
        f"{_OTHERS} Our first three photographs are already well spread, and a single board has no more to gain from the others; "
        "with other first ones the printed fall is among ours (next row but one).",
    ),
    _set("4-46", "six_boards_longer, one board", (3, 14), "sigma c 2.4 to 0.6 px (FAUCCAL)"),
    Row(
        "Falls of sigma c of these six tables, with other first photographs",
        "calibration.md#table-4-8",
        _PARAMETERS,
        "1.3, 3.4, 5.2, 4.3, 2.8, 4.0 times",
        Found(
            "published_calibrations",
            "Falls with other",
            tuple((table, "sigma c") for table in ("4-8", "4-16", "4-23", "4-36", "4-40", "4-46")),
            "published / least, median, largest of random draws: {}; {}; {}; {}; {}; {}",
        ),
        "Which photographs come first is not printed. Where the printed fall is less than our least, its first photographs show "
        "the boards from more different sides than three random ones of ours.",
    ),
    _subsets(
        "Tables 4-2 to 4-7: three photographs of the first Phantom set",
        ("4-2", "4-6"),
        "sigma c 2.4 px (weak perspective), 4.1 px (strong)",
    ),
    _subsets("Tables 4-10 to 4-15: five of the second", ("4-10", "4-14"), "sigma c 49 px (weak), 1.0 px (strong)"),
    _subsets("Tables 4-19 to 4-28: five of the Sony sets", ("4-19", "4-21", "4-25", "4-27"), "sigma c 0.8, 1.2; 6.1, 2.4 px"),
    _subsets("Tables 4-32 to 4-35: five of the Canon set", ("4-32", "4-34"), "sigma c 1.1, 1.5 px"),
    _subsets(
        "Tables 4-38, 4-39, 4-44, 4-45: five of single boards (FAUCCAL)",
        ("4-38", "4-39", "4-44", "4-45"),
        "sigma c 0.8, 1.0; 1.1, 1.2 px",
    ),
    Row(
        "S13. Calibrated constants, all nine sets",
        "calibration.md#calibrated",
        _CALIBRATE,
        "3617.5, 3694.9, 4130.8, 4096.9, 4095.3, 4110.3, 4941.6, 4938.7, 4950.7 px",
        Found(
            "published_subsets",
            "Calibrated constants",
            tuple(
                (name, "ours")
                for name in (
                    "Phantom 4 Pro, 1",
                    "Phantom 4 Pro, 2",
                    "Sony, 2",
                    "Sony, 1, 14",
                    "Sony, 1, 11",
                    "Sony, single",
                    "Canon, several, 16",
                    "Canon, several, 14",
                    "Canon, single",
                )
            ),
            ", ".join(["{}"] * 9),
        ),
        "The fifth belongs to other coefficients than those printed.",
    ),
    Row(
        "S14. Corners in rectified images (tables 3-7 to 3-16)",
        "calibration.md#s1",
        _CALIBRATE,
        "sigma0 0.499 instead of 0.392 px, 15 times the time",
        Cannot(
            "the source rejects it, its four photographs are not public, and corners are refined in the photograph itself",
            "docs/sources/calibration.md",
        ),
    ),
    Row(
        "Correlations, one board and several",
        "calibration.md#table-4-38",
        _CALIBRATE,
        "one board: x0 with phi above 80 to 85 %; several 50 to 60 %",
        Found(
            "published_calibrations",
            "Correlations",
            tuple(
                (name, "x0")
                for name in (
                    "six_boards | 11",
                    "six_boards_longer | 14",
                    "six_boards, one board | 11",
                    "six_boards_longer, one board | 14",
                    "six_boards, one board, 1.5",
                    "six_boards_longer, one board, 1.5",
                    "six_boards, one board, 2",
                    "six_boards_longer, one board, 2",
                )
            ),
            "several {}, {}; one {}, {}, from 1.5 times as far {}, {}, from twice as far {}, {}",
        ),
        "How much of the frame the boards fill is not printed, and decides: a single one from farther away reaches what is "
        "printed, and one board is always worse than several.",
    ),
    Row(
        "Real photographs beside OpenCV",
        "calibration.md#results",
        _CALIBRATE,
        NO_FIGURE,
        Found(
            "calibration",
            "Real photographs",
            (("stereo rig, left | orthomill", "held out"), ("OpenCV samples, left | orthomill", "held out")),
            "held out {} and {} px",
        ),
    ),
)
