"""Whether this machine can render, and why not."""

import pytest
from semantic_slam_lab.simulation.furniture import MODELS
from semantic_slam_lab.simulation.mujoco_scene import PlacedObject, scene_xml
from semantic_slam_lab.simulation.renderer import Renderer, RenderingError, camera_model


def skip_unless_rendering_works() -> None:
    """Render one picture; skip with the renderer's own reason when neither EGL nor OSMesa works."""
    placed = PlacedObject(1, "crate_1", next(iter(MODELS)), 0.0, 0.0, 0.0)
    try:
        with Renderer(*scene_xml([placed], None), camera_model(32, 24, 1.0)):
            pass
    except RenderingError as fault:
        pytest.skip(str(fault))
