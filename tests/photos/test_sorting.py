"""Which photographs of a folder make a block: colour before bands, green before others, no panoramas, thermal pictures last."""

import pytest

from orthomill.schemas.errors import PhotoError
from orthomill.schemas.photo import Header, PhotoRemarkCode
from orthomill.tasks.photos.sorting.bands import bands_of
from orthomill.tasks.photos.sorting.set_aside import set_aside_sentence, without_others


def colour(path: str, **tags: str) -> Header:
    return Header(path=path, width=400, height=300, bands=3, dtype="uint8", tags=tags)


def grey(path: str, name: str = "", wavelength: str = "") -> Header:
    stated = {"Camera:BandName": name, "Camera:CentralWavelength": wavelength}
    tags = {key: value for key, value in stated.items() if value}
    return Header(path=path, width=200, height=150, bands=1, dtype="uint16", tags=tags)


def used(*headers: Header) -> tuple[str, ...]:
    return tuple(header.path for header in without_others(headers).headers)


BANDS = tuple(
    grey(f"{number}_{name}.tif", name, wavelength)
    for number in range(3)
    for name, wavelength in (("Blue", "475"), ("Green", "560"), ("Red", "668"), ("NIR", "840"))
)


def test_colour_photographs_make_the_block_beside_bands():
    photographs = tuple(colour(f"{number}.jpg") for number in range(3))
    assert used(*photographs, *BANDS) == ("0.jpg", "1.jpg", "2.jpg")
    (remark,) = without_others((*photographs, *BANDS)).remarks
    assert remark.words == ("Blue", "Green", "NIR", "Red", "colour") and len(remark.photos) == 12
    assert "12 files of other bands set aside (Blue, Green, NIR, Red; " in set_aside_sentence(remark)
    assert "the block is made of the colour photographs" in set_aside_sentence(remark)


def test_without_colour_the_band_nearest_to_green_makes_the_block():
    assert used(*BANDS) == ("0_Green.tif", "1_Green.tif", "2_Green.tif")
    assert used(*(band for band in BANDS if "Green" not in band.path)) == ("0_Blue.tif", "1_Blue.tif", "2_Blue.tif")
    assert used(*BANDS, grey("0_p.tif", "Panchro"), grey("1_p.tif", "Panchro")) == ("0_p.tif", "1_p.tif")
    assert used(*BANDS, colour("stray.jpg")) == ("0_Green.tif", "1_Green.tif", "2_Green.tif"), "one stray is no block"


def test_a_band_that_is_asked_for_makes_the_block():
    mixed = (*(colour(f"{number}.jpg") for number in range(3)), *BANDS)
    assert [header.path for header in without_others(mixed, "nir").headers] == ["0_NIR.tif", "1_NIR.tif", "2_NIR.tif"]
    assert [header.path for header in without_others((*mixed[:1], *BANDS), "colour").headers] == ["0.jpg"]
    with pytest.raises(PhotoError, match=r"of the band 'Grren' \(photographs > band\); there are Blue, Green, NIR, Red, colour\."):
        without_others(mixed, "Grren")


def test_one_band_that_was_chosen_stays():
    chosen = tuple(band for band in BANDS if "NIR" in band.path)
    assert without_others(chosen) == (chosen, ())


def test_bands_without_tags_are_told_apart_by_the_endings_of_names():
    names = [f"DJI_000{number}_MS_{band}.TIF" for number in (1, 2) for band in ("G", "R", "RE", "NIR")]
    assert bands_of(tuple(map(grey, names)))[:4] == ("Green", "Red", "Red edge", "Near infrared")
    assert used(*map(grey, names), colour("DJI_0001_D.JPG"), colour("DJI_0002_D.JPG")) == ("DJI_0001_D.JPG", "DJI_0002_D.JPG")
    parrot = [f"IMG_{number}_{band}.TIF" for number in (1, 2) for band in ("GRE", "RED", "REG", "NIR")]
    assert used(*map(grey, parrot)) == ("IMG_1_GRE.TIF", "IMG_2_GRE.TIF")


def test_ordinary_grey_photographs_are_no_bands():
    scans = tuple(grey(f"strip_{number}.tif") for number in range(4))
    assert used(*scans) == tuple(scan.path for scan in scans)
    assert bands_of((colour("a_R.jpg"), colour("a_G.jpg"))) == (None, None)


def test_thermal_pictures_are_last_and_said():
    infrared = {"drone-dji:ImageSource": "InfraredCamera"}
    thermal = tuple(colour(f"DJI_{number}_T.JPG", **infrared) for number in range(2))
    assert used(*thermal, colour("DJI_0_V.JPG"), colour("DJI_1_V.JPG")) == ("DJI_0_V.JPG", "DJI_1_V.JPG")
    block = without_others(thermal)
    assert block.headers == thermal and block.remarks[0].code is PhotoRemarkCode.THERMAL


def test_panoramas_are_set_aside_and_a_folder_of_them_is_refused():
    panorama = colour("pano.jpg", **{"GPano:ProjectionType": "equirectangular"})
    block = without_others((colour("a.jpg"), panorama))
    assert [header.path for header in block.headers] == ["a.jpg"]
    assert set_aside_sentence(block.remarks[0]).startswith(
        "1 file set aside: pano.jpg, a panorama (equirectangular), which no frame"
    )
    with pytest.raises(PhotoError, match=r"pano\.jpg: all photographs are panoramas"):
        without_others((panorama,))
    wide = Header(path="DJI_PANO_1.JPG", width=8000, height=4000, bands=3, dtype="uint8")
    assert used(wide, colour("a.jpg")) == ("a.jpg",)
