"""Names of reference systems with a vertical part."""


def with_vertical(crs: str, vertical: int) -> str:
    """The code of a system with a vertical part, that of an example where the system has no plain code."""
    plain = crs.upper().startswith("EPSG:") and "+" not in crs
    return f"{crs if plain else 'EPSG:26915'}+{vertical}"
