"""The options of a task: checked when it is given, and turned into what its workflow is to keep. Nothing is dropped in silence."""

import difflib
from collections.abc import Iterable

from pyproj import CRS
from pyproj.exceptions import CRSError

from orthomill.pipeline.serving.node.odm_options import ODM_OPTIONS, RERUN, Taken, stage_of, stages_offered, with_readout
from orthomill.pipeline.serving.node.offered_settings import NodeOption, checked_value, fields_offered, offered
from orthomill.pipeline.serving.queue.task_state import GivenOption
from orthomill.pipeline.serving.queue.wishes import Wishes
from orthomill.pipeline.workflow.workflow_checks import kind_of
from orthomill.schemas.errors import WorkflowError, first_of
from orthomill.schemas.stage_contract import Stage

_SETTLED = frozenset({"name", "project-path", "skip-post-processing", "images", "help", "version"})
"""what clients send along although it is told by other means"""


class TaskOptions:
    """Knows all options of the node."""

    def __init__(self, catalogue: tuple[type[Stage], ...]) -> None:
        self._fields = fields_offered(catalogue)
        self._kinds = tuple(kind_of(stage) for stage in catalogue)
        theirs = (one.offered for one in ODM_OPTIONS.values())
        self.listed: tuple[NodeOption, ...] = (*theirs, stages_offered(self._kinds), *offered(catalogue))

    def wishes(self, given: Iterable[GivenOption]) -> Wishes:
        """What options ask for; unknown ones become notes. Raises WorkflowError with all mistakes, one a line."""
        taken, mistakes = Taken(), []
        for option in given:
            try:
                self._take(option, taken)
            except WorkflowError as error:
                mistakes.append(str(error))
        if mistakes:
            raise WorkflowError(first_of(mistakes))
        taken = with_readout(taken)
        return Wishes(settings=taken.settings, notes=tuple(taken.notes), **taken.more)

    def _take(self, option: GivenOption, taken: Taken) -> None:
        name, value = option.name, option.value
        if name in self._fields:
            # An empty entry of a form is the default.
            if value not in ("", None):
                taken.settings[name] = checked_value(name, self._fields[name], value)
                if name == "crs":
                    _check_system(taken.settings[name])
        elif name in ODM_OPTIONS:
            if value not in ("", None) or ODM_OPTIONS[name].offered.type == "bool":
                ODM_OPTIONS[name].take(value, taken)
        elif name == RERUN:
            if value in ("", None):
                return
            stage = stage_of(str(value), self._kinds)
            if stage is None:
                raise WorkflowError(f"{RERUN} is {str(value)[:60]!r}; it is one of {', '.join(self._kinds)}.")
            taken.more["rerun_from"] = stage
        elif name not in _SETTLED:
            taken.notes.append(self._unknown(name))

    def _unknown(self, name: str) -> str:
        known = [*self._fields, *ODM_OPTIONS]
        near = difflib.get_close_matches(name, known, 1)
        meant = f" Was {near[0]} meant?" if near else ""
        return f"Not used: the option {name[:60]} means nothing to orthomill.{meant}"


def _check_system(crs: str) -> None:
    """What PROJ does not know is told before anything is uploaded."""
    try:
        CRS.from_user_input(crs)
    except (CRSError, UnicodeError):
        raise WorkflowError(f"crs is {crs[:60]!r}, which PROJ does not know; give a code such as EPSG:32634.") from None
