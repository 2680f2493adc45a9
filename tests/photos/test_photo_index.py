"""What headers say: tags to numbers, names, cameras, positions, and every refusal with its sentence."""

import pytest

from orthomill.schemas.errors import PhotoError, WorkflowError
from orthomill.schemas.photo import Header, PhotoRemark, PhotoRemarkCode
from orthomill.schemas.project import NoPositions, PositionsFromExif, PositionsFromFile
from orthomill.schemas.survey_files.photograph_names import photo_stem
from orthomill.tasks.photos import exif
from orthomill.tasks.photos.index import Limits, index_photos, photo_from_header
from orthomill.tasks.photos.position_files.position_reading import read_positions
from orthomill.tasks.photos.report.photos_report import remark_sentence

DRONE = {
    "Make": "DJI",
    "Model": "FC300S",
    "FocalLength": "(3.61)",
    "FocalLengthIn35mmFilm": "20",
    "GPSLatitude": "(46) (50) (33.3855)",
    "GPSLatitudeRef": "N",
    "GPSLongitude": "(91) (59) (40.4156)",
    "GPSLongitudeRef": "W",
    "GPSAltitude": "(198.309)",
    "GPSAltitudeRef": "0x00",
    "DateTimeOriginal": "2016:06:23 16:31:59",
}
LIMITS = Limits(megapixels=50)
EXIF_POSITIONS = PositionsFromExif(kind="exif")


def header(name: str = "a.jpg", **changes) -> Header:
    facts = {"path": f"photos/{name}", "width": 4000, "height": 2250, "bands": 3, "dtype": "uint8", "tags": DRONE}
    return Header(**{**facts, **changes})


def photos_of(*arguments, **more):
    return index_photos(*arguments, **more).photos


def test_all_facts_of_a_drone_photograph_are_read():
    photos = photos_of((header("DJI_0018.JPG"),), "EPSG:26915", EXIF_POSITIONS, LIMITS)
    photo = photos["DJI_0018"]
    assert photo.longitude == pytest.approx(-(91 + 59 / 60 + 40.4156 / 3600))
    assert photo.position == pytest.approx((576663.10, 5188164.56, 198.309), abs=0.01)
    assert photo.position_sigma == (3.0, 3.0, 5.0)
    assert photo.pixel_um == pytest.approx(6.17e3 / 4000)
    assert photo.camera == "DJI FC300S 3.61 mm 4000 x 2250"
    assert photo.time == "2016-06-23T16:31:59"


def photos_turned(*sizes_and_flags):
    headers = [
        header(f"{i}.jpg", width=width, height=height, tags={**DRONE, "Orientation": str(flag)})
        for i, (width, height, flag) in enumerate(sizes_and_flags)
    ]
    return index_photos(tuple(headers), "EPSG:26915", EXIF_POSITIONS, LIMITS).photos


def test_photographs_turned_by_exif_keep_the_sensor_of_the_others():
    lying, held_upright, pixels_turned = photos_turned((4000, 2250, 1), (4000, 2250, 6), (2250, 4000, 8)).photos
    assert lying.camera == held_upright.camera == pixels_turned.camera
    assert [p.sensor_orientation for p in (lying, held_upright, pixels_turned)] == [1, 6, 1]
    assert (pixels_turned.width, pixels_turned.height) == (4000, 2250)


def test_without_others_the_file_is_how_the_sensor_saw_it():
    (photo,) = photos_turned((2250, 4000, 8)).photos
    assert photo.sensor_orientation == 8 and photo.camera.endswith("2250 x 4000")


def test_pixels_that_were_turned_without_a_flag_are_named():
    photos = photos_turned((4000, 2250, 1), (4000, 2250, 1), (2250, 4000, 1))
    (remark,) = photos.remarks
    assert remark == PhotoRemark(code=PhotoRemarkCode.ROTATED_WITHOUT_FLAG, photos=("2",))
    text = remark_sentence(remark)
    assert text.startswith("2: ") and "rotated the pixels" in text and "as the camera wrote them" in text
    assert len({photo.camera for photo in photos.photos}) == 2


def test_gdal_prefixed_tags_mean_the_same():
    prefixed = {f"EXIF_{name}": value for name, value in DRONE.items()}
    assert photo_from_header(header(tags=prefixed)) == photo_from_header(header())


@pytest.mark.parametrize(
    "tags",
    [
        {},
        {"GPSLatitude": "(0) (0) (0)", "GPSLongitude": "(0) (0) (0)"},
        {"GPSLatitude": "(nan)", "GPSLongitude": "(1)"},
        {"GPSLatitude": "(95)", "GPSLongitude": "(10)"},
        {"GPSLatitude": "(1) (2) (3) (4)", "GPSLongitude": "(10)"},
    ],
)
def test_broken_positions_count_as_none(tags):
    assert exif.longitude_latitude(tags) is None


def test_altitude_below_the_sea_and_southern_latitudes_are_negative():
    assert exif.altitude({"GPSAltitude": "(12.5)", "GPSAltitudeRef": "0x01"}) == -12.5
    south = {"GPSLatitude": "(33) (30) (0)", "GPSLatitudeRef": "S", "GPSLongitude": "(18)", "GPSLongitudeRef": "E"}
    assert exif.longitude_latitude(south) == (18.0, -33.5)


def test_the_pixel_of_a_reduced_photograph_is_larger():
    tags = {"Model": "unheard of", "FocalPlaneXResolution": "(5000)", "FocalPlaneResolutionUnit": "3", "PixelXDimension": "6000"}
    assert photo_from_header(header(tags=tags, width=6000, height=4000)).pixel_um == pytest.approx(2.0)
    assert photo_from_header(header(tags=tags, width=3000, height=2000)).pixel_um == pytest.approx(4.0)


def test_upright_sizes_follow_the_orientation_flag():
    photo = photo_from_header(header(tags={**DRONE, "Orientation": "6"}))
    assert (photo.width, photo.height, photo.exif_orientation) == (2250, 4000, 6)
    assert photo.camera == photo_from_header(header(tags=DRONE)).camera, "it is the same sensor"
    assert photo_from_header(header(tags={"Orientation": "99"})).exif_orientation == 1


def test_all_refusals_are_reported_together():
    headers = (header("a.jpg", width=40000), header("b.jpg", dtype="float32"), header("c.jpg", bands=2), header("d.jpg"))
    with pytest.raises(PhotoError) as error:
        photos_of(headers, "EPSG:26915", EXIF_POSITIONS, LIMITS)
    said = str(error.value)
    for part in ("photos/a.jpg has 90.0 megapixels", "photos/b.jpg has pixels of type float32", "photos/c.jpg has 2 bands"):
        assert part in said


@pytest.mark.parametrize(
    ("crs", "part"),
    [
        ("EPSG:4326", "degrees"),
        ("EPSG:4326+5773", "degrees"),
        ("EPSG:2263", "feet"),
        ("EPSG:99999", "not known"),
        ("nonsense", "not known"),
    ],
)
def test_only_metres_on_a_plane_are_accepted(crs, part):
    with pytest.raises(WorkflowError, match=part):
        photos_of((header(),), crs, EXIF_POSITIONS, LIMITS)


def test_a_vertical_part_of_the_crs_changes_nothing_in_plan():
    both = [photos_of((header(),), crs, EXIF_POSITIONS, LIMITS).photos[0].position for crs in ("EPSG:26915", "EPSG:26915+5703")]
    assert both[0] == both[1]


def test_the_system_of_another_country_is_refused():
    with pytest.raises(WorkflowError, match=r"Greek Grid.*latitudes 34\.88 to 41\.75.*longitude -91\.99"):
        photos_of((header(),), "EPSG:2100", EXIF_POSITIONS, LIMITS)


def test_positions_from_a_file_name_photographs_with_or_without_extension():
    text = "photo, x, y, z, sigma_x, sigma_y, sigma_z\na.jpg, 400001, 4400002, 3, 0.1, 0.1, 0.2\nother, 4, 5, 6, 1, 1, 1\n"
    photos = photos_of(
        (header("a.jpg", tags={}), header("b.jpg", tags={})),
        "EPSG:2100",
        PositionsFromFile(kind="file", path="p.csv"),
        LIMITS,
        text,
    )
    assert photos["a"].position == (400001.0, 4400002.0, 3.0) and photos["a"].position_sigma == (0.1, 0.1, 0.2)
    assert photos["b"].position is None
    assert photos_of((header(),), "EPSG:2100", NoPositions(kind="none"), LIMITS)["a"].position is None


@pytest.mark.parametrize(
    ("text", "part"),
    [
        ("photo,x,y\n", "no column z"),
        ("photo,x,y,z,sigma_x,sigma_y,sigma_z\na,1,2,three,1,1,1\n", "Line 2"),
        ("photo,x,y,z,sigma_x,sigma_y,sigma_z\na,1,2,3,1,1,1\na.jpg,1,2,3,1,1,1\n", "Line 3"),
        ("", "is empty"),
        ("photo,x,y,z,sigma_x,sigma_y,sigma_z\na,1,2,3,1,0,1\n", "zero or less"),
        ("photo,x,y,z,sigma_x,sigma_y,sigma_z\na,1,2\n", "Line 2"),
    ],
)
def test_a_wrong_positions_file_names_its_line(text, part):
    with pytest.raises(WorkflowError, match=part):
        read_positions(text)


def test_a_positions_file_may_hold_attitudes():
    text = "photo,x,y,z,sigma_x,sigma_y,sigma_z,omega,phi,kappa\na,1,2,3,1,1,1,10,20,30\nb,1,2,3,1,1,1,,,\n"
    first, second = read_positions(text).positions
    assert first.omega_phi_kappa == (10.0, 20.0, 30.0) and second.omega_phi_kappa is None
    with pytest.raises(WorkflowError, match="Line 2 of the positions file gives 10, steep, 30 for omega, phi, kappa"):
        read_positions(text.replace("20", "steep"))


def test_of_two_files_with_one_name_the_second_is_set_aside():
    photos = photos_of((header("d.jpg"), header("d.tif"), header("e.jpg")), "EPSG:26915", EXIF_POSITIONS, LIMITS)
    assert photos.names == ("d", "e") and photos["d"].path == "photos/d.jpg"
    assert photos.remarks[0] == PhotoRemark(code=PhotoRemarkCode.DUPLICATE_NAME, photos=("photos/d.jpg", "photos/d.tif"))
    assert remark_sentence(photos.remarks[0]).startswith("photos/d.jpg and photos/d.tif have the same name d,")


def test_a_folder_of_copies_is_told_in_one_sentence():
    files = ("d.jpg", "d.tif", "e.jpg", "e.tif", "f.jpg", "f.tif", "g.jpg", "g.tif")
    (remark,) = photos_of(tuple(map(header, files)), "EPSG:26915", EXIF_POSITIONS, LIMITS).remarks
    assert remark_sentence(remark) == (
        "4 files have the names of others, by which photographs are identified, and were set aside: photos/d.tif, photos/e.tif, "
        "photos/f.tif and 1 more. Rename those that are other photographs."
    )


def test_files_of_one_name_in_different_folders_are_different_photographs():
    files = ("d.jpg", "100MEDIA/a.jpg", "101MEDIA/a.jpg", "A/1/b.jpg", "B/1/b.jpg", "A/c.jpg")
    photos = photos_of(tuple(map(header, files)), "EPSG:26915", EXIF_POSITIONS, LIMITS)
    assert photos.names == ("d", "100MEDIA_a", "101MEDIA_a", "A_1_b", "B_1_b", "c") and not photos.remarks


def test_a_gps_tag_of_another_place_is_left_out_and_named():
    here = [header(f"p{i}.jpg") for i in range(5)]
    elsewhere = header(
        "far.jpg", tags={**DRONE, "GPSLatitude": "(39) (0) (0)", "GPSLongitude": "(22) (0) (0)", "GPSLongitudeRef": "E"}
    )
    photos = photos_of((*here, elsewhere), "EPSG:26915", EXIF_POSITIONS, LIMITS)
    assert photos["far"].position is None and photos["p0"].position is not None
    (remark,) = photos.remarks
    assert remark.code is PhotoRemarkCode.STRAY_POSITION and remark.photos == ("far",)
    assert remark.distance_km == pytest.approx(9200, rel=0.2) and len(photos.names) == 6
    assert remark_sentence(remark).startswith(f"The GPS tag of far lies {remark.distance_km:.0f} km from")


def test_in_a_block_of_three_a_tag_ten_kilometres_off_is_left_out():
    off = {**DRONE, "GPSLatitude": "(46) (56) (0)"}
    headers = (header("a.jpg"), header("b.jpg"), header("c.jpg", tags=off))
    photos = photos_of(headers, "EPSG:26915", EXIF_POSITIONS, LIMITS)
    assert [photo.position is None for photo in photos.photos] == [False, False, True]
    assert photos.remarks[0].code is PhotoRemarkCode.STRAY_POSITION


def test_a_strip_of_three_with_wide_bases_has_no_strays():
    headers = [header(f"p{i}.jpg", tags={**DRONE, "GPSLatitude": f"(46) (5{i}) (0)"}) for i in range(3)]
    assert photos_of(tuple(headers), "EPSG:26915", EXIF_POSITIONS, LIMITS).remarks == ()


@pytest.mark.parametrize("altitude", ["(0)", "(4e+09)"])
def test_an_impossible_altitude_is_no_position_and_is_named(altitude):
    headers = (header("a.jpg"), header("b.jpg", tags={**DRONE, "GPSAltitude": altitude}))
    photos = photos_of(headers, "EPSG:26915", EXIF_POSITIONS, LIMITS)
    assert photos["a"].position is not None and photos["b"].position is None
    assert photos.remarks == (PhotoRemark(code=PhotoRemarkCode.NO_ALTITUDE, photos=("b",)),)


def test_damaged_tags_are_named_and_the_photograph_is_used():
    photos = photos_of((header("a.jpg"), header("b.jpg", tags={}, damaged_tags=True)), "EPSG:26915", EXIF_POSITIONS, LIMITS)
    assert photos.names == ("a", "b") and photos.remarks == (PhotoRemark(code=PhotoRemarkCode.DAMAGED_TAGS, photos=("b",)),)


def test_of_two_camps_of_positions_none_is_a_stray():
    elsewhere = {**DRONE, "GPSLatitude": "(47) (50) (0)"}
    headers = [header(f"p{i}.jpg", tags=DRONE if i % 2 else elsewhere) for i in range(4)]
    photos = photos_of(tuple(headers), "EPSG:26915", EXIF_POSITIONS, LIMITS)
    assert all(photo.position is not None for photo in photos.photos)
    (apart,) = photos.remarks
    assert apart.code is PhotoRemarkCode.POSITIONS_FAR_APART and apart.photos == ("p0", "p2")
    assert apart.distance_km == pytest.approx(110.0, abs=1.5)


def test_two_sites_in_a_folder_are_told_and_strays_of_one_place_in_one_sentence():
    def at(name, minute):
        return header(name, tags={**DRONE, "GPSLatitude": f"(46) (50) ({minute})"})

    here, there = [at(f"a{i}.jpg", 0.3 * i) for i in range(6)], [at(f"b{i}.jpg", 120 + 0.3 * i) for i in range(6)]
    (apart,) = photos_of((*here, *there), "EPSG:26915", EXIF_POSITIONS, LIMITS).remarks
    assert apart.code is PhotoRemarkCode.POSITIONS_FAR_APART and len(apart.photos) == 6
    assert "lie 4 km or more from all others, too far for one block" in remark_sentence(apart)
    (strays,) = photos_of((*here, *there[:2]), "EPSG:26915", EXIF_POSITIONS, LIMITS).remarks
    assert strays.code is PhotoRemarkCode.STRAY_POSITION and "The GPS tags of 2 photographs (b0, b1)" in remark_sentence(strays)


def test_a_photograph_from_the_ground_is_told_and_a_low_flight_is_not():
    def flown(*heights):
        headers = [header(f"p{i}.jpg", tags={**DRONE, "drone-dji:RelativeAltitude": f"{h:+.2f}"}) for i, h in enumerate(heights)]
        remarks = photos_of(tuple(headers), "EPSG:26915", EXIF_POSITIONS, LIMITS).remarks
        return [remark.photos for remark in remarks if remark.code is PhotoRemarkCode.ON_THE_GROUND]

    assert flown(0.2, 40.1, 40.0, 40.2) == [("p0",)]
    assert not flown(0.2, 8.0, 8.0, 8.0) and not flown(0.2, 0.1, 40.0, 40.0)


def test_files_that_were_cut_and_tags_without_a_hemisphere_are_told():
    size = {"PixelXDimension": "4000", "PixelYDimension": "2250"}
    cut = header("cut.jpg", width=800, height=500, tags={**DRONE, **size})
    turned = header("turned.jpg", width=450, height=800, tags={**DRONE, **size})
    open_ = header("open.jpg", tags={name: value for name, value in DRONE.items() if name != "GPSLongitudeRef"})
    photos = photos_of((cut, turned, open_), "EPSG:26915", NoPositions(kind="none"), LIMITS)
    said = {remark.code: remark for remark in photos.remarks}
    assert said[PhotoRemarkCode.CUT].photos == ("cut",) and "of 4000 x 2250 px before" in remark_sentence(said[PhotoRemarkCode.CUT])
    assert said[PhotoRemarkCode.NO_HEMISPHERE].photos == ("open",)
    assert "do not say whether they are east or west: east" in remark_sentence(said[PhotoRemarkCode.NO_HEMISPHERE])


def test_photographs_of_one_large_block_are_not_far_apart():
    rows = "".join(f"p{i},{500000 + 40000 * i},{4400000},9000,1,1,1\n" for i in range(20))
    text = "photo,x,y,z,sigma_x,sigma_y,sigma_z\n" + rows
    headers = tuple(header(f"p{i}.jpg", tags={}) for i in range(20))
    from_file = PositionsFromFile(kind="file", path="p.csv")
    assert photos_of(headers, "EPSG:2100", from_file, LIMITS, text).remarks == ()
    (apart,) = photos_of(headers, "EPSG:2100", from_file, LIMITS, text.replace("p0,5", "p0,1")).remarks
    assert apart.photos == ("p0",)


def test_lines_of_other_photographs_in_the_positions_file_are_a_remark_unless_all_are():
    text = "photo,x,y,z,sigma_x,sigma_y,sigma_z\n{},400001,4400002,3,1,1,1\nq,1,2,3,1,1,1\n"
    from_file = PositionsFromFile(kind="file", path="p.csv")
    (remark,) = photos_of((header("p.jpg", tags={}),), "EPSG:2100", from_file, LIMITS, text.format("p.JPG")).remarks
    assert remark.code is PhotoRemarkCode.POSITION_WITHOUT_PHOTOGRAPH and remark.photos == ("q",)
    with pytest.raises(WorkflowError, match="names none of the photographs: it has r, q, the project has p;"):
        photos_of((header("p.jpg", tags={}),), "EPSG:2100", from_file, LIMITS, text.format("r"))


def test_neighbours_across_the_date_line_are_no_strays():
    tags = [{**DRONE, "GPSLongitude": f"(179.99{i})", "GPSLongitudeRef": "EW"[i % 2], "GPSLatitude": "(-17)"} for i in range(6)]
    headers = tuple(header(f"p{i}.jpg", tags=tag) for i, tag in enumerate(tags))
    assert photos_of(headers, "EPSG:3460", EXIF_POSITIONS, LIMITS).remarks == ()


@pytest.mark.parametrize(
    ("name", "stem"), [("a.jpg", "a"), (" a.TIFF ", "a"), ("flight.2", "flight.2"), ("flight.2.png", "flight.2"), (None, "")]
)
def test_only_extensions_of_images_are_cut_off_names(name, stem):
    assert photo_stem(name) == stem


def test_a_byte_order_mark_in_front_of_the_positions_is_skipped():
    text = "\ufeffphoto,x,y,z,sigma_x,sigma_y,sigma_z\na,1,2,3,1,1,1\n"
    assert read_positions(text).positions[0].xyz == (1.0, 2.0, 3.0)


def test_the_sigma_of_gps_is_that_of_the_setting():
    positions = PositionsFromExif(kind="exif", sigma_plan=1.5, sigma_height=9.0)
    (photo,) = photos_of((header(),), "EPSG:26915", positions, LIMITS).photos
    assert photo.position_sigma == (1.5, 1.5, 9.0)


def test_a_small_picture_is_set_aside_with_its_size():
    photos = photos_of((header("b.jpg"), header("c.jpg"), header(width=60)), "EPSG:26915", EXIF_POSITIONS, LIMITS)
    said = remark_sentence(photos.remarks[0])
    assert photos.names == ("b", "c") and "a.jpg has only 60 x 2250 pixels, too few for a photograph (at least 64 a side" in said
    with pytest.raises(PhotoError, match=r"No file is a photograph that can be used\. 1 file set aside: photos/a.jpg has only"):
        photos_of((header(width=60),), "EPSG:26915", EXIF_POSITIONS, LIMITS)
    with pytest.raises(
        PhotoError, match=r"photos/b.jpg is the only photograph that can be used; .* 1 file set aside: photos/a.jpg has"
    ):
        photos_of((header("b.jpg"), header(width=60)), "EPSG:26915", EXIF_POSITIONS, LIMITS)


@pytest.mark.parametrize(
    ("size", "flag", "original"),
    [
        ((6000, 4000), "1", None),
        ((1500, 1000), "1", (6000, 4000)),
        ((1500, 1000), "6", (4000, 6000)),
        ((1500, 1001), "1", (6000, 4000)),
        ((1500, 1200), "1", None),
        ((6100, 4067), "1", None),
    ],
    ids=["as written", "reduced", "turned", "rounded", "cut", "enlarged"],
)
def test_the_size_before_a_reduction_is_that_of_the_tags(size, flag, original):
    tags = {"EXIF_PixelXDimension": "6000", "EXIF_PixelYDimension": "4000", "EXIF_Orientation": flag}
    assert photo_from_header(header(tags=tags, width=size[0], height=size[1])).original == original
