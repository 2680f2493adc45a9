"""What is said of the map."""

from orthomill.schemas.maps.map_page import MapPage
from orthomill.schemas.stage_report import Figure, Product, StageReport, Verdict


def viewer_report(page: MapPage) -> StageReport:
    """The report of the stage."""
    return StageReport(
        verdict=Verdict(level="good", sentence=f"{len(page.pictures)} layers on one map, at full resolution."),
        products=(
            Product(
                path="products/index.html",
                purpose="All layers on one map in a browser, with heights and standard errors of every place; needs "
                "products/viewer "
                "beside it, and no network",
                main=True,
            ),
        ),
        figures=(Figure(name="layers", value=len(page.pictures), sentence="Layers of the map."),),
    )
