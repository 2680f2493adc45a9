"""Signatures: what they cover, what breaks them, and keys that cannot be used."""

import json
import os
import stat

import pytest
from cryptography.hazmat.primitives.asymmetric.ec import SECP256R1, generate_private_key
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from cryptography.hazmat.primitives.serialization import BestAvailableEncryption, Encoding, NoEncryption, PrivateFormat
from hypothesis import given, settings
from hypothesis import strategies as st

from orthomill.pipeline.report.page_template import page_template
from orthomill.pipeline.report.signed_page import covered_page, signed_part
from orthomill.pipeline.signing.product_classes import product_classes
from orthomill.pipeline.signing.signature import SIGNATURE, check_signature, keep, read_signature, sign
from orthomill.pipeline.signing.signature_lines import SHOWN, signature_lines
from orthomill.pipeline.signing.signing_key import default_key_path, fingerprint, new_key, public_bytes, read_key
from orthomill.pipeline.signing.statement import Signer, Statement, digest_of, signed_paths
from orthomill.schemas.accuracy.acceptance import AcceptanceResult
from orthomill.schemas.accuracy.accuracy_statement import class_of
from orthomill.schemas.errors import ResourceError, StoreError
from orthomill.schemas.project import Tolerances
from orthomill.schemas.stage_report import Evidence, Product, StageReport

KEY = Ed25519PrivateKey.from_private_bytes(bytes(range(32)))


def statement(folder, **changes) -> Statement:
    given = {
        "project": "site",
        "orthomill": "0.1.0",
        "signer": Signer(name="A. Surveyor", role="licensed", remarks="weak in the wood"),
        "signed": "2026-11-22T12:00:00+00:00",
        "verdict": "Good: nothing puts the results in doubt.",
        "answers": {"Ground pixel": "5 cm"},
        "warnings": ("few points",),
        "files": {path: digest_of(folder / path) for path in signed_paths(folder)},
    }
    return Statement(**(given | changes))


def checked(folder):
    return check_signature(folder, covered_page)


@pytest.fixture
def folder(tmp_path):
    """A run with two products, one of them in a folder, and its figures."""
    (tmp_path / "products" / "points").mkdir(parents=True)
    (tmp_path / "products" / "dsm.tif").write_bytes(b"heights" * 1000)
    (tmp_path / "products" / "points" / "0-0.laz").write_bytes(b"points")
    (tmp_path / "summary.json").write_text("{}")
    (tmp_path / "workflow.yaml").write_text("project: site\n")
    (tmp_path / "report.html").write_text("the report")
    return tmp_path


@pytest.fixture
def signed(folder):
    keep(sign(statement(folder), KEY), folder)
    return folder


def test_products_figures_and_workflow_are_covered(folder):
    assert list(signed_paths(folder)) == [
        "products/dsm.tif",
        "products/points/0-0.laz",
        "report.html",
        "summary.json",
        "workflow.yaml",
    ]


def test_a_signature_holds_while_nothing_changes(signed):
    check = checked(signed)
    assert check.holds and check.signature.fingerprint == fingerprint(public_bytes(KEY))
    (line,) = signature_lines(check)
    assert line.startswith("the signature of A. Surveyor, licensed, 2026-11-22T12:00:00+00:00, holds; key ")


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (lambda run: (run / "products" / "dsm.tif").write_bytes(b"Heights" * 1000), "products/dsm.tif has changed since"),
        (lambda run: (run / "summary.json").write_text("{ }"), "summary.json has changed since"),
        (lambda run: (run / "products" / "points" / "0-0.laz").unlink(), "products/points/0-0.laz is missing"),
        (lambda run: (run / "products" / "new.tif").write_bytes(b"new"), "products/new.tif was made later"),
    ],
)
def test_a_file_that_is_not_as_it_was_signed_is_named(signed, spoil, said):
    spoil(signed)
    check = checked(signed)
    first, last = signature_lines(check)
    assert not check.holds and first == said and "no longer belongs to these results" in last


def test_the_files_that_results_were_made_from_are_signed_as_well(tmp_path):
    folder, control = tmp_path / "runs" / "site", tmp_path / "control.csv"
    folder.mkdir(parents=True)
    control.write_text("P1,check,1,2,3")
    keep(sign(statement(folder, inputs={"control.csv": digest_of(control)}), KEY), folder)
    assert checked(folder).holds
    control.write_text("P1,check,1,2,4")
    first, _ = signature_lines(checked(folder))
    assert first == "control.csv is not the file any more that the results were made from"
    control.unlink()
    assert not checked(folder).holds


@pytest.mark.parametrize("form", [1, 2])
def test_signatures_of_earlier_formats_hold(folder, form):
    made = statement(folder, format=form, classes=("dsm: 5 cm",) if form == 2 else ())
    keep(sign(made, KEY), folder)
    assert checked(folder).holds and b"inputs" not in made.canonical()


def shown(folder, *parts):
    """The report with parts added to it as the page adds them."""
    macros = page_template("parts.html").module
    texts = [macros.signature_part(signed_part(folder)), *(macros.acceptance_part(part) for part in parts)]
    (folder / "report.html").write_text("the " + "".join(map(str, texts)) + "report")


ACCEPTED = AcceptanceResult(profile="custom", delivery="site", clauses=())


def test_the_report_is_signed_without_the_signature_and_the_acceptance_that_it_shows_later(signed):
    shown(signed)
    assert "Signed by <b>A. Surveyor" in (signed / "report.html").read_text() and checked(signed).holds
    (signed / "acceptance.json").write_text(ACCEPTED.model_dump_json())
    shown(signed, ACCEPTED)
    assert checked(signed).holds and not checked(signed).added


@pytest.mark.parametrize(("was", "now"), [("licensed", "chief"), ("the ", "their "), ("</section>", "accurate to 1 cm</section>")])
def test_a_word_that_was_changed_in_the_report_or_its_signature_is_found(signed, was, now):
    shown(signed)
    text = (signed / "report.html").read_text()
    (signed / "report.html").write_text(text.replace(was, now, 1))
    first, _ = signature_lines(checked(signed))
    assert first == "report.html has changed since"
    assert signed_part(signed).holds, "the page does not doubt itself, or it could never be written again"
    (signed / "report.html").unlink()
    assert checked(signed).missing == ("report.html",) and signed_part(signed).holds


def test_an_acceptance_that_was_there_is_signed_too(folder):
    (folder / "acceptance.json").write_text(ACCEPTED.model_dump_json())
    keep(sign(statement(folder), KEY), folder)
    assert checked(folder).holds
    (folder / "acceptance.json").write_text(ACCEPTED.model_copy(update={"delivery": "other"}).model_dump_json())
    assert checked(folder).changed == ("acceptance.json",)


def test_of_many_changed_files_the_first_are_named(signed):
    for k in range(SHOWN + 3):
        (signed / "products" / f"{k:02}.tif").write_bytes(b"")
    lines = list(signature_lines(checked(signed)))
    assert len(lines) == SHOWN + 2 and lines[SHOWN] == "... and 3 more"


@settings(max_examples=40, deadline=None)
@given(where=st.integers(0, 10**6), bit=st.integers(0, 7))
def test_no_bit_of_statement_key_or_signature_can_be_changed(tmp_path_factory, where, bit):
    folder = tmp_path_factory.mktemp("run")
    (folder / "products").mkdir()
    original = sign(statement(folder), KEY)
    text = bytearray(original.model_dump_json().encode())
    text[where % len(text)] ^= 1 << bit
    (folder / SIGNATURE).write_bytes(bytes(text))
    try:
        found = read_signature(folder)
    except StoreError as error:
        assert "sign again" in str(error)
        return
    # Hexadecimal digits mean the same in upper case.
    same = found.public_key.lower() == original.public_key and found.signature.lower() == original.signature
    assert not found.is_genuine or (same and found.statement == original.statement)


def test_a_statement_changed_after_it_was_signed_is_not_genuine(signed):
    record = json.loads((signed / SIGNATURE).read_text())
    record["statement"]["answers"]["Ground pixel"] = "1 cm"
    (signed / SIGNATURE).write_text(json.dumps(record))
    check = checked(signed)
    assert not check.holds
    assert list(signature_lines(check)) == [
        "the signature of A. Surveyor, licensed is not genuine: the statement was changed after it was signed"
    ]


def test_without_a_signature_there_is_nothing_to_check(folder):
    assert checked(folder) is None


def test_a_new_key_is_private_and_never_replaced(tmp_path):
    path = tmp_path / "settings" / "key.pem"
    made = new_key(path)
    assert public_bytes(read_key(path)) == public_bytes(made)
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    with pytest.raises(ResourceError, match="cannot be written"):
        new_key(path)
    assert public_bytes(read_key(path)) == public_bytes(made)


def test_a_key_that_others_can_read_is_refused_with_what_to_do(tmp_path):
    new_key(tmp_path / "key.pem")
    os.chmod(tmp_path / "key.pem", 0o644)
    with pytest.raises(ResourceError, match="chmod 600"):
        read_key(tmp_path / "key.pem")


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"no key", "is no signing key"),
        (
            generate_private_key(SECP256R1()).private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption()),
            "a key of another kind",
        ),
    ],
)
def test_what_is_no_signing_key_is_refused(tmp_path, content, said):
    path = tmp_path / "key.pem"
    path.write_bytes(content)
    path.chmod(0o600)
    with pytest.raises(ResourceError, match=said):
        read_key(path)
    with pytest.raises(ResourceError, match="cannot be read"):
        read_key(tmp_path / "absent.pem")


def test_an_encrypted_key_needs_its_passphrase(tmp_path):
    path = tmp_path / "key.pem"
    path.write_bytes(KEY.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, BestAvailableEncryption(b"open")))
    path.chmod(0o600)
    with pytest.raises(TypeError):
        read_key(path)
    with pytest.raises(ResourceError, match="passphrase is wrong"):
        read_key(path, "shut")
    assert public_bytes(read_key(path, "open")) == public_bytes(KEY)


def test_the_key_of_a_person_is_among_the_settings(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    assert default_key_path() == tmp_path / "orthomill" / "signing_key.pem"
    monkeypatch.delenv("XDG_CONFIG_HOME")
    assert default_key_path().parts[-3:] == (".config", "orthomill", "signing_key.pem")


def test_every_product_has_its_classes_by_source(folder):
    reports = {
        "orientation": StageReport(
            evidence=(
                Evidence(of="plan", rmse=0.281, source="from 8 check points"),
                Evidence(of="height", rmse=0.29, source="from 8 check points"),
            )
        ),
        "densification": StageReport(
            products=(
                Product(path="products/dsm.tif", purpose="heights", classed=("plan", "height")),
                Product(path="products/none.tif", purpose="was not made", classed=("height",)),
            )
        ),
        "dsm_check": StageReport(
            products=(Product(path="products/points", purpose="points", classed=("height",)),),
            evidence=(Evidence(of="height", rmse=0.031, source="by the check", independent=False, products=("products/dsm.tif",)),),
        ),
    }
    assert list(product_classes(reports, folder, Tolerances())) == [
        "products/dsm.tif: 29-cm horizontal class (ASPRS 2023) from 8 check points",
        "products/dsm.tif: 29-cm vertical class (ASPRS 2023) from 8 check points",
        "products/dsm.tif: it and the photographs agree to 0.031 m by the check; what both share is not seen, and no class follows",
        "products/points: 29-cm vertical class (ASPRS 2023) from 8 check points",
    ]
    alone = {"densification": reports["densification"]}
    assert all("nothing independent tells its accuracy" in line for line in product_classes(alone, folder, Tolerances()))


def test_agreement_with_the_photographs_gives_no_class(folder):
    """A surface that is bent by a metre agrees to centimetres with the photographs that bent it."""
    agreement = Evidence(of="height", rmse=0.031, source="by the check", independent=False)
    product = Product(path="products/dsm.tif", purpose="heights", classed=("height",))
    reports = {"densification": StageReport(products=(product,), evidence=(agreement,))}
    assert not any("-cm" in line for line in product_classes(reports, folder, Tolerances()))
    kept, none = product_classes(reports, folder, Tolerances(height=0.1))
    assert "no class follows" in kept and "keeps" not in kept
    assert none.endswith("nothing independent tells its accuracy, nor whether it keeps the 0.1 m that are allowed")
    assert "breaks the 0.02 m" in next(product_classes(reports, folder, Tolerances(height=0.02)))


def test_every_product_is_held_against_what_the_survey_allows_by_each_source(folder):
    evidence = (
        Evidence(of="height", rmse=0.29, source="from 8 check points"),
        Evidence(of="height", rmse=0.031, source="by laser"),
    )
    product = Product(path="products/dsm.tif", purpose="heights", classed=("plan", "height"))
    reports = {"densification": StageReport(products=(product,), evidence=evidence)}
    plan, points, check = product_classes(reports, folder, Tolerances(plan=0.2, height=0.1))
    assert plan.endswith("nothing independent tells its accuracy, nor whether it keeps the 0.2 m that are allowed")
    assert points.endswith("from 8 check points; its RMSE of 0.290 m breaks the 0.1 m that are allowed")
    assert check.endswith("by laser; its RMSE of 0.031 m keeps the 0.1 m that are allowed")


def test_a_statement_of_an_earlier_version_is_still_genuine(folder):
    old = statement(folder, format=1)
    assert b"classes" not in old.canonical() and sign(old, KEY).is_genuine
    assert not sign(statement(folder), KEY).model_copy(update={"statement": statement(folder, classes=("x",))}).is_genuine


@pytest.mark.parametrize(("rmse", "centimetres"), [(0.29, 29), (0.2901, 30), (0.0004, 1), (1.0, 100)])
def test_a_class_is_the_least_whole_centimetre_that_is_kept(rmse, centimetres):
    assert class_of(rmse) == centimetres
