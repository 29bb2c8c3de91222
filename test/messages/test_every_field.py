"""Every field of every dataclass that travels crosses the wire, whatever fields it will have.

Values are made from the annotations and the layouts alone, and none is its field's default: a field that no codec
carries comes back as its default, or not at all.
"""

from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
import pytest
from worlds.distinct_values import SIZES, of
from worlds.same_values import assert_same

from semantic_slam.inference.belief import HybridBelief
from semantic_slam.inference.keyframe import Keyframe
from semantic_slam.inference.object_table import OPTIONAL, QUANTITIES
from semantic_slam.inference.protocol import Components
from semantic_slam.messages.codec import CODECS, decode, encode, from_message, to_message
from semantic_slam.messages.layout import element_types
from semantic_slam.messages.typestore import DEFINITIONS

CARRIERS = sorted(CODECS, key=lambda kind: kind.__name__)


def sent_and_received(value: Any) -> Any:
    if type(value) is Keyframe:  # its run's id travels beside it
        return from_message(to_message(value, run_id="run"))
    return decode(encode(value), CODECS[type(value)].type_name)


@pytest.mark.parametrize("kind", CARRIERS, ids=lambda kind: kind.__name__)
def test_every_field_crosses_the_wire(kind: type) -> None:
    value = of(kind)
    assert_same(sent_and_received(value), value)


@pytest.mark.parametrize("kind", CARRIERS, ids=lambda kind: kind.__name__)
def test_no_value_is_its_fields_default(kind: type) -> None:
    value = of(kind)
    for item in fields(kind):
        found = getattr(value, item.name)
        assert np.size(found) and (not isinstance(found, bool | int | float | str) or found != item.default), item.name


def test_a_field_that_no_codec_carries_is_noticed() -> None:
    @dataclass(frozen=True, kw_only=True)
    class Longer(HybridBelief):
        temperature: float = 0.0

    longer = Longer(**vars(of(HybridBelief)), temperature=3.0)
    received = from_message(CODECS[HybridBelief].to_message(longer))
    with pytest.raises(AssertionError, match="temperature"):
        assert_same(Longer(**vars(received)), longer)


OUR_TYPES = sorted({codec.type_name for codec in CODECS.values() if codec.type_name.startswith("semantic_slam_msgs")})


@pytest.mark.parametrize("type_name", OUR_TYPES)
def test_every_array_of_a_message_has_a_layout(type_name: str) -> None:
    (codec,) = (codec for codec in CODECS.values() if codec.type_name == type_name)
    assert {*element_types(type_name)} == {*codec.layout}


def test_every_message_that_is_defined_has_a_codec() -> None:
    assert {f"semantic_slam_msgs/msg/{path.stem}" for path in DEFINITIONS.glob("*.msg")} == {*OUR_TYPES}


@pytest.mark.parametrize("kind", [Components, HybridBelief])
def test_nothing_is_told_per_object_but_the_quantities_of_the_object_table(kind: type) -> None:
    layout = CODECS[kind].layout
    others = {"object_ids", "object_names", "hypothesis_class_probabilities"}
    assert {name for name, shape in layout.items() if "O" in shape} - others == {*QUANTITIES}


def test_what_is_not_given_is_nan_here_and_has_no_values_on_the_wire() -> None:
    given = of(HybridBelief)
    nothing = {name: np.zeros(0) for name in (*OPTIONAL, "outlier_probability", "association_probabilities")}
    value = replace(given, **nothing)
    assert value.object_velocities.shape == (SIZES["O"], 6) and np.isnan(value.object_velocities).all()
    assert value.association_probabilities.shape == (SIZES["D"], SIZES["O"] + 1)
    message = to_message(value)
    assert all(not len(getattr(message, name)) for name in nothing)
    assert_same(sent_and_received(value), value)


def test_one_value_among_those_not_given_brings_the_whole_array() -> None:
    value = of(HybridBelief)
    moving = np.full(SIZES["O"], np.nan)
    moving[1] = 0.25
    assert_same(sent_and_received(replace(value, moving=moving)), replace(value, moving=moving))
