"""The settings of the choice of pairs."""

from orthomill.schemas.settings import Settings, setting


class PairChoice(Settings):
    """When a pair of photographs is useful."""

    overlap: float = setting(0.25, "Least common ground of a pair, as a share of the smaller footprint.", gt=0, le=1)
    base_height_low: float = setting(0.1, "Least base over flying height; flatter intersections give poor heights.", gt=0)
    base_height_high: float = setting(1.2, "Greatest base over flying height; steeper views differ too much to be matched.", gt=0)
    convergence: float = setting(40.0, "Greatest angle between the viewing directions.", "degrees", gt=0, le=90)
    scale: float = setting(1.6, "Greatest ratio of the ground pixel sizes of the two photographs.", ge=1)
    per_photo: int = setting(4, "Pairs that a photograph takes part in, at most: half of them with its nearest neighbours.", ge=1)
    per_place: int = setting(
        4, "Pairs over a place that are enough: a wide pair is taken where a quarter of its ground lies under fewer.", ge=1
    )
