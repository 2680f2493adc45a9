"""Targets drawn with a known centre (perspective, blur, noise, a shadow's gradient): how far off are the centres that are found?

python -m benchmarks drawn_targets [EACH]
"""

import sys

import cv2
import numpy as np

from benchmarks.instrument.result_page import write_page
from orthomill.schemas.marks import FoundTarget
from orthomill.tasks.geometry.rotation import rotation_matrix
from orthomill.tasks.targets.coded_targets import coded_targets
from orthomill.tasks.targets.photo_targets import photo_targets
from orthomill.tasks.targets.ring_code_words import word_numbers

FINER = 8
"""Samples of a pixel along and across."""
SIDE = 96
KINDS = ("chequered", "cross", "circle", "tag36h11", "ring12", "ring14")
CODED = KINDS[3:]
CONSTANTS = (600.0, 5000.0)
"""px: camera constants, from small copies of photographs and wide lenses to whole photographs"""


def pattern(kind: str, u: np.ndarray, v: np.ndarray, number: int = 7) -> np.ndarray:
    """Reflectance 0 to 1 of a plate at (u, v), its centre 0, its edge at 1, of codes that with a `number`; NaN beyond it."""
    if kind == "chequered":
        inside = np.where(u * v > 0, 0.05, 0.95)
    elif kind == "cross":
        inside = np.where((np.abs(u) < 0.14) | (np.abs(v) < 0.14), 0.95, 0.1)
    elif kind == "circle":
        inside = np.where(np.hypot(u, v) < 0.5, 0.95, 0.1)
    elif kind.startswith("ring"):
        inside = ring_pattern(int(kind[4:]), number, u, v)
    else:
        code = cv2.aruco.generateImageMarker(cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11), number, 8)
        cells = np.pad(code, 1, constant_values=255) / 255.0
        index = [np.clip(((w + 1) / 2 * 10).astype(int), 0, 9) for w in (v, u)]
        inside = cells[index[0], index[1]]
    return np.where(np.maximum(np.abs(u), np.abs(v)) <= 1.0, inside, np.nan)


def word_segments(word: int, segments: int) -> np.ndarray:
    """(segments,) 0 and 1 of a word, clockwise."""
    return (word >> np.arange(segments - 1, -1, -1)) & 1


def ring_pattern(segments: int, number: int, u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Reflectance of a dot with a code on its ring: radii 1, 2 and 3 of 4 to the edge of the plate."""
    word = {rank: word for word, rank in word_numbers(segments).items()}[number]
    radius = 4.0 * np.hypot(u, v)
    segment = np.floor(np.arctan2(v, u) / (2.0 * np.pi) * segments).astype(int) % segments
    ring = (radius > 2.0) & (radius < 3.0) & (word_segments(word, segments)[segment] == 1)
    return np.where((radius < 1.0) | ring, 0.05, 0.95)


def drawn(kind: str, rng: np.random.Generator, number: int = 7, c: float = 3000.0) -> tuple[np.ndarray, np.ndarray]:
    """A picture (SIDE, SIDE) float32 of 0 to 255 with one target as a camera constant c (px) shows it, and its centre (2,) (col,
    row)."""
    centre = SIDE / 2 + rng.uniform(-3, 3, 2)
    half = rng.uniform(8, 18) if kind not in CODED else rng.uniform(18, 34)
    axis = (np.arange(SIDE * FINER) + 0.5) / FINER - 0.5
    x, y = np.meshgrid(axis - centre[0], axis - centre[1])
    u, v, w = np.einsum("ij,jrc->irc", np.linalg.inv(plate_in_image(half, c, rng)), np.stack([x, y, np.ones_like(x)]))
    plate = pattern(kind, u / w, v / w, number)
    ground = cv2.GaussianBlur(rng.normal(0.4, 0.6, x.shape).astype(np.float32), (0, 0), FINER * 1.5)
    scene = np.where(np.isnan(plate), np.clip(ground, 0, 1), plate).astype(np.float32)
    blurred = cv2.GaussianBlur(scene, (0, 0), FINER * rng.uniform(0.4, 0.9))
    pixels = blurred.reshape(SIDE, FINER, SIDE, FINER).mean(axis=(1, 3))
    light = rng.uniform(120, 200) * (1.0 + rng.uniform(-0.003, 0.003) * (np.arange(SIDE) - centre[0]))
    return np.clip(np.round(20 + light * pixels + rng.normal(0, 2.0, pixels.shape)), 0, 255).astype(np.float32), centre


def plate_in_image(half: float, c: float, rng: np.random.Generator) -> np.ndarray:
    """(3, 3): homogeneous pixels, from the centre of a plate, of its points (u, v, 1); it is 2 `half` px wide, turned, and leans by
    up to 41 degrees."""
    turn, towards, lean = rng.uniform(0, 2 * np.pi), rng.uniform(0, 2 * np.pi), np.arccos(rng.uniform(0.75, 1.0))
    Z, X, A = (rotation_matrix(*angles) for angles in ((0, 0, towards), (lean, 0, 0), (0, 0, turn)))
    axes = (Z @ X @ A)[:, :2]
    distance = c / half
    return np.diag([c, c, 1.0]) @ np.column_stack([axes, [0.0, 0.0, distance]])


def nearest(found: tuple[FoundTarget, ...], kind: str, centre: np.ndarray) -> FoundTarget | None:
    """The target of a kind within two pixels of a centre."""
    own = [one for one in found if one.kind == ("coded" if kind in CODED else kind) and np.hypot(*(centre - one.place)) < 2.0]
    return min(own, key=lambda one: float(np.hypot(*(centre - one.place))), default=None)


def without_target(rng: np.random.Generator) -> np.ndarray:
    """A picture (SIDE, SIDE) uint8 of ground of any roughness, of every second one with dots and rings on it."""
    ground = cv2.GaussianBlur(rng.normal(0, 1, (SIDE, SIDE)).astype(np.float32), (0, 0), rng.uniform(0.6, 6.0))
    picture = np.clip(128 + rng.uniform(20, 80) * ground / ground.std(), 0, 255).astype(np.uint8)
    for _ in range(int(rng.integers(0, 2)) * 4):
        place = tuple(int(n) for n in rng.integers(15, SIDE - 15, 2))
        thick = int(rng.choice([-1, 2, 5]))
        cv2.circle(picture, place, int(rng.integers(3, 20)), int(rng.integers(0, 255)), thick, cv2.LINE_AA)
    return cv2.GaussianBlur(picture, (0, 0), rng.uniform(0.4, 0.9))


def main(words: list[str]) -> None:
    """Keeps the page."""
    each = int(words[0]) if words else 150
    rng = np.random.default_rng(5)
    lines = [
        "| target | found | rms of a coordinate, px | largest, px | error by standard error, rms | read with another number |",
        "| --- | --- | --- | --- | --- | --- |",
    ]
    for kind in KINDS:
        errors, ratio, misread = [], [], 0
        for _ in range(each):
            number = int(rng.integers(1, 140))
            c = float(np.exp(rng.uniform(*np.log(CONSTANTS))))
            picture, centre = drawn(kind, rng, number, c)
            one = nearest(photo_targets(picture, c), kind, centre)
            misread += one is not None and one.name not in ("", f"{kind}-{number}")
            if one is not None:
                errors.append(np.array(one.place) - centre)
                ratio.append(errors[-1] / one.sigma)
        away = np.array(errors)
        lines.append(
            f"| {kind} | {100 * len(away) / each:.0f} % | {np.sqrt((away**2).mean()):.3f} | {np.abs(away).max():.2f} | "
            f"{np.sqrt((np.array(ratio) ** 2).mean()):.2f} | {misread if kind in CODED else ''} |"
        )
    preface = (
        "Plates of 16 to 36 px (codes of 36 to 68 px), turned, leaning by up to 41 degrees before cameras of "
        f"{CONSTANTS[0]:.0f} to {CONSTANTS[1]:.0f} px, blurred by 0.4 to 0.9 px, noise of 2 grey values, "
        "light that falls off, on textured ground."
    )
    patches = 100 * each
    accepted = sum(len(coded_targets(without_target(rng))) for _ in range(patches))
    told = f"Pictures of {SIDE} px without a target, half of them with dots and rings: {patches}; codes read in them: {accepted}."
    write_page("drawn_targets", words, "\n".join(["# Centres of drawn targets", "", preface, "", *lines, "", told]))


if __name__ == "__main__":
    main(sys.argv[1:])
