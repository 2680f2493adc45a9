"""How a setting is declared: type, default, bounds, unit and one sentence, all on the field itself.

Error messages, the settings reference and the commented starting workflow are generated from these fields, so that no parameter is
described twice.
"""

import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

from pydantic import BaseModel, ConfigDict, Field, ValidationInfo, model_validator


@dataclass(frozen=True)
class RenamedSetting:
    """A setting that was given under its former name in the mapping `given`."""

    former: str
    present: str
    given: dict[str, Any]

    @property
    def sentence(self) -> str:
        """What the user is to do."""
        return f"is called '{self.present}' now; the old name works in this version, and is refused in the next."


class RenamedSettings(list[RenamedSetting]):
    """Pass one as `context` of a validation to learn which settings were given under former names; otherwise Python warns."""


class Settings(BaseModel):
    """Base of everything that a workflow file can contain: frozen, and closed against unknown names.

    `renamed`: present names of settings by those that they had in the version before, which are taken and reported.
    """

    renamed: ClassVar[Mapping[str, str]] = {}

    # NaN passes every comparison with a bound; a setting that is not a number must fail here and not in a kernel.
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    @model_validator(mode="before")
    @classmethod
    def _take_former_names(cls, given: Any, info: ValidationInfo) -> Any:
        if not isinstance(given, dict) or cls.renamed.keys().isdisjoint(given):
            return given
        for former in [name for name in given if name in cls.renamed]:
            found = RenamedSetting(former, cls.renamed[former], given)
            if found.present in given:
                raise ValueError(f"'{former}' is called '{found.present}' now, and both are set; remove '{former}'.")
            if isinstance(info.context, RenamedSettings):
                info.context.append(found)
            else:
                warnings.warn(f"{cls.__name__}: {former} {found.sentence}", FutureWarning, stacklevel=2)
        return {cls.renamed.get(name, name): value for name, value in given.items()}


def setting(default: Any = ..., sentence: str = "", unit: str = "", **bounds: Any) -> Any:
    """A field with its unit and its sentence.

    `unit` is empty for names, choices and pure numbers; `bounds` are pydantic's (ge, gt, le, lt, min_length, ...).
    """
    return Field(default, description=sentence, json_schema_extra={"unit": unit}, **bounds)


def refuse_ignored(settings: Settings, names: tuple[str, ...], mode: str, remedy: str) -> None:
    """Raise ValueError for the settings among `names` that differ from their defaults, although `mode` ignores them."""
    # Compared with the default and not with what was set: a workflow written back by a run sets every field.
    fields = type(settings).model_fields
    changed = [name for name in names if getattr(settings, name) != fields[name].default]
    if changed:
        named = " and ".join(filter(None, [", ".join(changed[:-1]), changed[-1]]))
        raise ValueError(f"{named} {'has' if len(changed) == 1 else 'have'} no effect with {mode}; {remedy}")
