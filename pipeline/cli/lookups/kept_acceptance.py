"""What `orthomill accept` keeps: clauses with all that makes them a document, and whether they still follow from what is there."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path, PurePosixPath

from orthomill import __version__
from orthomill.pipeline.cli.lookups.delivery import facts_of_run, profile_from, show_acceptance
from orthomill.pipeline.report.acceptance_page import acceptance_json, acceptance_page
from orthomill.pipeline.report.accepted_part import ACCEPTANCE, read_acceptance
from orthomill.pipeline.signing.statement import SignedFile, digest_of, digest_of_blocks
from orthomill.pipeline.storage.depots.kept_products import KeptProducts
from orthomill.pipeline.storage.whole_files import write_whole
from orthomill.pipeline.workflow.workflow_checks import named_inputs
from orthomill.pipeline.workflow.workflow_file import LoadedWorkflow
from orthomill.schemas.accuracy.acceptance import AcceptanceLimits, AcceptanceResult, DeliveryFacts
from orthomill.schemas.accuracy.acceptance_record import AcceptanceRecord, AcceptedFile, SystemNames
from orthomill.schemas.errors import WorkflowError

PAGE = "acceptance.html"
"""beside the data, in the folder of the run"""
Accept = Callable[[AcceptanceLimits, DeliveryFacts, str], AcceptanceResult]


@dataclass(frozen=True)
class KnownDigests:
    """Digests of an acceptance by name, and when it was written (ns)."""

    files: dict[str, AcceptedFile]
    written: int

    def of(self, name: str, path: Path) -> AcceptedFile | None:
        """That of a file which has its size and was not touched since; None for any other."""
        known, status = self.files.get(name), path.stat()
        # The time of change beside that of the content: a copy or a file put in its place may have an old time of content.
        untouched = max(status.st_mtime_ns, status.st_ctime_ns) < self.written
        return known if known and untouched and known.size == status.st_size else None


NOTHING_KNOWN = KnownDigests({}, 0)


def known_digests(folder: Path) -> KnownDigests:
    """Those that the last acceptance of a run holds: products of many gigabytes are not read again by every run."""
    kept = read_acceptance(folder)
    if kept is None or kept.record is None:
        return NOTHING_KNOWN
    return KnownDigests({file.path: file for file in kept.record.files}, (folder / ACCEPTANCE).stat().st_mtime_ns)


def digested(named: Iterable[tuple[str, Path]]) -> tuple[AcceptedFile, ...]:
    """Files by the names that they are given, those of folders one by one. Raises OSError."""
    return tuple(_as_accepted(name, digest_of(path)) for place in named for name, path in _inside(*place))


def _inside(name: str, path: Path) -> Iterator[tuple[str, Path]]:
    """A file, or all files of a folder."""
    if not path.is_dir():
        yield name, path
        return
    for file in sorted(file for file in path.rglob("*") if file.is_file()):
        yield f"{name}/{file.relative_to(path).as_posix()}", file


def by_name(paths: Iterable[Path | None]) -> Iterator[tuple[str, Path]]:
    """Files of a delivery of another program, as they are called."""
    yield from ((path.name, path) for path in paths if path is not None)


def products_of_run(folder: Path) -> Iterator[AcceptedFile]:
    """The products of a run, each read where it is kept. Raises OSError, StoreError."""
    products, known = KeptProducts(folder), known_digests(folder)
    for name in sorted(products.names, key=lambda name: PurePosixPath(name).parts):
        path = products.here(name)
        yield (known.of(name, path) if path else None) or _as_accepted(name, digest_of_blocks(products.blocks(name)))


def inputs_of(loaded: LoadedWorkflow) -> Iterator[tuple[str, Path]]:
    """What a project names beside its photographs: control, positions, cameras."""
    yield from ((path, loaded.root / path) for path in named_inputs(loaded.project))


def _as_accepted(name: str, found: SignedFile) -> AcceptedFile:
    return AcceptedFile(path=name, size=found.size, sha256=found.sha256)


def area_of(limits: AcceptanceLimits, root: Path) -> Path | None:
    """The polygons that were ordered, by a name relative to the root of a project or the folder where the user stands."""
    return root / limits.area if limits.area else None


def recorded(
    result: AcceptanceResult,
    limits: AcceptanceLimits,
    facts: DeliveryFacts,
    files: tuple[AcceptedFile, ...],
    evidence: tuple[AcceptedFile, ...],
) -> AcceptanceResult:
    """The result with its record, as of now."""
    asked = {name: value for name, value in limits.model_dump(mode="json").items() if name != "kind" and value not in (None, False)}
    record = AcceptanceRecord(
        tested=datetime.now(UTC).isoformat(timespec="seconds"),
        version=__version__,
        made=facts.made,
        systems=facts.systems or SystemNames(),
        first_day=facts.first_day,
        last_day=facts.last_day,
        limits=asked,
        files=files,
        evidence=evidence,
        statement=facts.statement,
        points=facts.points,
        known=facts.known,
        doubts=facts.doubts,
        remarks=facts.remarks,
    )
    return result.model_copy(update={"record": record})


def written(result: AcceptanceResult, paths: Iterable[Path]) -> None:
    """Write the document (.html) or its data (any other suffix). Raises StoreError."""
    for path in paths:
        write_whole(path, acceptance_page(result).encode() if path.suffix == ".html" else acceptance_json(result))


def accept_run(loaded: LoadedWorkflow, limits: AcceptanceLimits, accept: Accept) -> AcceptanceResult:
    """Hold a finished run against a profile, and keep that with its report. Raises StoreError, WorkflowError."""
    facts = facts_of_run(loaded.run_folder, loaded.project.crs, area_of(limits, loaded.root))
    result = accept(limits, facts, loaded.project.project)
    products = tuple(products_of_run(loaded.run_folder))
    return keep(loaded, recorded(result, limits, facts, products, digested(inputs_of(loaded))))


def keep(loaded: LoadedWorkflow, result: AcceptanceResult) -> AcceptanceResult:
    """Write the acceptance of a run as page and data into its folder, and show it in the report; what is there already stays."""
    kept = as_kept(result, loaded.run_folder)
    written(kept, (loaded.run_folder / name for name in (ACCEPTANCE, PAGE)))
    show_acceptance(loaded)
    return kept


def as_kept(result: AcceptanceResult, folder: Path) -> AcceptanceResult:
    """The acceptance that a run has, where nothing but its date would change: a signature under it goes on holding."""
    kept = read_acceptance(folder)
    if kept is None or kept.record is None or result.record is None:
        return result
    dated = result.record.model_copy(update={"tested": kept.record.tested})
    return kept if result.model_copy(update={"record": dated}) == kept else result


def reaccepted(loaded: LoadedWorkflow, name: str, accept: Accept) -> tuple[str, ...]:
    """Sentences where the acceptance of a run is not the one that follows from its products now; none where there is no acceptance,
    or one of an earlier version. Raises StoreError, WorkflowError."""
    folder = loaded.run_folder
    if not (folder / ACCEPTANCE).is_file():
        return ()
    kept = read_acceptance(folder)
    again = f"write it again with: orthomill accept {name}"
    if kept is None:
        return (f"{ACCEPTANCE} cannot be read; {again}",)
    if kept.record is None:
        return ()
    return tuple(f"{line}; {again}" for line in _differences(loaded, kept, kept.record, accept))


def _differences(loaded: LoadedWorkflow, kept: AcceptanceResult, record: AcceptanceRecord, accept: Accept) -> Iterator[str]:
    folder = loaded.run_folder
    page = folder / PAGE
    if page.is_file() and page.read_bytes() != acceptance_page(kept).encode():
        yield f"{PAGE} does not follow from {ACCEPTANCE}: one of them was changed, or is of another version"
    products = KeptProducts(folder)
    for file in record.files:
        if file.path not in products.names:
            yield f"{file.path} is missing, which {ACCEPTANCE} names"
        elif digest_of_blocks(products.blocks(file.path)).sha256 != file.sha256:
            yield f"{file.path} is not the file that {ACCEPTANCE} names"
    try:
        yield from _of_clauses(loaded, kept, record, accept)
    except WorkflowError as error:
        yield f"{ACCEPTANCE} cannot be tested again: {error}"


def _of_clauses(loaded: LoadedWorkflow, kept: AcceptanceResult, record: AcceptanceRecord, accept: Accept) -> Iterator[str]:
    limits = profile_from(kept.profile, record.limits)
    facts = facts_of_run(loaded.run_folder, loaded.project.crs, area_of(limits, loaded.root))
    for was, now in _unlike(kept, accept(limits, facts, kept.delivery)):
        yield f"{ACCEPTANCE} does not follow from the products: it has '{was}', and they give '{now}'"
    if (record.statement, record.points) != (facts.statement, facts.points):
        yield f"{ACCEPTANCE} holds another test at the check points than this run"


def _unlike(kept: AcceptanceResult, found: AcceptanceResult) -> Iterator[tuple[str, str]]:
    """What differs, as it was kept and as it is found now."""
    lines = [tuple(_said(one)) for one in (kept, found)]
    for was, now in zip(*lines, strict=False):
        if was != now:
            yield was, now
    if len(lines[0]) != len(lines[1]):
        yield f"{len(lines[0])} sentences", f"{len(lines[1])}"


def _said(result: AcceptanceResult) -> Iterator[str]:
    for clause in result.clauses:
        yield f"{clause.clause}: {clause.found} (limit: {clause.limit}), {clause.outcome}"
    yield from result.findings
    yield from (words.sentence for words in result.wordings)
