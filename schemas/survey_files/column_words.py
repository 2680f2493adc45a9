"""Names of columns as programs and people write them, and what they mean here.

`lon`, `lat` are columns that say that they are degrees; `x`, `y` are east and north of whatever system the file is in.
"""

import re
from dataclasses import dataclass

_MEANINGS: dict[str, str] = {
    "photo": "photo image filename file file_name image_name imagename image_file image_filename photo_name picture source_file "
    "sourcefile img camera_label photo_id image_path path bild bildname bilddatei foto fotoname datei dateiname fichier nom_image "
    "imagen archivo immagine img_name image_id img_id",
    "name": "name label point point_name point_id pointid id target station marker marker_name gcp gcp_name gcp_label gcp_id pt "
    "pt_id pkt nr no point_number point_no point_nr point# pno pt_no number punkt punktnummer punktname nom punto "
    "nombre nome numero numéro ponto punt target_name target_id target_label",
    "role": "role",
    "kind": "type kind point_type usage gcp/check gcp_type marker_type",
    "enabled": "enable enabled use used active",
    "system": "cs_name cs coordinate_system crs epsg projection reference_system",
    "x": "x e east easting x_east east_x x/longitude x/easting x/east rechts rechtswert ostwert xcoord x_coord coord_x geo_x "
    "longitude/easting longitude/x easting/x east/x ost este est",
    "y": "y n north northing y_north north_y y/latitude y/northing y/north hoch hochwert nordwert ycoord y_coord coord_y geo_y "
    "latitude/northing latitude/y northing/y north/y nord norte",
    "z": "z h height altitude alt elevation elev up hoehe höhe z/altitude z/height zcoord z_coord coord_z geo_z altitude/z "
    "elevation/z height/z hohe altitud altura quota cota hauteur absolutealtitude absolute_altitude gpsaltitude gps_altitude "
    "gps_alt gps_height",
    "lon": "lon long lng longitud länge laenge longitude gpslongitude gps_longitude gps_lon longitude_wgs84",
    "lat": "lat latitud breite latitude gpslatitude gps_latitude gps_lat latitude_wgs84",
    "z_ellipsoidal": "ellipsoidal_height ellipsoid_height ellipsoidheight ellh height_ell h_ell altitude_wgs84 "
    "ellipsoidal_altitude height_ellipsoid wgs84_height hae altitude_ellipsoidal elevation_ellipsoidal ellipsoidal",
    "z_sea": "altitude_amsl altitude_msl orthometric_height height_orthometric amsl msl height_msl orthometric",
    "sigma_x": "sigma_x sx sd_x std_x stdx accuracy_x x_accuracy acc_x accx accuracy_easting accuracy_east sigma_e sigma_east "
    "sde std_e stde sd_e easting_accuracy rms_x easting_rms lon_accuracy longitude_accuracy sigma_lon std_lon rtkstdlon error_x "
    "sigma_easting easting_std",
    "sigma_y": "sigma_y sy sd_y std_y stdy accuracy_y y_accuracy acc_y accy accuracy_northing accuracy_north sigma_n sigma_north "
    "sdn std_n stdn sd_n northing_accuracy rms_y northing_rms lat_accuracy latitude_accuracy sigma_lat std_lat rtkstdlat error_y "
    "sigma_northing northing_std",
    "sigma_z": "sigma_z sz sd_z std_z stdz accuracy_z z_accuracy acc_z accz accuracy_vert accuracy_vertical vertical_accuracy "
    "accv acc_v vacc v_accuracy sigma_h sigma_u sigma_up sdu std_u stdu sd_u sigma_height height_accuracy altitude_accuracy sv "
    "stddev_h stdev_h vert_acc vertical_acc rtkstdhgt gpszaccuracy sigma_alt elevation_rms std_h error_z alt_accuracy accuracy_alt "
    "accuracy_altitude",
    "sigma_plan": "accuracy_x/y accuracy_xy xy_accuracy accuracy_horz accuracy_horizontal horizontal_accuracy acch acc_h hacc "
    "h_accuracy sh horiz_acc horizontal_acc sigma_plan sigma_xy gpsxyaccuracy accuracy_hz lateral_rms",
    "sigma_all": "accuracy_x/y/z accuracy_xyz accuracy sigma_xyz",
    "omega": "omega",
    "phi": "phi",
    "kappa": "kappa",
    "yaw": "yaw heading gimbalyawdegree gimbal_yaw camera_yaw azimuth yaw_angle",
    "pitch": "pitch gimbalpitchdegree gimbal_pitch camera_pitch pitch_angle",
    "roll": "roll gimbalrolldegree gimbal_roll camera_roll roll_angle",
    "fix": "q fix quality fix_type fixtype rtkflag rtk_flag solution_status solution fix_status gnss_fix",
    "col": "col column u image_u pixel_x px img_x image_x x_pixel im_x x_px spalte columna colonne colonna coluna",
    "row": "row line v image_v pixel_y py img_y image_y y_pixel im_y y_px zeile fila ligne riga linha",
    "sigma": "sigma sigma_px accuracy_px",
}
# A standard error by its parts: "StdDev_N", "horizontal accuracy". Not "X error", which is a residual in files of Metashape.
_ACCURACY = frozenset(
    [
        "accuracy",
        "acc",
        "sigma",
        "std",
        "stdev",
        "stddev",
        "sd",
        "dev",
        "deviation",
        "rms",
        "rmse",
        "precision",
        "uncertainty",
        "standard",
    ]
)
_DIRECTIONS = {
    "sigma_x": frozenset(["x", "e", "east", "easting", "lon", "longitude"]),
    "sigma_y": frozenset(["y", "n", "north", "northing", "lat", "latitude"]),
    "sigma_z": frozenset(["z", "u", "up", "v", "vert", "vertical", "height", "hgt", "alt", "altitude", "elev", "elevation"]),
    "sigma_plan": frozenset(["xy", "horz", "horiz", "horizontal", "hz", "plan", "lateral", "2d"]),
    "sigma_all": frozenset(["xyz", "3d", "position"]),
}
_OF_WORD = {word: meaning for meaning, words in _MEANINGS.items() for word in words.split()}
_BRACKETS = re.compile(r"[\(\[]([^\)\]]*)[\)\]]")
_DEGREES = frozenset({"deg", "degree", "degrees", "°"})
_SEA = frozenset({"msl", "amsl", "orthometric", "geoid"})
_MILLIMETRES = frozenset({"mm", "millimeter", "millimetre", "millimeters", "millimetres"})
_CENTIMETRES = frozenset({"cm", "centimeter", "centimetre", "centimeters", "centimetres"})
_FEET = frozenset({"ft", "feet", "foot"})
_US_FEET = frozenset({"us-ft", "usft", "ftus", "us survey feet", "us survey foot", "us ft", "sft"})


@dataclass(frozen=True)
class Column:
    """What a column means ("" where it is none of ours), and the length of its unit, m."""

    meaning: str
    unit: float = 1.0


def column(word: str) -> Column:
    """The meaning of the name of a column, in any case, with a unit in brackets or after an underscore."""
    own = word.strip().lstrip("#").strip().strip('"').strip().lower()
    unit = _unit([part.strip() for part in _BRACKETS.findall(own)])
    plain = re.sub(r"[^\w/#äöü]+", "_", _BRACKETS.sub("", own)).strip("_").replace("_/_", "/")
    head, _, tail = plain.rpartition("_")
    if plain not in _OF_WORD and head and tail in {"m", "mm", "cm", "deg", "ft", "px"}:
        plain, unit = head, _unit([tail])
    meaning = _OF_WORD.get(plain) or _accuracy(plain.split("_"))
    # Accuracies of angles are in degrees; heights say in brackets what they refer to.
    if meaning.startswith("sigma") and _DEGREES.intersection(_inside(own)):
        return Column("")
    if meaning == "z" and any(part.startswith("ellips") for part in _inside(own)):
        return Column("z_ellipsoidal", unit)
    if meaning == "z" and _SEA.intersection(_inside(own)):
        return Column("z_sea", unit)
    return Column(meaning, unit)


def _inside(own: str) -> set[str]:
    """The words in brackets."""
    return {part for words in _BRACKETS.findall(own) for part in re.split(r"[\s,;]+", words)}


def _accuracy(words: list[str]) -> str:
    """What a standard error is of, by the parts of its name; "" where it is none."""
    rest = set(words) - _ACCURACY
    if len(rest) == len(set(words)) or len(rest) != 1:
        return ""
    return next((meaning for meaning, known in _DIRECTIONS.items() if rest <= known), "")


def _unit(words: list[str]) -> float:
    for known, length in ((_MILLIMETRES, 0.001), (_CENTIMETRES, 0.01), (_FEET, 0.3048), (_US_FEET, 1200.0 / 3937.0)):
        if known.intersection(words):
            return length
    return 1.0


def columns(cells: tuple[str, ...]) -> tuple[Column, ...]:
    """The meanings of the cells of a header; of two columns of one meaning the first counts."""
    found: list[Column] = []
    for cell in cells:
        one = column(cell)
        found.append(one if one.meaning and all(one.meaning != other.meaning for other in found) else Column(""))
    return tuple(found)
