"""The weaknesses of a calibration in words: what was found, what it means, and what to photograph instead."""

from collections.abc import Callable

from orthomill.schemas.errors import some_of
from orthomill.tasks.calibration.diagnosis.advice import CELLS, Advice, Weakness


def advice_sentence(advice: Advice) -> str:
    """The sentence for one weakness."""
    return _SENTENCES[advice.code](advice)


def _no_tilt(advice: Advice) -> str:
    return (
        f"All photographs look straight down on the boards (largest tilt {advice.value:.1f} degrees): c and the distance Z0 "
        "cannot be separated; tilt the camera by 20 to 40 degrees in different directions."
    )


def _little_tilt(advice: Advice) -> str:
    return (
        f"Most photographs look straight down on the boards (median tilt {advice.value:.1f} degrees): c and the distance Z0 are "
        "correlated; add photographs tilted by 20 to 40 degrees."
    )


def _one_sided_tilt(advice: Advice) -> str:
    return (
        "The photographs are tilted towards one side only: the principal point and the tilt are correlated; tilt the camera "
        "towards all four sides."
    )


def _not_turned(advice: Advice) -> str:
    return (
        f"The camera was not turned about its axis (kappa differs by {advice.value:.0f} degrees at most): x0 is correlated "
        "with phi and y0 with omega; take some photographs turned by 90 degrees."
    )


def _little_coverage(advice: Advice) -> str:
    cells = f"{CELLS} x {CELLS} cells"
    return (
        f"Corners cover only {100 * advice.value:.0f} % of the frame's {cells}; distortion elsewhere is extrapolated: add "
        "photographs with boards near the edges and in the corners of the frame."
    )


def _strong_correlation(advice: Advice) -> str:
    return (
        f"Strong correlations between interior and exterior orientation: {', '.join(_percentages(advice))}; add photographs that "
        "are turned by 90 degrees and tilted towards all four sides."
    )


def _not_checked(advice: Advice) -> str:
    return "There are too few photographs of boards to check the calibration on held-out ones."


def _held_out_worse(advice: Advice) -> str:
    return (
        f"Held-out photographs fit {advice.value:.1f} times worse than those used; the standard errors of the interior "
        "orientation are too small by about the same factor."
    )


def _halves_differ(advice: Advice) -> str:
    return (
        f"Two halves of the photographs differ in {advice.names[0]} by {advice.value:.1f} of its formal standard errors: the "
        "formal precision is too optimistic; take the difference of the halves for the precision."
    )


def _many_rejected(advice: Advice) -> str:
    return (
        f"{100 * advice.value:.0f} % of the corners were rejected: look for boards that are not flat, were moved between "
        "photographs, or are not all of one size."
    )


def _large_sigma0(advice: Advice) -> str:
    return (
        f"sigma0 is {advice.value:.2f} px, far more than the precision of corners: the boards were moved, are warped or of "
        "different size, the lens was refocused, or the distortion model does not suit the lens. Boards on an uneven floor "
        "need arrangement: space. The standard errors do not include such errors: do not sign this calibration."
    )


def _rejected_outside(advice: Advice) -> str:
    return (
        f"{100 * advice.value:.0f} % of the outermost corners were rejected, far more than elsewhere: the model does not follow "
        "the lens there. Do not sign this calibration; use model: automatic, or a model for wide lenses (rational, fisheye)."
    )


def _rejected_together(advice: Advice) -> str:
    return (
        f"Rejected corners lie together on the boards in {some_of(advice.names)}: the board was bent or moved there, or the model "
        "does not follow the lens; look at the pictures of these photographs."
    )


def _all_worse(advice: Advice) -> str:
    return (
        f"All corners of held-out photographs fit to {advice.value:.2g} px, those that were kept to {advice.values[0]:.2g} px: the "
        "rejected ones hide an error; the standard errors hold for the others only."
    )


def _uneven_boards(advice: Advice) -> str:
    return (
        f"The residuals of board {', '.join(advice.names)} are more than {advice.value:g} times those of the others: it is "
        "warped, of another size, or was moved."
    )


def _bent_board(advice: Advice) -> str:
    return (
        f"Board {advice.names[0]} is bent by {1e3 * abs(advice.value):.1f} mm (standard error {1e3 * advice.values[0]:.2f} mm). "
        "That was estimated, and does not falsify the camera as long as the board kept its shape; a stiff board is better."
    )


def _blurred(advice: Advice) -> str:
    named = [f"{name} ({value:.1f} px)" for name, value in zip(advice.names, advice.values, strict=True)]
    return (
        f"Blurred, by the standard deviation of the edges of the squares: {some_of(named)}; use photographs in focus and without "
        "motion blur."
    )


def _overexposed(advice: Advice) -> str:
    return (
        f"Overexposed, by the share of saturated pixels of the boards: {some_of(_percentages(advice))}; bright squares grow "
        "and shift the corners, so expose less."
    )


def _larger_boards(advice: Advice) -> str:
    photos = some_of(advice.names)
    return f"Boards with more corners than stated were found and left out in {photos}; check the number of inner corners."


def _other_boards(advice: Advice) -> str:
    columns, rows = advice.corners
    return f"Boards with {columns} x {rows} inner corners were found in {advice.value:.0f} photographs; is that the number?"


def _not_square(advice: Advice) -> str:
    return (
        f"Pixels are {100 * abs(advice.value):.2g} % off square ({advice.values[0]:.0f} of its standard errors), which sensors are "
        "not: the images were scaled differently in width and height, the boards have no squares, or the lens is not followed."
    )


def _undetermined(advice: Advice) -> str:
    return (
        f"Coefficients of the lens that nothing determines one by one: {some_of(advice.names)}; only their common curve within the "
        "corners is known. A smaller model, or photographs with boards in the corners of the frame, would determine them."
    )


def _constant_uncertain(advice: Advice) -> str:
    return (
        f"The camera constant of {advice.value:.4g} px has a standard error of {advice.values[0]:.2g} px: take more photographs, "
        "tilted by 20 to 40 degrees, with boards that fill the frame."
    )


def _percentages(advice: Advice) -> list[str]:
    return [f"{name} ({100 * value:.0f} %)" for name, value in zip(advice.names, advice.values, strict=True)]


_SENTENCES: dict[Weakness, Callable[[Advice], str]] = {
    Weakness.NO_TILT: _no_tilt,
    Weakness.LITTLE_TILT: _little_tilt,
    Weakness.ONE_SIDED_TILT: _one_sided_tilt,
    Weakness.NOT_TURNED: _not_turned,
    Weakness.LITTLE_COVERAGE: _little_coverage,
    Weakness.STRONG_CORRELATION: _strong_correlation,
    Weakness.NOT_CHECKED: _not_checked,
    Weakness.HELD_OUT_WORSE: _held_out_worse,
    Weakness.HALVES_DIFFER: _halves_differ,
    Weakness.MANY_REJECTED: _many_rejected,
    Weakness.LARGE_SIGMA0: _large_sigma0,
    Weakness.UNEVEN_BOARDS: _uneven_boards,
    Weakness.REJECTED_OUTSIDE: _rejected_outside,
    Weakness.REJECTED_TOGETHER: _rejected_together,
    Weakness.ALL_WORSE: _all_worse,
    Weakness.BENT_BOARD: _bent_board,
    Weakness.BLURRED: _blurred,
    Weakness.OVEREXPOSED: _overexposed,
    Weakness.LARGER_BOARDS: _larger_boards,
    Weakness.OTHER_BOARDS: _other_boards,
    Weakness.NOT_SQUARE: _not_square,
    Weakness.UNDETERMINED: _undetermined,
    Weakness.CONSTANT_UNCERTAIN: _constant_uncertain,
}
