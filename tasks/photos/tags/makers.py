"""Tags under the names that makers give them: one thing, several namespaces.

Seen in files: DJI (drone-dji), Parrot's Sequoia and MicaSense (Camera, Pix4D's words), senseFly. By documentation only: Autel,
Skydio, Yuneec, Parrot's Anafi.
"""

from collections.abc import Mapping

from orthomill.schemas.photo import tag_text
from orthomill.tasks.photos import exif

MAKERS = ("drone-dji", "drone-autel", "drone-skydio", "drone-yuneec", "drone-parrot", "drone", "sensefly", "Camera")
"""Prefixes of the namespaces in which drones write, the makers' own ones before the common ones."""


def maker_text(tags: Mapping[str, str], *names: str) -> str:
    """The first of these tags that any maker wrote, as text; "" without one."""
    found = (tag_text(tags, f"{prefix}:{name}") for name in names for prefix in MAKERS)
    return next(filter(None, found), "")


def maker_numbers(tags: Mapping[str, str], *names: str) -> list[float]:
    """The numbers of the first of these tags that any maker wrote and that holds some."""
    found = (exif.numbers(tags, f"{prefix}:{name}") for name in names for prefix in MAKERS)
    return next(filter(None, found), [])


def maker_number(tags: Mapping[str, str], *names: str) -> float | None:
    """The first number of the first of these tags."""
    found = maker_numbers(tags, *names)
    return found[0] if found else None
