"""Reference systems by name: plan, heights, and whether an epoch is missing."""

import pytest

from orthomill.pipeline.cli.lookups.titled_systems import system_names


@pytest.mark.parametrize(
    ("text", "plan", "height", "epoch"),
    [
        ("EPSG:2100", "GGRS87 / Greek Grid (EPSG:2100)", "", "none needed"),
        ("EPSG:7415", "Amersfoort / RD New (EPSG:28992)", "NAP height (EPSG:5709)", "none needed"),
        ("EPSG:25832+5783", "ETRS89 / UTM zone 32N (EPSG:25832)", "DHHN92 height (EPSG:5783)", "not stated; European"),
        ("EPSG:32634", "WGS 84 / UTM zone 34N (EPSG:32634)", "", "not stated; World Geodetic System 1984"),
        ("EPSG:9990", "ITRF2020 (EPSG:9990)", "", "not stated; coordinates move in this frame"),
        ("a site of our own", "a site of our own", "", ""),
    ],
)
def test_a_system_is_told_by_its_names(text, plan, height, epoch):
    found = system_names(text)
    assert found.plan == plan and found.height == height and found.epoch.startswith(epoch)
