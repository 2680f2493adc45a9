"""What a positions file holds, before it is matched to photographs and transformed: the value that all readers return."""

from dataclasses import dataclass, field

from orthomill.schemas.photo import Fix, HeightKind

Triple = tuple[float, float, float]


@dataclass(frozen=True)
class ListedPosition:
    """One line: its number, the photograph that it names ("": none, an event with its `number` and `time`, s), x or longitude, y or
    latitude and height (NaN: not given), the standard errors (m, in the order of xyz) where stated, omega, phi, kappa or yaw,
    pitch, roll in degrees, and how the position was found."""

    line: int
    name: str
    xyz: Triple
    sigma: Triple | None = None
    omega_phi_kappa: Triple | None = None
    yaw_pitch_roll: Triple | None = None
    fix: Fix | None = None
    number: int = 0
    time: float | None = None


@dataclass(frozen=True)
class PositionList:
    """The lines of a file, the format that it follows, and what it says of itself: reference system, what heights refer to, that
    coordinates are degrees, that they are in the order of the axes of their system (latitude first), that standard errors are in a
    unit that it names, that positions are those of the antenna; `steps`: to which plan and heights are written, in their unit (0:
    finely)."""

    format: str
    positions: tuple[ListedPosition, ...]
    crs: str | None = None
    heights: HeightKind | None = None
    degrees: bool = False
    order_of_system: bool = False
    unit_stated: bool = False
    antenna: bool = False
    steps: tuple[float, float] = (0.0, 0.0)
    without: int = 0
    angles: str | None = None
    mistakes: tuple[str, ...] = field(default=())

    @property
    def named(self) -> bool:
        """Whether its lines name photographs."""
        return any(one.name for one in self.positions)


FIXES: dict[int, Fix] = {0: "none", 1: "fixed", 2: "float", 3: "single", 4: "single", 5: "single", 6: "single"}
FIXES |= {16: "single", 50: "fixed"}
"""Codes of RTKLIB (1 fixed, 2 float, 3 SBAS, 4 DGPS, 5 single, 6 PPP) and of DJI (50 fixed, 32 to 49 float, 16 single, 0 none)"""


def fix_of(code: float | None) -> Fix | None:
    """How a position was found, by the code of RTKLIB or DJI; None where it is neither."""
    if code is None or code != code:
        return None
    return "float" if 32 <= code < 50 else FIXES.get(round(code))
