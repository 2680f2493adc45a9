"""Settings under the names that they had in the version before: taken, told once, refused where both names are set."""

from typing import ClassVar

import pytest
from pydantic import ValidationError

from orthomill.schemas.settings import RenamedSettings, Settings, setting
from orthomill.tasks.catalogue import STAGES


class Inner(Settings):
    """Below another setting."""

    renamed: ClassVar = {"old": "new"}
    new: float = setting(1.0, "A number.", ge=0.0)
    other: float = setting(2.0, "Another one.")


class Outer(Settings):
    """With a renamed setting below a renamed one."""

    renamed: ClassVar = {"before": "after"}
    after: Inner = setting(Inner(), "Settings.")


def test_former_names_are_taken_and_recorded():
    renamed = RenamedSettings()
    found = Outer.model_validate({"before": {"old": 3.0, "other": 4.0}}, context=renamed)
    assert found == Outer(after=Inner(new=3.0, other=4.0))
    assert [(one.former, one.present) for one in renamed] == [("before", "after"), ("old", "new")]


def test_without_a_context_python_warns():
    with pytest.warns(FutureWarning, match="old is called 'new' now"):
        assert Inner.model_validate({"old": 3.0}).new == 3.0


def test_present_names_are_silent():
    renamed = RenamedSettings()
    assert Outer.model_validate({"after": {"new": 3.0}}, context=renamed).after.new == 3.0 and not renamed


@pytest.mark.parametrize(("given", "phrase"), [({"old": 1, "new": 2}, "both are set"), ({"old": -1}, "greater than or equal to 0")])
def test_both_names_and_wrong_values_are_refused(given, phrase):
    with pytest.raises(ValidationError, match=phrase):
        Inner.model_validate(given, context=RenamedSettings())


def _below(kind: type[Settings]) -> set[type[Settings]]:
    return {kind}.union(*(_below(sub) for sub in kind.__subclasses__()))


def test_every_former_name_leads_to_a_setting_and_is_none_itself():
    assert STAGES  # the catalogue brings all settings
    for kind in _below(Settings):
        for former, present in kind.renamed.items():
            assert present in kind.model_fields and former not in kind.model_fields, (kind, former)
