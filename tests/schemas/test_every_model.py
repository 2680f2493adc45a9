"""Every model of the schemas, whatever it is about: a frozen value with a docstring that survives being stored."""

import importlib
import pkgutil

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from pydantic import BaseModel, ValidationError

import orthomill.schemas
from orthomill.schemas.settings import Settings
from orthomill.schemas.stage_contract import Stage

for module in pkgutil.walk_packages(orthomill.schemas.__path__, "orthomill.schemas."):
    importlib.import_module(module.name)


def below(base: type) -> set[type]:
    return {model for kind in base.__subclasses__() for model in {kind, *below(kind)}}


def of_schemas(model: type) -> bool:
    return (
        model.__module__.startswith("orthomill.schemas.") and not model.__name__.startswith("_") and model not in (Settings, Stage)
    )


MODELS = sorted(filter(of_schemas, below(BaseModel)), key=lambda model: model.__name__)
LARGE = "SeparateBlocks"  # a tuple of Block, which is tried by itself
STORED = [model for model in MODELS if not issubclass(model, Settings) and model.__name__ != LARGE]


@pytest.fixture(autouse=True, scope="module")
def small_values():
    """Finite numbers and short texts, in this module only."""
    usual = {float: st.floats(), int: st.integers(), str: st.text()}
    small = {float: st.floats(-1e6, 1e6), int: st.integers(-1000, 1000), str: st.text("abc_/ .é", max_size=6)}
    for kind, strategy in small.items():
        st.register_type_strategy(kind, strategy)
    yield
    for kind, strategy in usual.items():
        st.register_type_strategy(kind, strategy)


@settings(max_examples=8, deadline=None, suppress_health_check=list(HealthCheck))
@given(data=st.data())
@pytest.mark.parametrize("model", STORED, ids=lambda model: model.__name__)
def test_a_model_survives_being_stored(model, data):
    """Whatever its fields hold: written as JSON and read again, it is the same value."""
    fields = {name: st.from_type(field.annotation) for name, field in model.model_fields.items()}
    try:
        one = model(**{name: data.draw(strategy, label=name) for name, strategy in fields.items()})
    except ValidationError:  # the bounds of single fields are not part of their types
        return
    again = model.model_validate_json(one.model_dump_json())
    assert again == one and again.model_dump_json() == one.model_dump_json()


@pytest.mark.parametrize("model", MODELS, ids=lambda model: model.__name__)
def test_a_model_is_frozen_and_says_what_it_is(model):
    assert model.model_config.get("frozen"), f"{model.__name__} can be changed behind the back of whoever holds it"
    assert model.__dict__.get("__doc__"), f"{model.__name__} has no docstring"
