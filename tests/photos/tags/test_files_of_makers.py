"""Files with the tags that the cameras of each maker write, read from disk: what becomes of them, and of their traps.

The values are those of public files where these were at hand (DJI, Parrot, senseFly, Apple), and those of the makers' manuals for
the others. A photograph is small here, and its size in the tags that of the camera where it matters.
"""

import struct
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from orthomill.pipeline.storage.image_files import read_header
from orthomill.schemas.photo import Header, Photo
from orthomill.tasks.photos.index import photo_from_header
from orthomill.tasks.photos.sorting.bands import THERMAL, bands_of
from orthomill.tasks.photos.tags.fixes import position_sigma
from orthomill.tasks.photos.tags.times import by_utc

NAMESPACES = {
    "drone-dji": "http://www.dji.com/drone-dji/1.0/",
    "Camera": "http://pix4d.com/camera/1.0",
    "sensefly": "http://sensefly.com/Camera/1.0/",
    "drone-skydio": "https://www.skydio.com/drone-skydio/1.0/",
    "drone-autel": "http://www.autelrobotics.com/drone-autel/1.0/",
    "drone-parrot": "http://www.parrot.com/drone-parrot/1.0/",
    "drone-yuneec": "http://www.yuneec.com/drone-yuneec/1.0/",
}
_EXIF, _GPS = 0x8769, 0x8825
TURIN = {1: "N", 2: (45.0, 1.0, 54.0876), 3: "E", 4: (7.0, 37.0, 26.4)}
"""GPS tags of a place at 45.03169, 7.624"""


def xmp(prefix: str, tags: dict[str, str | list[str]]) -> bytes:
    """A packet with plain tags as attributes and lists as elements, as the makers write them."""
    plain = " ".join(f'{prefix}:{name}="{value}"' for name, value in tags.items() if isinstance(value, str))
    lists = "".join(
        f"<{prefix}:{name}><rdf:Seq>{''.join(f'<rdf:li>{one}</rdf:li>' for one in value)}</rdf:Seq></{prefix}:{name}>"
        for name, value in tags.items()
        if not isinstance(value, str)
    )
    return (
        '<?xpacket begin="\ufeff" id="W5M0MpCehiHzreSzNTczkc9d"?><x:xmpmeta xmlns:x="adobe:ns:meta/">'
        '<rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#">'
        f'<rdf:Description rdf:about="" xmlns:{prefix}="{NAMESPACES[prefix]}" {plain}>{lists}</rdf:Description>'
        '</rdf:RDF></x:xmpmeta><?xpacket end="w"?>'
    ).encode()


def note(**angles: float) -> bytes:
    """The notes of DJI's drones before XMP: entries of four bytes, whose values stand in them."""
    numbers = {"Pitch": 9, "Yaw": 10, "Roll": 11}
    entries = [struct.pack("<HHI4s", 1, 2, 4, b"DJI\0")]
    entries += [struct.pack("<HHIf", numbers[name], 11, 1, angle) for name, angle in angles.items()]
    return struct.pack("<H", len(entries)) + b"".join(entries) + struct.pack("<I", 0)


def read(
    folder: Path,
    model: str,
    gps: dict | None = None,
    exif: dict | None = None,
    tags: tuple[str, dict] | None = None,
    size: tuple[int, int] = (1600, 1300),
    suffix: str = "jpg",
) -> tuple[Photo, Header]:
    make, _, name = model.partition(" ")
    image = Image.fromarray(np.zeros((size[1] // 20, size[0] // 20, 3), np.uint8))
    found = image.getexif()
    found[0x010F], found[0x0110] = make, name
    found.get_ifd(_EXIF).update({0xA002: size[0], 0xA003: size[1], **(exif or {})})
    if gps:
        found.get_ifd(_GPS).update(gps)
    packet = {"xmp": xmp(*tags)} if tags and suffix == "jpg" else {}
    if tags and suffix == "tif":
        found[0x02BC] = xmp(*tags)
    path = folder / f"photo.{suffix}"
    image.save(path, exif=found, **packet)
    header = read_header(path)
    return photo_from_header(header), header


DEWARP = "1973.0899658,1955.6500244,-19.0419922,-11.4249878,-0.4227500,0.3691010,0.0040638,0.0040638,-0.2643060"
RTK = {"RtkFlag": "50", "RtkStdLon": "0.01106", "RtkStdLat": "0.01449", "RtkStdHgt": "0.0211"}
GIMBAL = {"GimbalYawDegree": "+84.10", "GimbalPitchDegree": "-89.90", "GimbalRollDegree": "+0.00"}


def test_phantom_4_multispectral_rtk(tmp_path):
    tags = {**RTK, **GIMBAL, "AbsoluteAltitude": "+349.54", "RelativeAltitude": "+44.46", "DewarpFlag": "0"}
    tags |= {"DewarpData": f"2022-03-02;{DEWARP}", "CalibratedFocalLength": "1913.333374", "CalibratedOpticalCenterX": "800.0"}
    photo, header = read(tmp_path, "DJI FC6360", {**TURIN, 5: b"\0", 6: 349.542}, {0x920A: 5.74}, ("drone-dji", tags))
    assert (photo.longitude, photo.latitude) == pytest.approx((7.624, 45.031691), abs=1e-6)
    assert (photo.altitude, photo.height_kind, photo.relative_height) == (pytest.approx(349.542), "ellipsoidal", 44.46)
    assert photo.fix == "fixed" and position_sigma(header.tags) == pytest.approx((0.01106, 0.01449, 0.0211))
    assert photo.attitude_of == "gimbal" and photo.attitude[2] == pytest.approx(-84.1, abs=0.2)
    # The picture was reduced to a twentieth; its principal point lies left of and above the middle, by the maker's own matrix.
    camera = photo.factory
    assert camera.kind == "calibrated" and 20 * camera.c == pytest.approx(1955.65, rel=1e-6)
    assert (20 * camera.x0, 20 * camera.y0) == pytest.approx((-19.042, 11.425), abs=1e-3)
    assert (camera.k1, camera.k2, camera.k3, camera.p1) == (-0.42275, 0.369101, -0.264306, 0.0040638)


def test_phantom_4_rtk_with_its_misspelt_longitude_in_a_tiff(tmp_path):
    tags = {**RTK, **GIMBAL, "GpsLatitude": "+43.36511377", "GpsLongtitude": "+141.81345593", "AbsoluteAltitude": "+186.51"}
    tags |= {"RelativeAltitude": "+99.88", "CalibratedOpticalCenterX": "2736.0", "CalibratedFocalLength": "3666.67"}
    tags |= {"DewarpData": " 2018-03-13;3659.78,3653.17,-7.71,45.9,-0.2694,0.1156,-0.00008,-0.0003,-0.03"}
    photo, _ = read(tmp_path, "DJI FC6310R", None, {0x920A: 8.8}, ("drone-dji", tags), (5472, 3648), "tif")
    assert (photo.longitude, photo.latitude, photo.altitude) == (141.81345593, 43.36511377, 186.51)
    assert photo.height_kind == "ellipsoidal" and photo.factory.kind == "calibrated"
    assert 5472 / 273 * photo.factory.y0 == pytest.approx(-45.9, rel=1e-6), "below the middle"


def test_thermal_mavic_3_whose_focal_length_is_in_micrometres(tmp_path):
    tags = {
        **GIMBAL,
        "AltitudeType": "GpsFusionAlt",
        "GpsStatus": "Normal",
        "AbsoluteAltitude": "+130.575",
        "RelativeAltitude": "+70.1",
    }
    tags |= {"CalibratedFocalLength": "9100.000000", "CalibratedOpticalCenterX": "0.0", "ImageSource": "InfraredCamera"}
    tags |= {"UTCAtExposure": "2023-06-02T06:49:41.160361", "DroneSerialNumber": "1581F5FJD239"}
    photo, header = read(tmp_path, "DJI M3T", {**TURIN, 5: b"\0", 6: 130.575}, {0x920A: 9.1}, ("drone-dji", tags), (640, 512))
    assert photo.factory is None and photo.serial == "1581F5FJD239" and photo.height_kind == "barometric"
    assert by_utc(header.tags).microsecond == 160361 and bands_of((header,)) == (THERMAL,)


def test_mavic_air_2_that_writes_its_height_above_the_start_twice(tmp_path):
    tags = {**GIMBAL, "AbsoluteAltitude": "+59.80", "RelativeAltitude": "+59.80"}
    photo, header = read(tmp_path, "DJI FC3170", {**TURIN, 5: b"\0", 6: 59.8}, None, ("drone-dji", tags), (4000, 3000))
    assert photo.height_kind == "relative" and photo.fix is None and position_sigma(header.tags) == (3, 3, 5)


def test_mavic_pro_with_the_camera_of_its_drawings(tmp_path):
    tags = {**GIMBAL, "AbsoluteAltitude": "+14.40", "RelativeAltitude": "+25.40", "CalibratedFocalLength": "3051.6"}
    tags |= {"CalibratedOpticalCenterX": "2000.0", "CalibratedOpticalCenterY": "1125.0"}
    photo, _ = read(tmp_path, "DJI FC220", {**TURIN, 5: b"\0", 6: 14.4}, None, ("drone-dji", tags), (4000, 2250))
    assert photo.factory.kind == "design" and 20 * photo.factory.c == pytest.approx(3051.6)


def test_mavic_2_indoors_without_a_place(tmp_path):
    nowhere = {1: "N", 2: (0.0, 0.0, 0.0), 3: "E", 4: (0.0, 0.0, 0.0), 5: b"\1", 6: 33.0}
    photo, _ = read(tmp_path, "DJI FC2403", nowhere, None, ("drone-dji", {**GIMBAL, "AbsoluteAltitude": "-33.15"}))
    assert photo.longitude is None and photo.altitude == -33.0


def test_phantom_3_whose_gimbal_is_in_the_notes(tmp_path):
    own = note(Pitch=-89.5, Yaw=30.0, Roll=0.0)
    photo, _ = read(tmp_path, "DJI FC300S", {**TURIN, 5: b"\1", 6: 5.677}, {0x927C: own}, size=(4000, 3000))
    assert photo.attitude_of == "gimbal" and photo.attitude[2] == pytest.approx(-30.0, abs=0.5)
    assert photo.altitude == pytest.approx(-5.677) and photo.height_kind is None


@pytest.mark.parametrize(("flag", "fix", "sigma"), [("16", "single", (3.0, 3.0, 5.0)), ("34", "float", (1.24, 1.2, 3.91))])
def test_mavic_3_enterprise_without_a_fixed_solution_writes_the_same_tags(tmp_path, flag, fix, sigma):
    tags = {"RtkFlag": flag, "RtkStdLon": "1.24", "RtkStdLat": "1.20", "RtkStdHgt": "3.91", "AltitudeType": "GpsFusionAlt"}
    photo, header = read(tmp_path, "DJI M3E", {**TURIN, 6: 310.0}, None, ("drone-dji", {**tags, **GIMBAL}), (5280, 3956))
    assert photo.fix == fix and position_sigma(header.tags) == pytest.approx(sigma)


def test_a_photograph_that_was_dewarped_has_no_distortion_left(tmp_path):
    tags = {"DewarpFlag": "1", "DewarpData": "2023-01-01;3713.29,3713.29,7.02,-8.72,-0.112,0.0149,-0.00008,0.00004,-0.027"}
    photo, _ = read(tmp_path, "DJI M3E", None, None, ("drone-dji", tags), (5280, 3956))
    assert photo.dewarped and (photo.factory.k1, photo.factory.x0) == (0.0, 0.0)


def test_parrot_sequoia_in_millimetres(tmp_path):
    tags = {"GPSXYAccuracy": "2.301", "GPSZAccuracy": "3.419", "Yaw": "10.0", "Pitch": "0.0", "Roll": "0.0"}
    tags |= {
        "ModelType": "perspective",
        "PerspectiveFocalLength": "4.812",
        "PrincipalPoint": "3.09,2.32",
        "LineReadoutTime": "47500",
    }
    tags |= {"PerspectiveDistortion": ["0.02", "-0.03", "0.01", "0.001", "-0.001"], "RigName": "Sequoia"}
    plane = {0xA20E: 4608 / 0.6174, 0xA20F: 4608 / 0.6174, 0xA210: 3}
    photo, header = read(tmp_path, "Parrot Sequoia", {**TURIN, 5: b"\0", 6: 347.723}, plane, ("Camera", tags), (4608, 3456))
    assert position_sigma(header.tags) == (2.301, 2.301, 3.419) and photo.attitude_of == "aircraft"
    assert 20 * photo.factory.c == pytest.approx(4.812 * 4608 / 6.174, rel=3e-3) and photo.factory.k2 == -0.03
    assert photo.attitude == pytest.approx((0.0, 0.0, -10.0), abs=1e-9)


def test_sensefly_without_a_reference_of_its_altitude(tmp_path):
    tags = {"GPSXYAccuracy": "5.95", "GPSZAccuracy": "5.40", "Yaw": "84.0", "Pitch": "2.0", "Roll": "-3.0"}
    photo, header = read(tmp_path, "Canon IXUS 125 HS", {**TURIN, 6: 259.775}, {0x920A: 4.3}, ("sensefly", tags), (4608, 3456))
    assert photo.altitude == pytest.approx(259.775) and photo.height_kind is None
    assert position_sigma(header.tags) == (5.95, 5.95, 5.4) and photo.attitude_of == "aircraft"


def test_a_phone(tmp_path):
    tags = {0x9003: "2020:05:01 10:00:00", 0x9291: "123", 0x9011: "+02:00", 0xA405: 28, 0x920A: 3.99}
    photo, header = read(tmp_path, "Apple iPhone 7", {**TURIN, 5: b"\0", 6: 240.0, 0x1F: 5.0}, tags, size=(4032, 3024))
    assert position_sigma(header.tags) == pytest.approx((5.0, 5.0, 25.0 / 3)) and photo.focal_35mm == 28


def test_skydio_whose_principal_point_counts_from_the_corner(tmp_path):
    tags = {"CalibratedFocalLengthX": "3000.0", "CalibratedFocalLengthY": "3000.0", "DewarpData": "0.01,-0.02,0.003", **RTK}
    tags |= {"CalibratedOpticalCenterX": "2005.5", "CalibratedOpticalCenterY": "1490.5"}
    photo, _ = read(tmp_path, "Skydio X10", {**TURIN, 5: b"\0", 6: 312.4}, None, ("drone-skydio", tags), (4000, 3000))
    assert (20 * photo.factory.x0, 20 * photo.factory.y0) == pytest.approx((6.0, 9.0)) and photo.factory.k3 == 0.003
    assert photo.height_kind == "ellipsoidal" and photo.fix == "fixed"


@pytest.mark.parametrize("maker", ["drone-autel", "drone-yuneec"])
def test_makers_who_follow_dji(tmp_path, maker):
    tags = {**RTK, **GIMBAL, "AbsoluteAltitude": "+312.40", "RelativeAltitude": "+80.00"}
    photo, header = read(tmp_path, "Maker XT705", {**TURIN, 5: b"\0", 6: 312.4}, None, (maker, tags), (5472, 3648))
    assert photo.fix == "fixed" and photo.height_kind == "ellipsoidal" and photo.attitude_of == "gimbal"
    assert position_sigma(header.tags)[0] == pytest.approx(0.01106) and photo.relative_height == 80.0


def test_parrot_anafi(tmp_path):
    tags = {"CameraYawDegree": "12.0", "CameraPitchDegree": "-90.0", "CameraRollDegree": "0.0", "GPSXYAccuracy": "1.2"}
    photo, header = read(tmp_path, "Parrot Anafi", {**TURIN, 5: b"\0", 6: 300.0}, None, ("drone-parrot", tags), (5344, 4016))
    assert photo.attitude_of == "gimbal" and position_sigma(header.tags) == pytest.approx((1.2, 1.2, 2.0))


@pytest.mark.parametrize("model", ["SONY ILCE-7RM4", "SONY DSC-RX1RM2", "Phase One iXM-100"])
def test_payloads_that_write_exif_only(tmp_path, model):
    tags = {0x9003: "2024:05:01 10:00:00", 0xA431: "3012345", 0x920A: 35.0}
    photo, header = read(tmp_path, model, {**TURIN, 5: b"\0", 6: 412.25}, tags, size=(9504, 6336))
    assert photo.serial == "3012345" and photo.fix is None and photo.height_kind is None
    assert position_sigma(header.tags) == (3, 3, 5) and photo.altitude == pytest.approx(412.25)


def test_wingtra_with_the_accuracy_of_its_post_processing(tmp_path):
    tags = {"GPSXYAccuracy": "0.02", "GPSZAccuracy": "0.03", "Yaw": "45.0", "Pitch": "1.0", "Roll": "0.0"}
    photo, header = read(tmp_path, "SONY DSC-RX1RM2", {**TURIN, 5: b"\0", 6: 412.25}, None, ("Camera", tags), (7952, 5304))
    assert position_sigma(header.tags) == pytest.approx((0.02, 0.02, 0.03)) and photo.attitude_of == "aircraft"


def test_tags_that_are_no_text_of_utf_8_are_read_as_far_as_they_go(tmp_path):
    read(tmp_path, "DJI FC6360", TURIN, None, ("drone-dji", {**RTK, "SelfData": "MARK"}))
    path = tmp_path / "photo.jpg"
    path.write_bytes(path.read_bytes().replace(b"MARK", b"M\xe4\xe4K"))
    assert read_header(path).tags["drone-dji:RtkFlag"] == "50"
