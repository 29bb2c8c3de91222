"""Views of one object of the catalogue from any directions, rendered into memory."""

from collections.abc import Iterator

import numpy as np

from semantic_slam.training.views import ObjectView, cut_out
from semantic_slam.viewpoint.model import Viewpoints
from semantic_slam_lab.simulation.catalogue import model_named
from semantic_slam_lab.simulation.mujoco_scene import PlacedObject, scene_xml
from semantic_slam_lab.simulation.renderer import Renderer, camera_model
from semantic_slam_lab.simulation.turntable import TurntableCamera, TurntableSettings, table_from_camera


def orbit_views(name: str, viewpoints: Viewpoints) -> Iterator[ObjectView]:
    """The object as a camera that looks at its centre sees it from each of (B,) viewpoints, alone, nothing beside it.

    Raises KeyError when the catalogue has no such object.
    """
    settings = TurntableSettings()
    xml, assets = scene_xml([PlacedObject(1, name, name, 0.0, 0.0, 0.0)], room=None)
    world_from_table = np.eye(4)
    world_from_table[2, 3] = model_named(name).size[2] / 2.0
    intrinsics = camera_model(settings.width, settings.height, settings.horizontal_fov_rad)
    rows = zip(viewpoints.azimuth_rad, viewpoints.elevation_rad, viewpoints.range_m, strict=True)
    with Renderer(xml, assets, intrinsics) as renderer:
        for azimuth, elevation, range_m in rows:
            camera = TurntableCamera("", float(range_m), float(elevation))
            view = renderer.render(world_from_table @ table_from_camera(camera, float(azimuth)))
            cutout, mask = cut_out(view.image, view.body_ids == 1)
            yield ObjectView(name, float(azimuth), float(elevation), float(range_m), cutout, mask)
