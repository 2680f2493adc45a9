"""A delivery as `orthomill accept` is asked for it: a run of ours, or files of another program and what they are tested with."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from orthomill.pipeline.cli.lookups.delivery import Delivered, Inspect, facts_by_inspector, facts_of_files
from orthomill.pipeline.cli.lookups.inspected_block import inspection_workflow
from orthomill.pipeline.cli.lookups.kept_acceptance import Accept, area_of, by_name, digested, inputs_of, recorded
from orthomill.pipeline.workflow.workflow_file import LoadedWorkflow
from orthomill.schemas.accuracy.acceptance import AcceptanceLimits, AcceptanceResult, DeliveryFacts
from orthomill.schemas.errors import WorkflowError
from orthomill.schemas.stage_contract import Stage


@dataclass(frozen=True)
class AskedDelivery:
    """What is held against a profile. Raises WorkflowError, when it is made, for what does not go together."""

    loaded: LoadedWorkflow | None
    files: Delivered
    photos: Path | None
    block: Path | None
    marks: Path | None
    crs: str | None
    vegetated: tuple[str, ...]

    def __post_init__(self) -> None:
        if not (self.loaded or self.foreign or self.oriented):
            raise WorkflowError("Give a project that has been run, or files of a delivery with --dsm and --ortho.")
        if self.oriented and self.loaded:
            raise WorkflowError("A project has its photographs and its block; leave --photos and --block out, or the project.")
        if self.oriented and not self.foreign:
            raise WorkflowError("Photographs and block inspect products: give these with --dsm and --ortho.")
        if self.marks and not self.oriented:
            raise WorkflowError("--marks are in photographs; give these with --photos and their orientation with --block.")
        if self.own and self.vegetated:
            raise WorkflowError(
                "--vegetated is for products of another program; a project names these points in its stage: "
                f"kind: accuracy, vegetated: [{', '.join(self.vegetated)}]."
            )

    @property
    def foreign(self) -> tuple[Path, ...]:
        """Products of another program."""
        return tuple(path for path in (self.files.dsm, self.files.ortho) if path)

    @property
    def oriented(self) -> bool:
        """Whether another program's orientation of the photographs is given."""
        return bool(self.photos or self.block)

    @property
    def own(self) -> LoadedWorkflow | None:
        """The project whose own products are asked for."""
        return None if self.foreign else self.loaded


@dataclass(frozen=True)
class DeliveryMethods:
    """What tests a delivery, handed in by the command."""

    accept: Accept
    inspect: Inspect
    inspector: Callable[..., Any]
    listed: Callable[..., Any]
    orient: Callable[[LoadedWorkflow], None]
    """runs a block of another program to its orientation"""
    catalogue: tuple[type[Stage], ...]


def accept_files(asked: AskedDelivery, limits: AcceptanceLimits, methods: DeliveryMethods) -> AcceptanceResult:
    """Hold products of another program against a profile. Raises WorkflowError, StoreError for what cannot be read."""
    area = area_of(limits, asked.loaded.root if asked.loaded else Path.cwd())
    facts = _facts(asked, area, methods)
    result = methods.accept(limits, facts, " and ".join(path.name for path in asked.foreign))
    return recorded(result, limits, facts, digested(by_name(asked.foreign)), digested(_evidence(asked, area)))


def _facts(asked: AskedDelivery, area: Path | None, methods: DeliveryMethods) -> DeliveryFacts:
    if asked.oriented:
        seen = _oriented(asked, methods)
        inspector = partial(methods.inspector, vegetated=asked.vegetated)
        return facts_by_inspector(seen.run_folder, asked.files, seen.project.crs, inspector, ("check", "control"), area)
    if asked.loaded:
        inspector = partial(methods.inspector, vegetated=asked.vegetated or _vegetated(asked.loaded))
        return facts_by_inspector(asked.loaded.run_folder, asked.files, asked.loaded.project.crs, inspector, area=area)
    return facts_of_files(asked.files, asked.crs, partial(methods.inspect, vegetated=asked.vegetated), methods.listed, area)


def _oriented(asked: AskedDelivery, methods: DeliveryMethods) -> LoadedWorkflow:
    seen, given = (asked.photos, asked.block), (asked.files.points, asked.marks)
    made = inspection_workflow(asked.foreign[0], seen, given, asked.crs, Path.cwd(), methods.catalogue)
    methods.orient(made)
    return made


def _vegetated(loaded: LoadedWorkflow) -> tuple[str, ...]:
    """Points under vegetation, as the project's stage names them."""
    return next((getattr(stage, "vegetated", ()) for stage in loaded.stages if stage.kind == "accuracy"), ())


def _evidence(asked: AskedDelivery, area: Path | None) -> Iterator[tuple[str, Path]]:
    return inputs_of(asked.loaded) if asked.loaded else by_name((asked.files.points, asked.marks, asked.block, area))
