"""Every setting that a workflow can hold is set by some test. Whether that test would notice is for its author to see to."""

import importlib
import pkgutil
import re
from collections.abc import Iterator
from pathlib import Path

import orthomill.schemas
import orthomill.tasks
from orthomill.schemas.settings import Settings

HERE = Path(__file__).parent


def settings_models() -> Iterator[type[Settings]]:
    for package in (orthomill.schemas, orthomill.tasks):
        for module in pkgutil.walk_packages(package.__path__, f"{package.__name__}."):
            importlib.import_module(module.name)
    waiting = [Settings]
    while waiting:
        for model in waiting.pop().__subclasses__():
            waiting.append(model)
            if model.__module__.startswith(("orthomill.schemas", "orthomill.tasks")):
                yield model


def own_settings() -> list[tuple[str, str]]:
    fields = {(model.__name__, name) for model in settings_models() for name in model.model_fields if name in model.__annotations__}
    return sorted((model, name) for model, name in fields if name != "kind")


def names_that_are_set() -> set[str]:
    """Whatever is set in the text of a test: as an argument, as a key, or in YAML."""
    text = "\n".join(path.read_text() for path in HERE.rglob("*.py") if path.name != Path(__file__).name)
    return {*re.findall(r"\b(\w+)=(?!=)", text), *re.findall(r"[\"'](\w+)[\"']\s*:", text), *re.findall(r"\b(\w+): ", text)}


def test_every_setting_is_set_by_a_test():
    found = names_that_are_set()
    missing = [f"{model}.{name}" for model, name in own_settings() if name not in found]
    assert not missing, f"set by no test: {', '.join(missing)}"
