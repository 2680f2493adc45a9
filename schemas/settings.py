"""How a setting is declared: type, default, bounds, unit and one sentence, all on the field itself.

Error messages, the settings reference and the commented starting workflow are generated from these fields, so that no parameter is
described twice.
"""

from typing import Any

from pydantic import BaseModel, ConfigDict, Field


class Settings(BaseModel):
    """Base of everything that a workflow file can contain: frozen, and closed against unknown names."""

    # NaN passes every comparison with a bound; a setting that is not a number must fail here and not in a kernel.
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


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
