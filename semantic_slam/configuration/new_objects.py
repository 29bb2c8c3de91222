"""Priors of an object that a detection creates, and how well gravity holds any."""

from dataclasses import dataclass

from semantic_slam.configuration.parameter import parameter


@dataclass(frozen=True)
class NewObjectConfiguration:
    sigma_position_m: float = parameter(
        1000.0, "prior of an object created from a detection, about its first estimate", minimum=1e-3
    )
    sigma_heading_rad: float = parameter(
        3.1, "broad heading prior of an object whose model fixes no heading", minimum=1e-3
    )
    sigma_tilt_rad: float = parameter(
        0.02,
        "roll and pitch by which an object in space stands off upright, and off what its map says; gravity holds them",
        minimum=1e-6,
    )
    range_m: float = parameter(3.0, "assumed range of an object first seen without depth", minimum=1e-3)
    size_by_label: tuple[str, ...] = parameter(
        (),
        "state_space: spatial: how large what the detector calls so is, in metres, whatever the case: [cup=0.1]; beside"
        " how large its box looks, that tells how far a new object is that is seen without depth. The size is the"
        " square root of width times height",
    )
    sigma_log_size: float = parameter(
        0.4, "standard deviation of the logarithm of these sizes: things of one name differ", minimum=0.01
    )
    sigma_log_view: float = parameter(
        0.0,
        "state_space: spatial, boxes without depth, semantic_model.kind: detector: standard deviation of the logarithm"
        " of the size that a box shows beside that of its object, by how it is turned and what hides it; which object a"
        " box is of, and of what class that is, is then told by sizes, too; 0: it is not",
        minimum=0.0,
    )
