"""What commands compute beside a run: of one photograph, of two, of the headers of all, of marked points, of a finished project."""

from orthomill.tasks.accuracy.acceptance.clauses import accepted
from orthomill.tasks.accuracy.acceptance.delivered_points import inspected
from orthomill.tasks.accuracy.acceptance.inspector import Inspector
from orthomill.tasks.accuracy.adjustment.joint_covariance import StoredCovariance
from orthomill.tasks.accuracy.answers.measuring import measure
from orthomill.tasks.accuracy.statement.point_statement import statement_of
from orthomill.tasks.flight_outlook import look_ahead
from orthomill.tasks.geometry.topocentric import place_on_earth
from orthomill.tasks.grown_pair import GrowthRules, constants_of, grown_pair
from orthomill.tasks.inspections.image_points import points_on_surface
from orthomill.tasks.inspections.photographs_of_place import photographs_of_place
from orthomill.tasks.inspections.target_list import targets_of_photograph
from orthomill.tasks.inspections.window_size import share_of, sizing_of, window_size_map
from orthomill.tasks.listed_points import listed_points
from orthomill.tasks.marking.given_points import given_points, marks_of
from orthomill.tasks.marking.hidden_areas import hidden_mask
from orthomill.tasks.marking.marker import marker_of
from orthomill.tasks.orientation.plane.block_on_plane import SURVEY_BLOCK, SURVEY_POINTS
from orthomill.tasks.orientation.relative.classical_forms import classical_forms
from orthomill.tasks.orientation.results.handover import OrientedProject, handed_files
from orthomill.tasks.projection.model.glb import as_glb
from orthomill.tasks.projection.model.height_patch import height_patch
from orthomill.tasks.targets.photo_targets import targets_in

__all__ = [
    "SURVEY_BLOCK",
    "SURVEY_POINTS",
    "GrowthRules",
    "Inspector",
    "OrientedProject",
    "StoredCovariance",
    "accepted",
    "as_glb",
    "classical_forms",
    "constants_of",
    "given_points",
    "grown_pair",
    "handed_files",
    "height_patch",
    "hidden_mask",
    "inspected",
    "listed_points",
    "look_ahead",
    "marker_of",
    "marks_of",
    "measure",
    "photographs_of_place",
    "place_on_earth",
    "points_on_surface",
    "share_of",
    "sizing_of",
    "statement_of",
    "targets_in",
    "targets_of_photograph",
    "window_size_map",
]
