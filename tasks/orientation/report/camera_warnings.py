"""What is poorly known about the cameras of a block, in plain words; of many cameras in one sentence with a list."""

from collections.abc import Iterator
from math import sqrt

from orthomill.schemas.camera import Camera
from orthomill.schemas.errors import some_of
from orthomill.schemas.findings.camera_findings import ConstantContradicted, InteriorFixed
from orthomill.schemas.orientation import ParameterCorrelation
from orthomill.tasks.adjustment.model.interior import is_guessed
from orthomill.tasks.geometry.camera_change import sensor_name
from orthomill.tasks.orientation.examined.block_facts import Facts

CHANGED = 0.06
"""A camera constant that changes by more of itself: twice what EXIF is usually wrong by"""
FAR = 0.5
"""The same of a constant that was guessed: two of its standard errors"""
# Focal planes in EXIF are those of the whole sensor, or of a rounded one: a tenth off is nothing that a block need explain.
SURE = 0.01
"""Standard error of an adjusted camera constant, in units of it, up to which a tag of EXIF says nothing against it"""


def camera_warnings(facts: Facts) -> Iterator[str]:
    """Whole sentences: parameters that cannot be told apart, cameras that were not adjusted, constants that moved far."""
    yield from _correlation_warnings(facts)
    # One sensor is one camera, however its photographs were turned.
    sensors = {sensor_name(name): name for name in reversed(facts.block.cameras)}
    cameras = {sensor: (facts.block.cameras[name], facts.given_camera(name)) for sensor, name in reversed(sensors.items())}
    yield from _unadjusted(facts, cameras)
    yield from _changed(facts, cameras)


def _correlation_warnings(facts: Facts) -> Iterator[str]:
    """One sentence for all cameras whose parameters are correlated, one for each parameter that several cameras share so, and one
    for each correlation with the flying height."""
    within: dict[str, list[str]] = {}
    across: dict[str, list[ParameterCorrelation]] = {}
    for c in facts.precision.correlations:
        # The mean height is one "of the projection centres", which no camera is called.
        (first, _, camera), (second, _, other) = c.first.partition(" of "), c.second.partition(" of ")
        if camera == other:
            within.setdefault(camera, []).append(f"{first} and {second} ({c.value:.2f})")
        elif "height" not in c.second:
            across.setdefault(first if first == second else f"{first}, {second}", []).append(c)
        # Which way is up is arbitrary in a block without datum.
        elif not facts.without_datum:
            yield _pair_sentence(c) + " Control at different heights, or oblique photographs, would separate them."
    for name, alike in across.items():
        yield _pair_sentence(alike[0]) if len(alike) == 1 else _sentence_of_cameras(name, alike)
    end = "Their values are not to be used one without the other; together they are as good as their residuals."
    if len(within) == 1:
        ((camera, pairs),) = within.items()
        yield f"Parameters of the camera {camera} can hardly be distinguished: {', '.join(pairs)}. {end}"
    elif within:
        listed = some_of(
            [f"{camera} ({', '.join(pair.replace(' (', ' ').rstrip(')') for pair in own)})" for camera, own in within.items()]
        )
        yield f"Parameters of {len(within)} cameras can hardly be distinguished: {listed}. {end}"


def _pair_sentence(c: ParameterCorrelation) -> str:
    return (
        f"{c.first} and {c.second} can hardly be distinguished (correlation {c.value:.2f}): neither value is to be used without "
        "the other."
    )


def _sentence_of_cameras(name: str, pairs: list[ParameterCorrelation]) -> str:
    """Of ten cameras over one place up to 45 pairs move together: that is one thing to know."""
    cameras = dict.fromkeys(one.partition(" of ")[2] for c in pairs for one in (c.first, c.second))
    least, most = (f"{share(abs(c.value) for c in pairs):.2f}" for share in (min, max))
    values = least if least == most else f"{least} to {most}"
    return (
        f"{name} of {len(cameras)} cameras can hardly be distinguished from each other (correlations of {values} in {len(pairs)} "
        f"pairs): no value is to be used without the others. They are {some_of(list(cameras))}."
    )


def _unadjusted(facts: Facts, cameras: dict[str, tuple[Camera, Camera]]) -> Iterator[str]:
    # Of cameras that could not be adjusted a finding of its own says so.
    said = {name for finding in facts.precision.findings if isinstance(finding, InteriorFixed) for name in finding.cameras}
    for known, guessed in (("known from EXIF only", False), ("guessed, as no tag tells its constant,", True)):
        own = [
            sensor
            for sensor, (camera, before) in cameras.items()
            if before.source == "exif" and camera.source != "block" and is_guessed(before) == guessed and camera.name not in said
        ]
        if len(own) == 1:
            yield (
                f"The camera {own[0]} is {known} and was not adjusted: heights may bend over the block. Calibrate it, or let its "
                "interior orientation take part."
            )
        elif own:
            yield (
                f"{len(own)} cameras are {known.replace('its constant', 'their constants')} and were not adjusted: heights may "
                f"bend over the block. Calibrate them, or let their interior orientations take part. They are {some_of(own)}."
            )


def _changed(facts: Facts, cameras: dict[str, tuple[Camera, Camera]]) -> Iterator[str]:
    """Adjusted camera constants that moved farther than what gave them is usually wrong; a contradicted one has its finding."""
    told = {finding.camera for finding in facts.precision.findings if isinstance(finding, ConstantContradicted)}
    moved: dict[bool, list[str]] = {False: [], True: []}
    for sensor, (camera, before) in cameras.items():
        change, guessed = camera.c / before.c - 1.0, is_guessed(before)
        if camera.source != "block" or camera.name in told or (before.source == "exif" and _is_sure(camera)):
            continue
        if abs(change) > (FAR if guessed else CHANGED):
            moved[guessed].append(f"{sensor} ({100 * change:+.1f} %)")
    for guessed, own in moved.items():
        what = "guessed, as no tag tells them" if guessed else "given"
        if own:
            yield (
                f"Adjusted camera constants are far from the ones that were {what}: {some_of(own)}. They may have absorbed other "
                "errors (a rolling shutter, wrong heights). Fix them at calibrated values to compare."
            )


def _is_sure(camera: Camera) -> bool:
    """Whether the block itself determines the camera constant."""
    return camera.covariance is not None and sqrt(camera.covariance[0][0]) < SURE * camera.c
