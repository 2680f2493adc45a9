"""Tables 4.6 to 4.11: 48 settings of the window's size, three shapes, with and without the limiter, and the published values.

Strategy. Thresholds of the entropy and Foerstner methods cannot be adopted (other texture, lost definitions): the limit of each
is calibrated to the share of points that the publication gave a window; roundness limits are the published ones. The statistical
methods keep their printed thresholds. All settings start from one list.

Source: Skarlatos (sources/matching.md#window-size), tables 4.5 to 4.11.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from benchmarks.matching import matching_published as published_tables
from benchmarks.matching.dissertation_pair import CLEAN, NOISY, PairRadiometry
from benchmarks.matching.matching_experiment import Experiment, Score, score
from benchmarks.matching.matching_published import Published
from benchmarks.matching.published_recipe import published
from orthomill.tasks.matching.least_squares.least_squares_settings import Ellipse, LeastSquaresMatching, Square
from orthomill.tasks.matching.least_squares.matching import PreparedImage, match_points, prepare
from orthomill.tasks.matching.strategies.cascade import match_cascade
from orthomill.tasks.matching.strategies.cascade_settings import CascadeMatching
from orthomill.tasks.matching.windows.calibration import calibrated, last_limits
from orthomill.tasks.matching.windows.sizes import grey_levels, window_sizes
from orthomill.tasks.matching.windows.window_settings import (
    CombinedWindow,
    EntropyWindow,
    FoerstnerWindow,
    StatisticalWindow,
    WindowSizing,
)

SIZES = tuple(range(7, 36, 2))
SHAPES = {"square": Square(), "ellipse": Ellipse(), "across": Ellipse(major_axis="across")}
STATISTICAL = {
    f"S{n + 1}": StatisticalWindow(min_deviation=d, min_excess=e)
    for n, (e, d) in enumerate((e, d) for e in (40.0, 30.0) for d in (30.0, 25.0, 20.0, 15.0))
}
_ENTROPY = {f"E{n}": EntropyWindow(min_gain=0.0) for n in range(1, 16)}
_FOERSTNER = {f"F{n + 1}": FoerstnerWindow(min_roundness=(0.5, 0.675, 0.75)[n // 3]) for n in range(9)}
CALIBRATED: dict[str, WindowSizing] = {**_ENTROPY, **_FOERSTNER, "F10": CombinedWindow()}


CIRCULAR = (
    "The limits of the rows E and F are found from the printed shares, so that these rows are circular and confirm nothing; the",
    "published limits belong to another texture. Only the rows S are measured with the printed limits.",
)
"""what the shares of table 4.7 are worth"""


@dataclass(frozen=True)
class Setting:
    """One line of a table: a recipe, and where the windows come from (None: the recipe's own size)."""

    name: str | int
    shape: str
    limited: bool
    sizing: WindowSizing | None

    @property
    def recipe(self) -> LeastSquaresMatching:
        return published(self.name if isinstance(self.name, int) else 27, SHAPES[self.shape], self.limited)


def sizings(experiment: Experiment) -> dict[str, WindowSizing]:
    """The 33 methods of table 4.5 with their limits."""
    last = {name: [] for name in ("entropy", "F1", "F4", "F7", "F10")}
    for band in experiment.bands():
        grey = grey_levels(band.crop.left)
        for name, parts in last.items():
            parts.append(last_limits(grey, band.points, EntropyWindow(min_gain=0.0) if name == "entropy" else CALIBRATED[name]))
    tables = {name: np.concatenate(parts) for name, parts in last.items()}
    found: dict[str, WindowSizing] = dict(STATISTICAL)
    for name, sizing in CALIBRATED.items():
        family = "entropy" if name[0] == "E" else name if name == "F10" else f"F{(int(name[1:]) - 1) // 3 * 3 + 1}"
        found[name] = calibrated(sizing, tables[family], published_tables.ASSIGNED[name] / 100.0).sizing
    return found


def settings_of(methods: dict[str, WindowSizing]) -> Iterator[Setting]:
    """All lines of tables 4.6 to 4.11."""
    for shape in SHAPES:
        for size in SIZES:
            yield Setting(size, shape, False, None)
        for name, sizing in methods.items():
            yield Setting(name, shape, False, sizing)
    for shape in ("square", "ellipse"):
        for name in published_tables.LIMITED_SQUARES:
            yield Setting(name, shape, True, methods.get(name))


class Prepared:
    """The images of a band, prepared once for every smoothing."""

    def __init__(self, left: np.ndarray, right: np.ndarray):
        self._images = left, right
        self._known: dict[float, tuple[PreparedImage, PreparedImage]] = {}

    def of(self, settings: LeastSquaresMatching) -> tuple[PreparedImage, PreparedImage]:
        if settings.smoothing not in self._known:
            self._known[settings.smoothing] = tuple(prepare(image, settings) for image in self._images)
        return self._known[settings.smoothing]


def measured(experiment: Experiment) -> dict[Setting, Score]:
    """Every setting on the clean pair."""
    settings = list(settings_of(sizings(experiment)))
    errors = {setting: np.full((len(experiment.points), 3), np.nan) for setting in settings}
    given = {setting: np.ones(len(experiment.points), bool) for setting in settings}
    for band in experiment.bands():
        images, grey = Prepared(band.crop.left, band.crop.right), grey_levels(band.crop.left)
        halves: dict[str | int, np.ndarray] = {}
        for setting in settings:
            if setting.sizing is not None and setting.name not in halves:
                halves[setting.name] = window_sizes(grey, band.points, setting.sizing).half
            half = halves.get(setting.name)
            found = match_points(*images.of(setting.recipe), band.points, band.starts, setting.recipe, half=half)
            errors[setting][band.rows] = band.errors(found)
            if half is not None:
                given[setting][band.rows] = half > 0
    return {setting: score(errors[setting], given[setting]) for setting in settings}


STRATEGIES: dict[str, LeastSquaresMatching | CascadeMatching] = {
    "published recipe, square 27": published(27),
    "published recipe, ellipse 27": published(27, Ellipse()),
    "recommended, square 21": LeastSquaresMatching(),
    "recommended, ellipse 21": LeastSquaresMatching(shape=Ellipse()),
    "cascade 27 (1.2 px) -> 27 -> 17 (0.6 px)": CascadeMatching(),
}


def strategies(experiment: Experiment, radiometry: PairRadiometry) -> dict[str, Score]:
    """The recipes of now beside the published ones."""
    errors = {name: np.full((len(experiment.points), 3), np.nan) for name in STRATEGIES}
    for band in experiment.bands(radiometry):
        for name, settings in STRATEGIES.items():
            match = match_cascade if isinstance(settings, CascadeMatching) else match_points
            errors[name][band.rows] = band.errors(match(band.crop.left, band.crop.right, band.points, band.starts, settings))
    return {name: score(table) for name, table in errors.items()}


def _row(name: str, ours: Score, theirs: Published | None) -> str:
    empty = Published(*(published_tables.NAN,) * 5) if theirs is None else theirs
    share = 100.0 * empty.blunders / published_tables.TESTED
    cells = (
        (ours.returned, empty.returned, "{:.2f}"),
        (ours.blunder_share, share, "{:.2f}"),
        (ours.correct, empty.correct, "{:.2f}"),
        (ours.horizontal, empty.horizontal, "{:.2f}"),
        (ours.vertical, empty.vertical, "{:.2f}"),
    )
    both = (f"{form.format(mine)} / {form.format(printed) if printed == printed else '-'}" for mine, printed, form in cells)
    return f"| {name} | " + " | ".join(both) + " |"


_HEAD = [
    "| window | returned % | blunders % of tested | correct of tested % | FGDC horizontal m | FGDC vertical m |",
    "| --- | --- | --- | --- | --- | --- |",
]


def _table(found: dict[Setting, Score], shape: str, limited: bool, theirs: dict) -> list[str]:
    return [
        *_HEAD,
        *(
            _row(str(setting.name), result, theirs.get(setting.name))
            for setting, result in found.items()
            if setting.shape == shape
            and setting.limited == limited
            and (limited or isinstance(setting.name, int) == (27 in theirs))
        ),
    ]


def differences(found: Mapping[int, Score], printed: Mapping[int, Published]) -> dict[str, tuple[int, float]]:
    """The largest differences of the shares of fixed windows from the printed ones, and the sizes they belong to."""
    apart = {"returned": {}, "correct": {}, "blunders": {}}
    for size in SIZES:
        ours, theirs = found[size], printed[size]
        apart["returned"][size] = ours.returned - theirs.returned
        apart["correct"][size] = ours.correct - theirs.correct
        apart["blunders"][size] = ours.blunder_share - 100.0 * theirs.blunders / published_tables.TESTED
    return {name: max(values.items(), key=lambda item: abs(item[1])) for name, values in apart.items()}


def farthest(found: Mapping[int, Score], printed: Mapping[int, Published]) -> str:
    """The same as a sentence."""
    parts = (f"{name} {value:+.1f} points at {size} px" for name, (size, value) in differences(found, printed).items())
    return f"Largest differences from the printed shares: {', '.join(parts)}."


def window_page(experiment: Experiment) -> list[str]:
    """The tables as Markdown: measured / published."""
    found, p = measured(experiment), published_tables
    fixed, along, across = (
        {setting.name: result for setting, result in found.items() if setting.shape == shape and not setting.limited}
        for shape in SHAPES
    )
    assigned = [f"| {name} | {fixed[name].assigned:.2f} / {p.ASSIGNED[name]:.2f} |" for name in p.ASSIGNED]
    return [
        "### Table 4.6: fixed squares",
        "",
        *_table(found, "square", False, p.SQUARES),
        "",
        farthest(fixed, p.SQUARES),
        "",
        "### Table 4.7: windows assigned",
        "",
        *CIRCULAR,
        "",
        "| method | assigned % |",
        "| --- | --- |",
        *assigned,
        "",
        "### Tables 4.7 and 4.9: chosen sizes, squares",
        "",
        *_table(found, "square", False, p.DYNAMIC_SQUARES),
        "",
        "### Tables 4.8 and 4.11: fixed ellipses",
        "",
        *_table(found, "ellipse", False, p.ELLIPSES),
        "",
        farthest(along, p.ELLIPSES),
        "",
        "### Table 4.9: chosen sizes, ellipses",
        "",
        *_table(found, "ellipse", False, p.DYNAMIC_ELLIPSES),
        "",
        "### Table 4.11: fixed ellipses across",
        "",
        *_table(found, "across", False, p.ACROSS),
        "",
        farthest(across, p.ACROSS),
        "",
        "### Chosen sizes, ellipses across (not published)",
        "",
        *_HEAD,
        *(_row(str(s.name), result, None) for s, result in found.items() if s.shape == "across" and isinstance(s.name, str)),
        "",
        "### Table 4.10: with the limiter, squares",
        "",
        *_table(found, "square", True, p.LIMITED_SQUARES),
        "",
        "### Table 4.10: with the limiter, ellipses",
        "",
        *_table(found, "ellipse", True, p.LIMITED_ELLIPSES),
        "",
        *claims(found),
    ]


def claims(found: dict[Setting, Score]) -> list[str]:
    """What the publication concludes from these tables, and whether it holds here."""
    by = {(s.name, s.shape, s.limited): result for s, result in found.items()}
    square, ellipse, across = ({size: by[size, shape, False] for size in SIZES} for shape in SHAPES)
    fewer = [size for size in SIZES if ellipse[size].blunders < square[size].blunders]
    better = [size for size in SIZES if across[size].blunders < ellipse[size].blunders]
    precise = [size for size in SIZES if ellipse[size].vertical <= square[size].vertical]
    best = max(SIZES, key=lambda size: square[size].correct)
    least = min(SIZES, key=lambda size: square[size].blunders)
    small = by[7, "square", False], by[7, "square", True]
    return [
        "### Published claims",
        "",
        "| claim | here |",
        "| --- | --- |",
        f"| the best square is 27 px | most correct at {best} px, fewest blunders at {least} px |",
        f"| ellipses give fewer blunders than squares at all 15 sizes | at {len(fewer)} of 15: {_list(fewer)} |",
        f"| ellipses are no less accurate (FGDC vertical) at any size | at {len(precise)} of 15: {_list(precise)} |",
        f"| ellipses across give fewer blunders than along (13 of 15 printed) | at {len(better)} of 15: {_list(better)} |",
        f"| the limiter mends small squares (7 px: 2.0 / 4.0 m to 0.2 / 0.5 m) | {small[0].horizontal:.2f} / "
        f"{small[0].vertical:.2f} m to {small[1].horizontal:.2f} / {small[1].vertical:.2f} m |",
    ]


def _list(sizes: list[int]) -> str:
    return ", ".join(map(str, sizes)) or "none"


def strategy_page(experiment: Experiment) -> list[str]:
    """Clean and noise version, the recipes of now beside the published one."""
    lines = [
        "| strategy | pair | returned % | blunders % of tested | correct of tested % | RMS Z of all returned m |",
        "| --- | --- | --- | --- | --- | --- |",
    ]
    for pair, radiometry in (("clean", CLEAN), ("noise", NOISY)):
        lines += [
            f"| {name} | {pair} | {s.returned:.2f} | {s.blunder_share:.3f} | {s.correct:.2f} | {s.rms[2]:.4f} |"
            for name, s in strategies(experiment, radiometry).items()
        ]
    return lines
