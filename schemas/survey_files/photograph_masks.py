"""Which image file is the mask of which photograph, by the names that programs give them.

Metashape and OpenDroneMap write `IMG_1_mask.png`, COLMAP `IMG_1.JPG.png`; folders of masks alone mostly have `IMG_1.png`. In all of
them black is what is not to be used.
"""

import re
from pathlib import PurePath

_ENDING = re.compile(r"[._-]mask$")
_DOUBLED = re.compile(r"\.(jpe?g|tiff?|png|hei[cf]|dng)$")


def is_named_mask(name: str) -> bool:
    """Whether the name of a file says that it is a mask."""
    return _ENDING.search(PurePath(name).stem.lower()) is not None


def masked_photograph(name: str) -> str:
    """The name, without its ending and in small letters, of the photograph that a mask of this name belongs to."""
    return _DOUBLED.sub("", _ENDING.sub("", PurePath(name).stem.lower()))
