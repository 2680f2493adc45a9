"""Colours of the portal's materials, painted from places on the surface: nothing is stored, and every ray finds its own detail.

Cloisonne masonry (stones framed by bricks, as Byzantine churches in Athens have it), veined marble, worn steps, a wooden door,
voussoirs of stone and brick, a painted niche. Detail goes down to 3 mm, about a pixel of the photographs.
"""

import numpy as np

from orthomill.kernels.kernel_compilation import njit
from orthomill.tasks.simulation.portal.portal_mesh import PortalMaterial
from orthomill.tasks.simulation.scene.hash_noise import uniform_of, value_noise

_MASONRY, _MARBLE, _STEPS, _FRESCO = (
    int(m) for m in (PortalMaterial.MASONRY, PortalMaterial.MARBLE, PortalMaterial.STEPS, PortalMaterial.FRESCO)
)
_WOOD, _VOUSSOIRS, _TILES, _PAVING = (
    int(m) for m in (PortalMaterial.WOOD, PortalMaterial.VOUSSOIRS, PortalMaterial.TILES, PortalMaterial.PAVING)
)
_PLASTER, _CLOTH, _SKIN, _LEAF = (
    int(m) for m in (PortalMaterial.PLASTER, PortalMaterial.CLOTH, PortalMaterial.SKIN, PortalMaterial.LEAF)
)


@njit()
def paint(material, s, t, seed, out):
    """Sets `out` (3,) to the reflectance 0 to 255 at the place (s, t) m of a surface."""
    grain = _grain(seed + material, s, t)
    if material == _MASONRY:
        _masonry(s, t, seed, out)
    elif material == _VOUSSOIRS:
        _voussoirs(s, t, seed, out)
    elif material == _MARBLE:
        vein = 1.0 - abs(value_noise(seed + 21, 3.0 * s + 1.4 * value_noise(seed + 22, 2.0 * s, 1.5 * t), 2.0 * t + s))
        dark = 46.0 * vein**9
        _set(out, 214.0 - dark, 208.0 - dark, 196.0 - 0.9 * dark)
    elif material in (_STEPS, _PAVING):
        _slabs(material, s, t, seed, out)
    elif material == _FRESCO:
        _fresco(s, t, seed, out)
    elif material == _WOOD:
        _wood(s, t, seed, out)
    elif material == _TILES:
        round_, row = abs(np.sin(np.pi * s / 0.18)), t / 0.3 - np.floor(t / 0.3)
        shade = 0.65 + 0.35 * round_ - (0.3 if row < 0.08 else 0.0)
        tone = 0.85 + 0.3 * uniform_of(seed + 41, int(np.floor(s / 0.18)), int(np.floor(t / 0.3)))
        _set(out, 176.0 * shade * tone, 104.0 * shade * tone, 72.0 * shade * tone)
    elif material == _PLASTER:
        stain = value_noise(seed + 51, 1.3 * s, 0.5 * t) + 0.6 * value_noise(seed + 52, 5.0 * s, 3.0 * t)
        _set(out, 196.0 + 20.0 * stain, 178.0 + 20.0 * stain, 150.0 + 18.0 * stain)
    elif material == _CLOTH:
        check = 22.0 if (int(np.floor(s / 0.04)) + int(np.floor(t / 0.04))) % 2 == 0 else 0.0
        _set(out, 58.0 + check, 70.0 + check, 118.0 + check)
    elif material == _SKIN:
        _set(out, 206.0, 160.0, 132.0)
    elif material == _LEAF:
        tone = 0.7 + 0.6 * uniform_of(seed + 61, int(np.floor(s)), 0)
        _set(out, 62.0 * tone, 104.0 * tone, 40.0 * tone)
    for band in range(3):
        out[band] = min(max(out[band] * (1.0 + 0.17 * grain), 4.0), 250.0)


@njit(inline="always")
def _set(out, red, green, blue):
    """A colour into `out` (3,)."""
    out[0], out[1], out[2] = red, green, blue


@njit(inline="always")
def _grain(seed, s, t):
    """Weathering in [-1, 1] from decimetres down to millimetres."""
    coarse, middle = value_noise(seed + 1, 6.0 * s, 6.0 * t), value_noise(seed + 2, 47.0 * s, 43.0 * t)
    return 0.4 * (coarse + middle + value_noise(seed + 3, 190.0 * s, 180.0 * t))


@njit()
def _masonry(s, t, seed, out):
    """The colour of a wall of stones and bricks at `s`, `t` (m) along and up, into `out` (3,)."""
    course = 0.31
    row = int(np.floor(t / course))
    long = 0.38 + 0.2 * uniform_of(seed + 11, row, 0)
    shift = uniform_of(seed + 12, row, 0) * long
    col = int(np.floor((s + shift) / long))
    u, v = s + shift - col * long, t - row * course
    # Edges of stones are not quite straight.
    rough = 0.004 * value_noise(seed + 13, 9.0 * s, 9.0 * t)
    u, v = u + rough, v + rough
    if v < 0.075:
        # Two courses of bricks below each course of stones.
        brick = int(np.floor((s + 0.11 * (row + int(v > 0.0375))) / 0.24))
        end = s + 0.11 * (row + int(v > 0.0375)) - brick * 0.24
        if end < 0.012 or v % 0.0375 < 0.010:
            _set(out, 190.0, 180.0, 162.0)
        else:
            _brick(seed, brick, 2 * row + int(v > 0.0375), out)
    elif u < 0.062:
        if u < 0.011 or u > 0.051:
            _set(out, 188.0, 178.0, 160.0)
        else:
            _brick(seed, 7 * col + 3, 5 * row, out)
    else:
        tone = 0.78 + 0.34 * uniform_of(seed + 15, col, row)
        warm = 12.0 * (uniform_of(seed + 16, col, row) - 0.5)
        edge = 0.86 if u < 0.07 or v < 0.083 or v > course - 0.006 else 1.0
        _set(out, (206.0 + warm) * tone * edge, 188.0 * tone * edge, (154.0 - warm) * tone * edge)


@njit(inline="always")
def _brick(seed, col, row, out):
    """The colour of one brick into `out` (3,)."""
    tone = 0.75 + 0.45 * uniform_of(seed + 17, col, row)
    _set(out, 166.0 * tone, 94.0 * tone, 66.0 * tone)


@njit()
def _voussoirs(s, t, seed, out):
    """The colour of the stones of an arch at `s` along and `t` across it (m), into `out` (3,)."""
    wedge = int(np.floor(s / 0.19))
    u = s - 0.19 * wedge
    if u < 0.01 or t < 0.012:
        _set(out, 182.0, 172.0, 156.0)
    elif wedge % 3 == 1:
        bricks = int(np.floor(u / 0.048))
        if u - bricks * 0.048 < 0.009:
            _set(out, 184.0, 174.0, 158.0)
        else:
            _brick(seed + 5, wedge, bricks, out)
    else:
        tone = 0.8 + 0.3 * uniform_of(seed + 18, wedge, int(np.floor(t / 0.45)))
        _set(out, 212.0 * tone, 196.0 * tone, 164.0 * tone)


@njit()
def _slabs(material, s, t, seed, out):
    """The colour of paving or steps at `s`, `t` (m), into `out` (3,)."""
    long, deep = (0.95, 10.0) if material == _STEPS else (0.72, 0.55)
    row = int(np.floor(t / deep))
    col = int(np.floor((s + 0.37 * row) / long))
    joint = (s + 0.37 * row - col * long) < 0.008 or (t - row * deep) < 0.008
    tone = 0.86 + 0.22 * uniform_of(seed + 31, col, 31 * row + material)
    worn = 9.0 * value_noise(seed + 32, 1.7 * s, 2.9 * t)
    if joint:
        _set(out, 92.0, 86.0, 78.0)
    else:
        _set(out, 190.0 * tone + worn, 184.0 * tone + worn, 170.0 * tone + worn)


@njit()
def _fresco(s, t, seed, out):
    """The colour of a damaged painting at `s`, `t` (m), into `out` (3,)."""
    band = t / 0.12
    if int(np.floor(band)) % 5 == 0:
        # A border of lozenges.
        inside = abs((s / 0.16) % 1.0 - 0.5) + abs(band % 1.0 - 0.5) < 0.38
        _set(out, 196.0, 158.0, 66.0) if inside else _set(out, 128.0, 42.0, 38.0)
    else:
        halo = ((s % 0.62) - 0.31) ** 2 + ((t - 0.3) % 0.9 - 0.3) ** 2
        if halo < 0.006:
            _set(out, 186.0, 142.0, 108.0)
        elif halo < 0.022:
            _set(out, 214.0, 178.0, 74.0)
        elif abs((s % 0.62) - 0.31) < 0.15:
            fold = 16.0 * np.sin(60.0 * s)
            _set(out, 142.0 + fold, 52.0 + fold, 48.0 + fold)
        else:
            _set(out, 44.0, 66.0, 116.0)
    loss = value_noise(seed + 35, 7.0 * s, 6.0 * t) + 0.7 * value_noise(seed + 36, 23.0 * s, 21.0 * t)
    if loss > 0.75:
        _set(out, 204.0, 192.0, 168.0)


@njit()
def _wood(s, t, seed, out):
    """The colour of a panelled door at `s`, `t` (m), into `out` (3,)."""
    panel_s, panel_t = (s % 0.35) - 0.175, (t % 0.54) - 0.27
    frame = abs(panel_s) > 0.125 or abs(panel_t) > 0.215
    ring = value_noise(seed + 37, 34.0 * s if not frame else 5.0 * s, 3.0 * t if not frame else 40.0 * t)
    tone = 1.0 + 0.28 * ring - (0.35 if 0.12 < abs(panel_s) < 0.13 or 0.21 < abs(panel_t) < 0.22 else 0.0)
    if abs(s - 0.0) < 0.006:
        tone = 0.35
    nail = (abs(panel_s) - 0.15) ** 2 + ((abs(panel_t) % 0.12) - 0.06) ** 2 < 0.00018
    if nail:
        _set(out, 52.0, 48.0, 46.0)
    else:
        _set(out, 122.0 * tone, 82.0 * tone, 50.0 * tone)
