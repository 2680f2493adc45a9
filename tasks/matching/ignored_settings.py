"""Settings that another setting puts out of action: changing one of them is refused instead of being ignored in silence."""

from orthomill.schemas.settings import Settings


def refuse_ignored(settings: Settings, names: tuple[str, ...], mode: str, remedy: str) -> None:
    """Raise ValueError for the settings among `names` that differ from their defaults, although `mode` ignores them."""
    # Compared with the default and not with what was set: a workflow written back by a run sets every field.
    fields = type(settings).model_fields
    changed = [name for name in names if getattr(settings, name) != fields[name].default]
    if changed:
        verb = "has" if len(changed) == 1 else "have"
        raise ValueError(f"{' and '.join(changed)} {verb} no effect with {mode}; {remedy}")
