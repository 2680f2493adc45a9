"""Masks in image files of their own, given to the photographs that they are named after."""

from collections import defaultdict

from orthomill.schemas.errors import PhotoError, some_of
from orthomill.schemas.photo import Header, Photo, PhotoRemark, PhotoRemarkCode
from orthomill.schemas.survey_files.photograph_masks import masked_photograph
from orthomill.tasks.imagery.upright import turned


def with_masks(photos: list[Photo], masks: tuple[Header, ...]) -> tuple[list[Photo], list[PhotoRemark]]:
    """The photographs with their masks, and remarks about these and about masks that belong to none.

    Raises PhotoError for masks that cannot be read or have another size than their photographs, and where a photograph has two.
    """
    if not masks:
        return photos, []
    by_name = defaultdict(list)
    for mask in masks:
        by_name[masked_photograph(mask.path)].append(mask)
    found = [_with_mask(photo, by_name.pop(masked_photograph(photo.path), [])) for photo in photos]
    served = tuple(photo.name for photo in found if photo.mask)
    idle = tuple(mask.path for left in by_name.values() for mask in left)
    remarks = [PhotoRemark(code=PhotoRemarkCode.MASK_FILES, photos=served)] if served else []
    return found, remarks + ([PhotoRemark(code=PhotoRemarkCode.IDLE_MASK, photos=idle)] if idle else [])


def _with_mask(photo: Photo, masks: list[Header]) -> Photo:
    if not masks:
        return photo
    if len(masks) > 1:
        raise PhotoError(f"{photo.path} has several masks: {some_of([mask.path for mask in masks])}; leave one of them.")
    (mask,) = masks
    if mask.unusable:
        raise PhotoError(f"The mask {mask.path} {mask.unusable}; save it as a grey image, or take it away.")
    size, upright = (mask.width, mask.height), (photo.width, photo.height)
    in_file = upright[::-1] if turned(photo.exif_orientation) else upright
    if size not in (in_file, upright):
        raise PhotoError(
            f"The mask {mask.path} has {size[0]} x {size[1]} px, and its photograph {photo.path} {in_file[0]} x {in_file[1]}; "
            "save it in the size of the photograph."
        )
    # Only a quarter turn shows in the size; else the mask is taken as a picture of the file, as Metashape and COLMAP write it.
    return photo.model_copy(update={"mask": mask.path, "mask_upright": size != in_file, "masked": True})
