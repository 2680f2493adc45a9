"""Sensor widths of common cameras, for the many whose EXIF tags do not give the pixel size.

The name is EXIF's Model in capitals. Widths (longer side of the sensor, mm) are the makers' published ones; photographs are assumed
to use the full width, which holds for the 3:2, 4:3 and 16:9 modes of these cameras.
"""

SENSOR_WIDTH_MM: dict[str, float] = {
    # DJI names its cameras by a code that differs between drones of the same sensor: each code has to be listed.
    "FC200": 6.17,
    "FC220": 6.17,
    "FC300C": 6.17,
    "FC300S": 6.17,
    "FC300X": 6.17,
    "FC300XW": 6.17,
    "FC300SE": 6.17,
    "FC330": 6.17,
    "FC350": 6.17,
    "FC2103": 6.17,
    "FC7203": 6.3,
    "FC7303": 6.3,
    "FC3170": 6.4,
    "FC3582": 9.7,
    "FC3411": 13.2,
    "FC6310": 13.2,
    "FC6310R": 13.2,
    "FC6310S": 13.2,
    "L1D-20C": 13.2,
    "L2D-20C": 17.3,
    "M3E": 17.3,
    "FC550": 17.3,
    "FC550RAW": 17.3,
    "FC6510": 13.2,
    "FC6520": 17.3,
    "FC6540": 23.5,
    "ZENMUSEP1": 35.9,
    # Interchangeable-lens and compact cameras that survey drones carry.
    "ILCE-5100": 23.5,
    "ILCE-6000": 23.5,
    "ILCE-6300": 23.5,
    "ILCE-7R": 35.9,
    "ILCE-7RM2": 35.9,
    "ILCE-7RM3": 35.9,
    "ILCE-7RM4": 35.7,
    "NEX-5N": 23.4,
    "NEX-7": 23.5,
    "DSC-RX1RM2": 35.9,
    "DSC-WX220": 6.17,
    "DSC-RX100": 13.2,
    "CANON EOS 550D": 22.3,
    "CANON EOS 600D": 22.3,
    "CANON EOS 5D MARK II": 36.0,
    "CANON EOS 5D MARK III": 36.0,
    "CANON EOS 6D": 35.8,
    "CANON EOS M": 22.3,
    "CANON POWERSHOT S110": 7.44,
    "CANON POWERSHOT SX260 HS": 6.17,
    "CANON IXUS 220HS": 6.17,
    "NIKON D3X": 35.9,
    "NIKON D800": 35.9,
    "NIKON D810": 35.9,
    "NIKON D850": 35.9,
    "NIKON D5100": 23.6,
    "NIKON D7000": 23.6,
    "PENTAX K-5": 23.7,
    "RICOH GR": 23.7,
    "RICOH GR II": 23.7,
    "GR DIGITAL 4": 7.44,
    "ANAFI": 5.96,
    "S.O.D.A.": 12.75,
    "AEROM-X": 12.75,
}


def sensor_width_mm(model: str) -> float | None:
    """Longer side of the sensor of a camera model, mm; None when the model is not in the table."""
    return SENSOR_WIDTH_MM.get(model.strip().upper())
