"""The published tables of the window experiments, as printed, for comparison with what is measured here.

Rows: returned %, number of blunders, correct of all tested %, FGDC 95 % accuracy horizontal and vertical (m). All per cent are of
41079 points. Source: Skarlatos (sources/matching.md#results), tables 4.6 to 4.12.
"""

from typing import NamedTuple

TESTED = 41079
NAN = float("nan")


class Published(NamedTuple):
    """One row of a table. NaN where a cell is empty."""

    returned: float
    blunders: int
    correct: float
    horizontal: float
    vertical: float


SQUARES = {
    7: Published(75.97, 2630, 69.57, 1.98, 3.96),
    9: Published(87.07, 2076, 82.01, 0.48, 1.0),
    11: Published(92.56, 1740, 88.32, 0.29, 0.75),
    13: Published(95.48, 1403, 92.06, 0.31, 0.57),
    15: Published(96.86, 1070, 94.26, 0.15, 0.31),
    17: Published(97.78, 864, 95.68, 0.14, 0.28),
    19: Published(98.24, 719, 96.49, 0.12, 0.25),
    21: Published(98.54, 610, 97.05, 0.12, 0.23),
    23: Published(98.77, 554, 97.42, 0.1, 0.21),
    25: Published(98.91, 542, 97.59, 0.1, 0.2),
    27: Published(98.98, 541, 97.67, 0.09, 0.19),
    29: Published(99.02, 590, 97.58, 0.09, 0.18),
    31: Published(99.05, 653, 97.46, 0.09, 0.18),
    33: Published(99.1, 737, 97.31, 0.14, 0.19),
    35: Published(99.09, 883, 96.94, 0.1, 0.19),
}
"""Tables 4.6, 4.8 and 4.11, by side of the window"""
ELLIPSES = {
    7: Published(70.21, 1700, 66.07, 0.24, 0.47),
    9: Published(83.65, 1508, 79.98, 0.22, 0.43),
    11: Published(90.91, 1239, 87.89, 0.18, 0.37),
    13: Published(94.56, 996, 92.14, 0.16, 0.31),
    15: Published(96.72, 803, 94.76, 0.14, 0.28),
    17: Published(97.95, 642, 96.39, 0.12, 0.24),
    19: Published(98.64, 570, 97.25, 0.12, 0.23),
    21: Published(98.97, 498, 97.76, 0.1, 0.21),
    23: Published(99.2, 443, 98.12, 0.09, 0.19),
    25: Published(99.35, 448, 98.25, 0.09, 0.18),
    27: Published(99.48, 457, 98.37, 0.08, 0.17),
    29: Published(99.45, 512, 98.2, 0.09, 0.17),
    31: Published(99.48, 564, 98.11, 0.09, 0.17),
    33: Published(99.51, 665, 97.89, 0.09, 0.17),
    35: Published(99.44, 769, 97.56, 0.09, 0.17),
}
"""Tables 4.8 and 4.11"""
ACROSS = {
    7: Published(70.09, 1643, 66.09, 0.24, 0.48),
    9: Published(83.64, 1459, 80.09, 0.21, 0.41),
    11: Published(90.72, 1269, 87.63, 0.18, 0.36),
    13: Published(94.63, 962, 92.29, 0.16, 0.31),
    15: Published(96.7, 768, 94.83, 0.13, 0.26),
    17: Published(97.91, 584, 96.48, 0.12, 0.23),
    19: Published(98.56, 508, 97.33, 0.1, 0.21),
    21: Published(98.98, 407, 97.98, 0.1, 0.18),
    23: Published(99.2, 375, 98.28, 0.09, 0.17),
    25: Published(99.28, 339, 98.45, 0.08, 0.16),
    27: Published(99.41, 303, 98.67, 0.07, 0.15),
    29: Published(99.41, 307, 98.66, 0.08, 0.15),
    31: Published(99.49, 313, 98.73, 0.07, 0.14),
    33: Published(99.46, 345, 98.62, 0.07, 0.14),
    35: Published(99.46, 395, 98.5, 0.07, 0.15),
}
"""Table 4.11: ellipses across the uncertainty"""
ASSIGNED = {
    "S1": 60.15,
    "S2": 64.16,
    "S3": 70.65,
    "S4": 79.7,
    "S5": 62.55,
    "S6": 66.33,
    "S7": 72.54,
    "S8": 80.42,
    "E1": 96.51,
    "E2": 83.68,
    "E3": 52.21,
    "E4": 98.46,
    "E5": 90.73,
    "E6": 69.98,
    "E7": 99.26,
    "E8": 94.43,
    "E9": 80.36,
    "E10": 99.58,
    "E11": 96.46,
    "E12": 86.86,
    "E13": 99.78,
    "E14": 97.76,
    "E15": 91.38,
    "F1": 99.77,
    "F2": 99.53,
    "F3": 93.74,
    "F4": 99.34,
    "F5": 98.76,
    "F6": 86.37,
    "F7": 98.94,
    "F8": 97.96,
    "F9": 79.99,
    "F10": 94.9,
}
"""Table 4.7: points that were given a window, %"""
DYNAMIC_SQUARES = {
    "S1": Published(57.92, 550, 56.58, 0.31, 0.77),
    "S2": Published(61.77, 591, 60.33, 0.36, 0.82),
    "S3": Published(67.89, 661, 66.28, 0.37, 0.82),
    "S4": Published(75.9, 799, 73.95, 0.35, 0.78),
    "S5": Published(60.05, 598, 58.6, 0.31, 0.76),
    "S6": Published(63.73, 631, 62.2, 0.35, 0.81),
    "S7": Published(69.65, 698, 67.95, 0.36, 0.81),
    "S8": Published(76.57, 815, 74.59, 0.35, 0.78),
    "E1": Published(88.75, 1369, 85.42, 0.32, 0.58),
    "E2": Published(82.03, 623, 80.51, 0.16, 0.35),
    "E3": Published(51.43, 315, 50.66, 0.1, 0.2),
    "E4": Published(90.5, 1414, 87.06, 0.32, 0.58),
    "E5": Published(88.74, 713, 87.0, 0.26, 0.52),
    "E6": Published(68.79, 457, 67.68, 0.25, 0.48),
    "E7": Published(91.16, 1444, 87.64, 0.32, 0.59),
    "E8": Published(92.2, 792, 90.27, 0.26, 0.51),
    "E9": Published(78.9, 590, 77.46, 0.24, 0.46),
    "E10": Published(91.32, 1480, 87.72, 0.32, 0.59),
    "E11": Published(93.98, 845, 91.92, 0.26, 0.51),
    "E12": Published(85.09, 651, 83.51, 0.23, 0.45),
    "E13": Published(91.4, 1502, 87.75, 0.32, 0.59),
    "E14": Published(95.06, 888, 92.9, 0.26, 0.51),
    "E15": Published(89.33, 718, 87.58, 0.23, 0.45),
    "F1": Published(93.48, 1330, 90.24, 0.4, 0.89),
    "F2": Published(97.37, 766, 95.51, 0.16, 0.34),
    "F3": Published(92.4, 626, 90.87, 0.1, 0.21),
    "F4": Published(93.83, 1240, 90.81, 0.32, 0.84),
    "F5": Published(96.76, 765, 94.9, 0.16, 0.34),
    "F6": Published(85.15, 610, 83.67, 0.11, 0.21),
    "F7": Published(94.02, 1188, 91.12, 0.32, 0.83),
    "F8": Published(96.01, 726, 94.25, 0.12, 0.24),
    "F9": Published(78.87, 589, 77.44, 0.1, 0.21),
    "F10": Published(93.43, 637, 91.88, 0.11, 0.22),
}
"""Tables 4.7 and 4.9"""
DYNAMIC_ELLIPSES = {
    "S1": Published(57.8, 401, 56.82, 0.13, 0.24),
    "S2": Published(61.68, 430, 60.63, 0.12, 0.24),
    "S3": Published(67.75, 480, 66.58, 0.12, 0.23),
    "S4": Published(75.82, 602, 74.36, 0.66, 1.65),
    "S5": Published(59.99, 442, 58.92, 0.13, 0.25),
    "S6": Published(63.69, 464, 62.56, 0.12, 0.24),
    "S7": Published(69.53, 512, 68.29, 0.13, 0.24),
    "S8": Published(76.5, 613, 75.01, 0.13, 0.26),
    "E1": Published(89.38, 1108, 86.68, 0.17, 0.33),
    "E2": Published(82.44, 495, 81.24, 0.11, 0.22),
    "E3": Published(51.54, 269, 50.89, 0.09, 0.19),
    "E4": Published(91.06, 1132, 88.3, 0.18, 0.34),
    "E5": Published(89.15, 570, 87.76, 0.11, 0.23),
    "E6": Published(68.94, 370, 68.04, 0.1, 0.2),
    "E7": Published(91.64, 1158, 88.82, 0.18, 0.34),
    "E8": Published(92.56, 644, 90.99, 0.12, 0.24),
    "E9": Published(78.99, 487, 77.8, 0.11, 0.22),
    "E10": Published(91.71, 1178, 88.84, 0.18, 0.35),
    "E11": Published(94.26, 684, 92.6, 0.12, 0.25),
    "E12": Published(85.14, 538, 83.83, 0.11, 0.22),
    "E13": Published(91.73, 1189, 88.84, 0.18, 0.35),
    "E14": Published(95.26, 710, 93.53, 0.12, 0.25),
    "E15": Published(89.35, 572, 87.95, 0.11, 0.22),
    "F1": Published(92.44, 1031, 89.93, 0.17, 0.32),
    "F2": Published(97.65, 615, 96.15, 0.12, 0.23),
    "F3": Published(92.85, 542, 91.53, 0.09, 0.18),
    "F4": Published(92.96, 952, 90.64, 0.16, 0.31),
    "F5": Published(97.06, 588, 95.63, 0.11, 0.22),
    "F6": Published(85.59, 519, 84.33, 0.09, 0.18),
    "F7": Published(93.18, 914, 90.96, 0.16, 0.31),
    "F8": Published(96.4, 577, 95.0, 0.11, 0.22),
    "F9": Published(79.27, 505, 78.04, 0.09, 0.18),
    "F10": Published(93.88, 541, 92.56, 0.1, 0.19),
}
"""Table 4.9"""
LIMITED_SQUARES = {
    7: Published(NAN, 1703, 75.2, 0.23, 0.46),
    9: Published(NAN, 1650, 85.02, 0.21, 0.41),
    11: Published(NAN, 1532, 89.95, 0.19, 0.37),
    "F1": Published(NAN, 1136, 91.48, 0.17, 0.33),
    "F2": Published(NAN, 732, 95.72, 0.12, 0.24),
    "F3": Published(NAN, 622, 90.93, 0.1, 0.2),
}
"""Table 4.10, rows with the limiter"""
LIMITED_ELLIPSES = {
    7: Published(NAN, 1518, 69.05, 0.22, 0.43),
    9: Published(NAN, 1340, 81.9, 0.2, 0.4),
    11: Published(NAN, 1122, 88.72, 0.17, 0.34),
    "F1": Published(NAN, 921, 90.59, 0.16, 0.3),
    "F2": Published(97.72, 549, 96.39, 0.11, 0.21),
    "F3": Published(92.85, 414, 91.84, 0.09, 0.17),
}
"""Table 4.10, rows with the limiter"""
EXTRACTION = {"square": (96.38, 0.09), "ellipse": (99.29, 0.05), "across": (99.42, 0.04)}
"""Table 4.12: correct of converged %, RMS Z (m)"""
