"""A photograph in the radiometry of the block: colours of the ground that can be compared with those of other photographs."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from orthomill.tasks.colouring.balance.photo_radiometry import Radiometry, correction_terms, in_block
from orthomill.tasks.colouring.sampling.ground_sampling import Ground, Sampled, sample_into, sample_photo
from orthomill.tasks.colouring.sampling.photograph_colours import PhotoPixelsAt, most_bands
from orthomill.tasks.geometry.view import View


@dataclass(frozen=True)
class BalancedPhotograph:
    """A view, the part of its pixels that is at hand, and the balance of the block."""

    view: View
    part: PhotoPixelsAt
    balance: Radiometry

    def on(self, ground: Ground, factor: np.ndarray, feather: float, bands: int) -> Sampled:
        """Colours (`bands` of them) and weight on the ground, as from `sample_photo`; 0 to 255 is the range of the block."""
        found = Sampled.nothing(ground.z.shape, bands)
        self.fill(found, ground, factor, feather)
        return found

    def fill(self, found: Sampled, ground: Ground, factor: np.ndarray, feather: float) -> None:
        """As `on`, into arrays of zeros."""
        correction, scale = self.balance.of(self.view.name), 255.0 / self.balance.white
        if found.colour.shape[2] == self.part.pixels.shape[2] and not correction.curves:
            sample_into(found, self.view, self.part, ground, factor, feather, correction_terms(correction, scale))
            return
        sampled = sample_photo(self.view, self.part, ground, factor, feather)
        found.colour[:] = in_block(sampled.colour, sampled.r2, self.view.name, self.balance)
        found.weight[:], found.r2[:] = sampled.weight, sampled.r2


def bands_of(photos: Sequence[BalancedPhotograph]) -> int:
    """Channels of colours that all photographs fit in: see `most_bands`."""
    return most_bands(photo.part.pixels for photo in photos)
