"""Photographs that do not belong to a block, whatever they show: files that hold none, damaged ones, panoramas, and the other bands
of a multispectral camera."""

from pathlib import PurePath

from orthomill.schemas.errors import PhotoError, some_of
from orthomill.schemas.photo import Header, PhotoRemark, PhotoRemarkCode, Soundness
from orthomill.tasks.photos.sorting.bands import COLOUR, OneBlock, one_block

SET_ASIDE = (
    PhotoRemarkCode.OTHER_BANDS,
    PhotoRemarkCode.THERMAL,
    PhotoRemarkCode.PANORAMA,
    PhotoRemarkCode.UNUSABLE_FILE,
    PhotoRemarkCode.DAMAGED_PICTURE,
)
"""the remarks that are made here"""


def set_aside_sentence(remark: PhotoRemark) -> str:
    """What one of these remarks says to a person."""
    number = f"{len(remark.photos)} file{'s' if len(remark.photos) > 1 else ''}"
    if remark.code is PhotoRemarkCode.PANORAMA:
        return (
            f"{number} set aside: {some_of(remark.photos, 3)}, {'panoramas' if len(remark.photos) > 1 else 'a panorama'} "
            f"({', '.join(remark.words)}), which no frame camera took in one exposure."
        )
    if remark.code is PhotoRemarkCode.UNUSABLE_FILE:
        return f"{number} set aside: {some_of([' '.join(pair) for pair in zip(remark.photos, remark.words, strict=True)], 5)}."
    if remark.code is PhotoRemarkCode.DAMAGED_PICTURE:
        faults = [f"{path} is {fault}" for path, fault in zip(remark.photos, remark.words, strict=True)]
        return f"{number} set aside: {some_of(faults, 3)}. Copy {'them' if len(faults) > 1 else 'it'} again from the camera."
    if remark.code is PhotoRemarkCode.THERMAL:
        return "The photographs are thermal: the colours of their pictures are used, not the temperatures."
    *others, best = remark.words
    return (
        f"{number} of other bands set aside ({', '.join(others)}; {some_of(remark.photos, 3)}): the block is made of the "
        f"{'colour photographs' if best == COLOUR else f'band {best}'}. Choose another with 'band' or a list of photographs."
    )


def without_others(headers: tuple[Header, ...], band: str | None = None) -> OneBlock:
    """The photographs of the block, and a remark for each kind that is set aside.

    Raises PhotoError where all are panoramas, or none is of the `band` that is asked for.
    """
    panoramas = {header.path: projection for header in headers if (projection := _projection(header))}
    if headers and len(panoramas) == len(headers):
        raise PhotoError(
            f"{some_of(list(panoramas), 3)}: all photographs are panoramas ({next(iter(panoramas.values()))}), which no frame "
            "camera took in one exposure; give the single photographs that they were made of."
        )
    block = one_block(tuple(header for header in headers if header.path not in panoramas), band)
    if not panoramas:
        return block
    words = tuple(sorted(set(panoramas.values())))
    return OneBlock(
        block.headers, (PhotoRemark(code=PhotoRemarkCode.PANORAMA, photos=tuple(panoramas), words=words), *block.remarks)
    )


def without_unusable(headers: tuple[Header, ...], smallest_side: int) -> OneBlock:
    """The photographs that can be used: whole files, of `smallest_side` px at least. Raises PhotoError where there are none."""
    faults = {header.path: fault for header in headers if (fault := header.unusable or _too_small(header, smallest_side))}
    if not faults:
        return OneBlock(headers, ())
    aside = PhotoRemark(code=PhotoRemarkCode.UNUSABLE_FILE, photos=tuple(faults), words=tuple(faults.values()))
    left = [header.path for header in headers if header.path not in faults]
    if len(left) == 1:
        raise PhotoError(
            f"{left[0]} is the only photograph that can be used; surfaces are measured from two or more that overlap. "
            f"{set_aside_sentence(aside)}"
        )
    if len(faults) == len(headers):
        raise PhotoError(f"No file is a photograph that can be used. {set_aside_sentence(aside)}")
    return OneBlock(tuple(header for header in headers if header.path not in faults), (aside,))


def _too_small(header: Header, smallest_side: int) -> str:
    size = f"{header.width} x {header.height} pixels"
    too_small = min(header.width, header.height) < smallest_side
    return f"has only {size}, too few for a photograph (at least {smallest_side} a side are needed)" if too_small else ""


def without_damaged(headers: tuple[Header, ...], pictures: tuple[Soundness, ...]) -> OneBlock:
    """The photographs whose pictures are not damaged. Raises PhotoError where all are."""
    known = {header.path for header in headers}
    faults = {picture.path: picture.fault for picture in pictures if picture.fault and picture.path in known}
    if not faults:
        return OneBlock(headers, ())
    aside = PhotoRemark(code=PhotoRemarkCode.DAMAGED_PICTURE, photos=tuple(faults), words=tuple(faults.values()))
    sound = tuple(header for header in headers if header.path not in faults)
    if not sound:
        raise PhotoError(set_aside_sentence(aside))
    return OneBlock(sound, (aside,))


def _projection(header: Header) -> str | None:
    """The projection of a panorama by its tags, or by a size of two to one under a name that says so."""
    stated = next((value for name, value in header.tags.items() if name.rpartition(":")[2] == "ProjectionType" and value), "")
    if stated:
        return stated.lower()
    named = "pano" in PurePath(header.path).stem.lower()
    return "equirectangular" if named and header.width == 2 * header.height else None
