"""What `orthomill verify` and the report say of a signature."""

from collections.abc import Iterator

from orthomill.pipeline.signing.signature import SignatureCheck

SHOWN = 10
"""files that are named"""


def signature_lines(check: SignatureCheck) -> Iterator[str]:
    """Whether a signature holds, and if not, what has become of the files."""
    statement = check.signature.statement
    who = f"{statement.signer.name}, {statement.signer.role}"
    if not check.signature.is_genuine:
        yield f"the signature of {who} is not genuine: the statement was changed after it was signed"
        return
    for paths, what in (
        (check.changed, "has changed since"),
        (check.missing, "is missing"),
        (check.added, "was made later"),
        (check.inputs, "is not the file any more that the results were made from"),
    ):
        yield from (f"{path} {what}" for path in paths[:SHOWN])
        if len(paths) > SHOWN:
            yield f"... and {len(paths) - SHOWN} more"
    state = "holds" if check.holds else "no longer belongs to these results"
    yield f"the signature of {who}, {statement.signed}, {state}; key {check.signature.fingerprint}"
