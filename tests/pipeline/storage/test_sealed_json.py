"""JSON with a seal: every changed byte is noticed, and files without one are taken as they are."""

import json

import pytest
from pydantic import BaseModel, RootModel

from orthomill.pipeline.storage.depots.folder import Folder
from orthomill.pipeline.storage.sealed_json import seal, unsealed
from orthomill.pipeline.storage.tables.table_files import read_table, write_table
from orthomill.schemas.errors import StoreError
from orthomill.schemas.job import Table


class Point(BaseModel, extra="forbid"):
    x: float
    name: str = "a"


class Nothing(BaseModel): ...


class Numbers(RootModel[list[int]]): ...


@pytest.mark.parametrize("text", [b'{"x":1}', b'{\n "x": 1,\n "y": {"seal":"0"}\n}'])
def test_a_sealed_text_is_json_and_comes_back(text):
    assert unsealed(seal(text)) == text
    assert json.loads(seal(text)).keys() == {*json.loads(text), "seal"}


@pytest.mark.parametrize("text", [b"{}", b"[]", b"[{}]", b"{\n}", b"3"])
def test_what_cannot_hold_a_seal_has_none(text):
    assert seal(text) == text == unsealed(text)


def test_any_changed_byte_of_a_table_is_noticed(tmp_path):
    path, table = tmp_path / "p.json", Table("p.json", Point)
    write_table(Folder(path.parent), path.name, Point(x=12345.678))
    content = path.read_bytes()
    assert read_table(Folder(path.parent), path.name, table) == Point(x=12345.678)
    for at in range(len(content)):
        path.write_bytes(content[:at] + bytes([content[at] ^ 1]) + content[at + 1 :])
        with pytest.raises(StoreError, match=r"p\.json is damaged or from another version"):
            read_table(Folder(path.parent), path.name, table)


@pytest.mark.parametrize("value", [Nothing(), Numbers([1, 2])])
def test_tables_without_a_seal_are_read(tmp_path, value):
    write_table(Folder(tmp_path), "v.json", value)
    assert read_table(Folder(tmp_path), "v.json", Table("v.json", type(value))) == value
    (tmp_path / "p.json").write_text('{"x": 2}')
    assert read_table(Folder(tmp_path), "p.json", Table("p.json", Point)).x == 2
