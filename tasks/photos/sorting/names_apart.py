"""Names by which photographs are identified: those of their files, with the folder before them where several files have the same.

Cameras count to 9999 and begin anew in the next folder of the card: `100MEDIA/DJI_0001.JPG` and `101MEDIA/DJI_0001.JPG` are two
photographs.
"""

from collections import Counter
from pathlib import PurePosixPath

from orthomill.schemas.photo import Photo

_MOST_FOLDERS = 8


def named_apart(photos: list[Photo]) -> list[Photo]:
    """Photographs whose names tell them apart, as far as they lie in different folders."""
    names = [photo.name for photo in photos]
    parents = [PurePosixPath(photo.path).parent for photo in photos]
    for _ in range(_MOST_FOLDERS):
        # Two files of one name in one folder (JPEG and TIFF) remain one name: which of them is meant is for the user to say.
        places = Counter(name for name, _ in set(zip(names, parents, strict=True)))
        if max(places.values(), default=1) < 2:
            break
        names = [_within(name, folder) if places[name] > 1 else name for name, folder in zip(names, parents, strict=True)]
        parents = [folder.parent for folder in parents]
    apart = zip(photos, names, strict=True)
    return [photo if photo.name == name else photo.model_copy(update={"name": name}) for photo, name in apart]


def _within(name: str, folder: PurePosixPath) -> str:
    return f"{folder.name}_{name}" if folder.name else name
