"""The stage `simulation`: photographs of a scene with known truth, as files that the other stages read like any others."""

from collections.abc import Iterator
from typing import ClassVar, Literal

from pydantic import model_validator

from orthomill.schemas.job import Export, Job
from orthomill.schemas.raster import RasterSpec
from orthomill.schemas.settings import refuse_ignored, setting
from orthomill.schemas.stage_contract import ProjectView, Stage
from orthomill.tasks.simulation.portal.portal_scene import SceneChoice, TownScene

OF_THE_FLIGHT = (
    "pixel_um",
    "frame_mm",
    "c_mm",
    "scale",
    "base_m",
    "side_overlap",
    "strips",
    "photos_per_strip",
    "scene_cell",
    "buildings",
    "board_photos",
    "boards",
    "gnss_sigma",
    "control",
    "check",
)
"""Settings that only the flight over the town reads."""


class SimulationStage(Stage):
    """A flight over a simulated town near Volos with photographs of chessboards by the same camera, or the entrance of a church,
    and a survey, with known truth."""

    title: ClassVar[str] = "Simulated photographs"
    provides: ClassVar[frozenset[str]] = frozenset({"simulated"})
    for_own_photographs: ClassVar[bool] = False

    kind: Literal["simulation"] = "simulation"
    scene: SceneChoice = setting(TownScene(), "What is photographed.")
    seed: int = setting(2009, "Everything random follows from this number.", ge=0, le=10**6)
    pixel_um: float = setting(
        96.0, "Side of a pixel of the photographs; the scene does not depend on it.", "micrometres", ge=5, le=400
    )
    frame_mm: float = setting(230.0, "Side of the frame.", "mm", ge=20, le=300)
    c_mm: float = setting(153.353, "Camera constant.", "mm", ge=15, le=400)
    scale: float = setting(6800.0, "Denominator of the photo scale on the plain.", ge=1000, le=30000)
    base_m: float = setting(582.0, "Distance of neighbouring projection centres in a strip.", "m", gt=0)
    side_overlap: float = setting(0.6, "Overlap of neighbouring strips, as a share of the frame.", ge=0, lt=1)
    strips: int = setting(2, "Strips; every second one is flown in the opposite direction.", ge=1, le=8)
    photos_per_strip: int = setting(3, "Photographs in a strip.", ge=2, le=16)
    scene_cell: float = setting(0.5, "Cell of the height model and of the true orthoimage.", "m", ge=0.1, le=2)
    noise_sigma: float = setting(2.0, "Standard deviation of the noise of the photographs.", "grey levels", ge=0, le=20)
    buildings: int = setting(220, "Buildings in the scene.", ge=1, le=2000)
    board_photos: int = setting(12, "Photographs of the chessboards; 0 for none.", ge=0, le=48)
    boards: int = setting(5, "Equal chessboards on the floor.", ge=1, le=5)
    gnss_sigma: float = setting(0.1, "Standard error of each coordinate of a projection centre.", "m", gt=0, le=10)
    control: int = setting(8, "Ground control points.", ge=0, le=100)
    check: int = setting(8, "Check points.", ge=0, le=100)
    control_sigma: float = setting(0.02, "Standard error of each coordinate of a ground point.", "m", gt=0, le=10)
    image_sigma: float = setting(0.3, "Standard error of each image measurement of a ground point.", "px", gt=0, le=10)

    @model_validator(mode="after")
    def _fits_one_mask(self) -> "SimulationStage":
        if self.strips * self.photos_per_strip > 32:
            # The visibility raster has one bit per photograph.
            raise ValueError(
                f"strips x photos_per_strip is {self.strips * self.photos_per_strip}, but at most 32 photographs "
                "can be simulated: reduce strips or photos_per_strip"
            )
        return self

    @model_validator(mode="after")
    def _has_an_effect(self) -> "SimulationStage":
        """Raises ValueError for settings that others leave without effect."""
        if self.scene.kind == "portal":
            refuse_ignored(
                self, OF_THE_FLIGHT, "scene: {kind: portal}", "its seven photographs and targets are given: remove the line"
            )
            return self
        if self.board_photos == 0:
            refuse_ignored(self, ("boards",), "board_photos: 0", "no chessboards are simulated: remove the line")
        if self.control + self.check == 0:
            remedy = "no ground points are surveyed: remove the line"
            refuse_ignored(self, ("control_sigma", "image_sigma"), "control: 0 and check: 0", remedy)
        return self

    def plan(self, view: ProjectView) -> Iterator[RasterSpec | Job | Export]:
        """The truth, the photographs, the boards and the survey."""
        from orthomill.tasks.simulation.plan.simulation_jobs import simulation_jobs

        return simulation_jobs(self, view)
