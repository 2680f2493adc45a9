"""What the publication leaves open, measured: where gradients are taken, how sharp the texture is, how much contrast it has.

Strategy. Fixed windows of table 4.6 (4.8, 4.11) are repeated with every reading of the gradients that the text allows, on the
texture itself, on the same slightly softened, and on the shipped one: what changes with the texture is not the recipe's. No
reading knows a limiter. Statistical sizes are repeated with more contrast about the local mean, roundness limits with one-sided
differences.

Source: Skarlatos (sources/matching.md#least-squares, #window-size, #open, #synthetic-pair), tables 4.6 to 4.8 and 4.11.
"""

from collections.abc import Callable

import cv2
import numpy as np

from benchmarks.matching import matching_published as p
from benchmarks.matching.dissertation_pair import GroundTexture, ground_texture
from benchmarks.matching.matching_experiment import Experiment, Score, score
from benchmarks.matching.matching_windows import SHAPES, SIZES, STATISTICAL, Prepared, differences
from benchmarks.matching.published_recipe import published
from orthomill.tasks.matching.least_squares.least_squares_settings import Ellipse, LeastSquaresMatching, Square
from orthomill.tasks.matching.least_squares.matching import match_points
from orthomill.tasks.matching.windows.sizes import grey_levels, window_sizes

SOFTENED = 0.8
"""texture px: sigma of the Gaussian"""
PRINTED = {"square": p.SQUARES, "ellipse": p.ELLIPSES, "across": p.ACROSS}
READINGS = {
    "window_right": "resampled right window, one-sided at its border, as they are",
    "resampled_right": "resampled right window and a ring around it, carried to the right axes",
    "resampled_left": "resampled left window and a ring around it",
    "whole_pixels": "whole pixels of the right image",
}
_ROUNDNESS = {"F1": 0.5, "F4": 0.675, "F7": 0.75}
_NEIGHBOURHOOD = 301
"""px: side of the square whose mean counts as local"""


def reading(window: int, shape: Square | Ellipse, gradients: str) -> LeastSquaresMatching:
    """The published recipe without its limiter, with other gradients."""
    recipe = published(window, shape, limited=False)
    return recipe.model_copy(update={"formulation": recipe.formulation.model_copy(update={"gradients": gradients})})


def scores(experiment: Experiment) -> dict[tuple[str, str, int], Score]:
    """Every reading of every shape and size: (shape, gradients, size)."""
    wanted = [
        (shape, gradients, size)
        for shape in SHAPES
        for gradients in READINGS
        for size in SIZES
        if shape == "square" or gradients != "window_right"
    ]
    errors = {key: np.full((len(experiment.points), 3), np.nan) for key in wanted}
    for band in experiment.bands():
        images = Prepared(band.crop.left, band.crop.right)
        for shape, gradients, size in wanted:
            recipe = reading(size, SHAPES[shape], gradients)
            found = match_points(*images.of(recipe), band.points, band.starts, recipe)
            errors[shape, gradients, size][band.rows] = band.errors(found)
    return {key: score(table) for key, table in errors.items()}


def with_contrast(image: np.ndarray, gain: float) -> np.ndarray:
    """An image uint8 whose differences from the local mean are multiplied."""
    mean = cv2.blur(image.astype(np.float32), (_NEIGHBOURHOOD, _NEIGHBOURHOOD))
    return np.clip(np.rint(mean + np.float32(gain) * (image - mean)), 1, 255).astype(np.uint8)


def roundest(image: np.ndarray, points: np.ndarray, one_sided: bool) -> np.ndarray:
    """(N,) the greatest roundness of the windows 7 to 35 px about points (N, 2), with central or one-sided differences."""
    grey = image.astype(np.float64)
    gx, gy = np.zeros_like(grey), np.zeros_like(grey)
    if one_sided:
        gx[:, 1:], gy[1:] = np.diff(grey, axis=1), np.diff(grey, axis=0)
    else:
        gx[:, 1:-1], gy[1:-1] = (grey[:, 2:] - grey[:, :-2]) / 2, (grey[2:] - grey[:-2]) / 2
    col, row = points.astype(int).T
    best = np.zeros(len(points))
    for size in SIZES:
        xx, xy, yy = (cv2.blur(product, (size, size))[row, col] for product in (gx * gx, gx * gy, gy * gy))
        best = np.maximum(best, 4.0 * (xx * yy - xy * xy) / np.maximum(xx + yy, 1e-9) ** 2)
    return best


def readings_page(texture: GroundTexture, experiment_on: Callable[[GroundTexture], Experiment]) -> list[str]:
    """Markdown: the readings of the gradients; statistical sizes by contrast; roundness limits by kind of difference."""
    soft = GroundTexture(cv2.GaussianBlur(texture.pixels, (0, 0), SOFTENED), f"{texture.name}, softened {SOFTENED} px")
    shipped = ground_texture()
    textures = [texture, soft] if shipped.name == texture.name else [texture, soft, shipped]
    experiment = experiment_on(texture)
    lines = [
        f"{len(experiment.points)} points. Largest difference of the shares from the printed ones among the 15 sizes, "
        "in points, and the size (px) it belongs to.",
        "",
        "| shape | gradients | texture | returned | correct | blunders |",
        "| --- | --- | --- | --- | --- | --- |",
    ]
    found = {chosen.name: scores(experiment_on(chosen)) for chosen in textures}
    for shape, gradients in dict.fromkeys(key[:2] for key in found[texture.name]):
        for name, table in found.items():
            worst = differences({size: table[shape, gradients, size] for size in SIZES}, PRINTED[shape])
            cells = " | ".join(f"{value:+.1f} ({size})" for size, value in worst.values())
            lines.append(f"| {shape} | {READINGS[gradients]} | {name} | {cells} |")
    return [*lines, "", *_mirrored_page(experiment), "", *_sizes_page(experiment)]


def _mirrored_page(experiment: Experiment) -> list[str]:
    """The smallest square with and without the limiter, mirrored windows refused or let on."""
    lines = [
        "The square of 7 px (printed with the limiter: table 4.10):",
        "",
        "| mirrored windows | limiter | returned % | blunders % | FGDC horizontal m | FGDC vertical m |",
        "| --- | --- | --- | --- | --- | --- |",
    ]
    for mirrored in ("refused", "let on"):
        for limited, printed in ((False, p.SQUARES[7]), (True, p.LIMITED_SQUARES[7])):
            recipe = published(7, limited=limited)
            limit = recipe.formulation.max_area_change if mirrored == "refused" else None
            forward = recipe.formulation.model_copy(update={"max_area_change": limit})
            errors = np.full((len(experiment.points), 3), np.nan)
            for band in experiment.bands():
                found = match_points(
                    band.crop.left, band.crop.right, band.points, band.starts, recipe.model_copy(update={"formulation": forward})
                )
                errors[band.rows] = band.errors(found)
            ours, blunders = score(errors), 100.0 * printed.blunders / p.TESTED
            lines.append(
                f"| {mirrored} | {'on' if limited else 'off'} | {ours.returned:.2f} / {printed.correct + blunders:.2f} | "
                f"{ours.blunder_share:.2f} / {blunders:.2f} | {ours.horizontal:.2f} / {printed.horizontal:.2f} | "
                f"{ours.vertical:.2f} / {printed.vertical:.2f} |"
            )
    return lines


def _sizes_page(experiment: Experiment) -> list[str]:
    gains = (1.0, 2.0, 3.0)
    given: dict[tuple[str, float], list[np.ndarray]] = {(name, gain): [] for name in STATISTICAL for gain in gains}
    round_enough: dict[bool, list[np.ndarray]] = {False: [], True: []}
    for band in experiment.bands():
        for one_sided, parts in round_enough.items():
            parts.append(roundest(band.crop.left, band.points, one_sided))
        for gain in gains:
            grey = grey_levels(with_contrast(band.crop.left, gain))
            for name, sizing in STATISTICAL.items():
                given[name, gain].append(window_sizes(grey, band.points, sizing).assigned)
    share = {key: 100.0 * np.concatenate(parts).mean() for key, parts in given.items()}
    central, one_sided = (np.concatenate(parts) for parts in round_enough.values())
    return [
        "Windows assigned by the statistical rules, per cent, with the contrast about the local mean multiplied:",
        "",
        "| method | printed | 1 | 2 | 3 |",
        "| --- | --- | --- | --- | --- |",
        *(
            f"| {name} | {p.ASSIGNED[name]:.2f} | " + " | ".join(f"{share[name, gain]:.2f}" for gain in gains) + " |"
            for name in STATISTICAL
        ),
        "",
        "Points with a window that is round enough, per cent, whatever its weight (printed: with the lowest limit of the weight):",
        "",
        "| method | roundness | printed | central differences | one-sided |",
        "| --- | --- | --- | --- | --- |",
        *(
            f"| {name} | {limit} | {p.ASSIGNED[name]:.2f} | {100 * (central > limit).mean():.2f} | "
            f"{100 * (one_sided > limit).mean():.2f} |"
            for name, limit in _ROUNDNESS.items()
        ),
    ]
