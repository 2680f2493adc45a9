"""Findings as sentences: those of many cameras or photographs at once in one, with a list."""

from collections.abc import Iterator, Sequence

from orthomill.schemas.findings.block_findings import BlockFinding
from orthomill.schemas.findings.finding import SpokenFinding


def finding_sentences(findings: Sequence[BlockFinding]) -> Iterator[str]:
    """The findings as whole sentences in their order; those that are alike are one."""
    kinds: dict[str, list[SpokenFinding]] = {}
    for number, finding in enumerate(findings):
        kinds.setdefault(finding.alike or str(number), []).append(finding)
    for own in kinds.values():
        yield own[0].sentence if len(own) == 1 else type(own[0]).of_many(own)
