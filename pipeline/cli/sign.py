"""`orthomill sign`: a person looks at the figures of a run and signs them."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

from orthomill.pipeline.engine.run_facts import RunFacts, read_facts
from orthomill.pipeline.engine.running import titles_of
from orthomill.pipeline.records.lock import only_run
from orthomill.pipeline.records.verification import examine
from orthomill.pipeline.report.first_page import FirstPage, first_page
from orthomill.pipeline.report.present_reports import present_reports
from orthomill.pipeline.report.results import rewrite_page
from orthomill.pipeline.signing.signature import SIGNATURE, keep, sign
from orthomill.pipeline.signing.signing_key import default_key_path, new_key, read_key
from orthomill.pipeline.signing.statement import Signer, Statement, digest_of, digest_of_blocks, signed_paths
from orthomill.pipeline.storage.depots.kept_products import KeptProducts
from orthomill.pipeline.storage.store import Store
from orthomill.pipeline.workflow.workflow_checks import named_inputs
from orthomill.pipeline.workflow.workflow_file import LoadedWorkflow
from orthomill.schemas.errors import ResourceError, StoreError


@dataclass(frozen=True)
class Person:
    """What the terminal asks a person: whether the figures, which it shows, are signed, and the passphrase of the key."""

    agrees: Callable[[FirstPage], bool]
    passphrase: Callable[[], str]


def _page(loaded: LoadedWorkflow) -> tuple[FirstPage, RunFacts]:
    """The first page of the report of a finished run. Raises StoreError before the first run and while jobs are missing."""
    folder, project = loaded.run_folder, loaded.project.project
    facts = read_facts(folder)
    if facts is None:
        raise StoreError(f"{project} has not been run yet; run it first: orthomill run {project}")
    if not facts.complete:
        raise StoreError(f"{project} is not complete and cannot be signed; finish it with: orthomill run {project}")
    stages = titles_of(loaded.stages)
    return first_page(present_reports(Store(folder), stages, facts), stages, facts, folder), facts


def signing_lines(page: FirstPage) -> Iterator[str]:
    """What is looked at before it is signed."""
    yield page.headline
    yield from (f"warning: {caution.sentence}" for caution in page.cautions)
    yield from (f"{question}: {answer}" for question, answer in page.answers)
    yield from page.classes


def sign_project(loaded: LoadedWorkflow, signer: Signer, key: Path | None, person: Person) -> Path | None:
    """Sign a finished run, and show the signature in its report; returns the signature's path, None where the person declines.

    Raises StoreError where the run is not complete or its results are damaged, ResourceError where the key cannot be used or the
    project is being run.
    """
    if not signer.name.strip() or not signer.role.strip():
        raise ResourceError("A signature needs the name and the role of the person: --name 'A. Surveyor' --role 'head of survey'.")
    folder = loaded.run_folder
    page, facts = _page(loaded)
    _refuse_newer(loaded, facts)
    with only_run(folder):
        _refuse_damaged(folder, loaded.project.project)
        if not person.agrees(page):
            return None
        own = _key(key, person)
        # The page is signed as it is without a signature; the new one takes the place of an earlier one.
        (folder / SIGNATURE).unlink(missing_ok=True)
        rewrite_page(Store(folder), folder, titles_of(loaded.stages), facts)
        products = KeptProducts(folder)
        statement = Statement(
            project=loaded.project.project,
            orthomill=facts.version,
            signer=signer,
            signed=datetime.now(UTC).isoformat(timespec="seconds"),
            verdict=page.headline,
            answers=dict(page.answers),
            warnings=tuple(caution.sentence for caution in page.cautions),
            classes=page.classes,
            files={path: digest_of_blocks(products.blocks(path)) for path in signed_paths(folder)},
            inputs={path: digest_of(loaded.root / path) for path in named_inputs(loaded.project)},
        )
        path = keep(sign(statement, own), folder)
        rewrite_page(Store(folder), folder, titles_of(loaded.stages), facts)
        return path


def _refuse_newer(loaded: LoadedWorkflow, facts: RunFacts) -> None:
    """An input that was written after the run need not be the one that its results were made from."""
    if facts.finished is None:
        return
    finished, project = datetime.fromisoformat(facts.finished).timestamp(), loaded.project.project
    newer = [path for path in named_inputs(loaded.project) if (loaded.root / path).stat().st_mtime > finished]
    if newer:
        raise StoreError(
            f"{newer[0]} was written after {project} was run, and may not be what its results were made from; run it again: "
            f"orthomill run {project}"
        )


def _refuse_damaged(folder: Path, project: str) -> None:
    damaged = examine(folder).damaged
    if damaged:
        first = ", ".join(sorted(damaged)[:3])
        raise StoreError(f"{len(damaged)} results of {project} are damaged ({first}); mend them with: orthomill run {project}")


def _key(path: Path | None, person: Person) -> Ed25519PrivateKey:
    """The key of a file; without one, the person's own, which is made where there is none yet."""
    own = path or default_key_path()
    if path is None and not own.exists():
        return new_key(own)
    try:
        return read_key(own)
    except TypeError:  # it is encrypted
        return read_key(own, person.passphrase())
