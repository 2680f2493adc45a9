"""The settings of colours: what they become, the same in every stage that colours a surface."""

import pytest

from orthomill.tasks.colouring.blending.blending import Blend
from orthomill.tasks.colouring.blending.colour_rules import colour_rules_of
from orthomill.tasks.colouring.blending.rejection import Rejection
from orthomill.tasks.colouring.colour_settings import SAMPLES_AT_MOST, ColourSettings
from orthomill.tasks.colouring.plan.balance_jobs import balance_job
from orthomill.tasks.projection.stage import ProjectionStage
from orthomill.tasks.texture.stage import TextureStage

OWN = {"two_colours", "best"}
"""whose choices and defaults differ"""


def test_both_stages_have_the_settings_of_colours():
    for stage in (TextureStage, ProjectionStage):
        for name, field in ColourSettings.model_fields.items():
            own = stage.model_fields[name]
            assert name in OWN or (own.default, own.description) == (field.default, field.description)
        assert next(iter(stage.model_fields)) == "kind"


@pytest.mark.parametrize(
    ("given", "rules"),
    [
        ({}, Blend(Rejection("mean", 1.0, 12.0))),
        ({"weights": {"kind": "area_squared"}, "best": 3}, Blend(Rejection("mean", 1.0, 12.0), power=2, best=3)),
        ({"rejection": {"kind": "none"}}, Blend(Rejection("none"))),
        ({"rejection": {"kind": "robust", "k": 2.5}}, Blend(Rejection("deviation", 2.5, 12.0))),
        ({"two_colours": {"kind": "prefer", "limit": 20.0}}, Blend(Rejection("mean", 1.0, 12.0), two_limit=20.0)),
    ],
)
def test_settings_become_rules(given, rules):
    assert colour_rules_of(ColourSettings.model_validate(given)).blend == rules


def test_breaks_and_the_finest_photographs_are_chosen_by_name():
    found = colour_rules_of(ColourSettings.model_validate({"two_colours": {"kind": "depth_break"}, "best": "auto", "feather": 0.3}))
    assert found.breaks and found.finest and found.blend.best == 0 and found.feather == 0.3
    plain = colour_rules_of(ColourSettings())
    assert not plain.breaks and not plain.finest


@pytest.mark.parametrize(("balance", "spacing"), [({"kind": "block", "spacing": 10}, 10), ({"kind": "none"}, 64)])
def test_samples_are_as_far_apart_as_asked_and_no_more_than_a_balance_can_take(balance, spacing):
    settings = ColourSettings.model_validate({"balance": balance})
    assert settings.sample_spacing(1000) == spacing
    many = settings.sample_spacing(10**9)
    assert 10**9 / many**2 <= SAMPLES_AT_MOST < 10**9 / (many - 1) ** 2


@pytest.mark.parametrize(
    ("balance", "dtypes", "params"),
    [
        ({"kind": "block"}, ("uint8", "uint8"), {"deep": False, "method": "block", "vignetting": True}),
        ({"kind": "block", "vignetting": False}, ("uint8", "uint16"), {"deep": True, "method": "block", "vignetting": False}),
        ({"kind": "histogram"}, ("uint8",), {"deep": False, "method": "histogram", "vignetting": False}),
    ],
)
def test_the_job_of_the_balance(balance, dtypes, params):
    job = balance_job("texture", ColourSettings.model_validate({"balance": balance}), ("a", "b"), dtypes, ())
    assert job.params == params and job.writes["radiometry"].path == "texture/radiometry.json"
