"""The figure of a method: its heights as a shaded map, and how far they depart from what is known, scene beside scene."""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.colors import LightSource

_LIGHT = LightSource(azdeg=315, altdeg=45)


def draw(path: Path, title: str, panels: list[tuple[str, np.ndarray, np.ndarray, float, float]]) -> None:
    """Write a picture. panels: scene, heights (rows, cols) m, departures (rows, cols) m, NaN where nothing was measured, side of a
    cell m, and the departure at which colours end, m."""
    figure, axes = plt.subplots(2, len(panels), figsize=(3.2 * len(panels), 6.2), squeeze=False)
    for column, (scene, heights, departures, cell, limit) in enumerate(panels):
        upper, lower = axes[:, column]
        known = np.where(np.isfinite(heights), heights, np.nanmedian(heights))
        upper.imshow(_LIGHT.hillshade(known, vert_exag=1, dx=cell, dy=cell), cmap="gray", vmin=0, vmax=1)
        upper.set_title(scene, fontsize=9)
        shown = lower.imshow(departures, cmap="RdBu", vmin=-limit, vmax=limit)
        lower.set_facecolor("#404040")
        ticks = [-limit, -limit / 2, 0.0, limit / 2, limit]
        bar = figure.colorbar(shown, ax=lower, orientation="horizontal", fraction=0.05, pad=0.03, ticks=ticks)
        bar.ax.tick_params(labelsize=7)
        bar.set_label("measured minus known, m", fontsize=7)
        for axis in (upper, lower):
            axis.set_xticks([])
            axis.set_yticks([])
    figure.suptitle(title, fontsize=10)
    figure.tight_layout()
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=75)
    plt.close(figure)
