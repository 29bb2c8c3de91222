"""Look-alike query: ranks the objects of a belief by similarity to an image, in the belief's latent space."""

from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np

from semantic_slam.class_models.latent_space import load_extractor, load_latent_model
from semantic_slam.configuration import SemanticModelConfiguration
from semantic_slam.errors import InputError
from semantic_slam.geometry.arrays import Array, Bytes
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.inference.lookalike import ELEVATION_RAD, Lookalikes, lookalikes
from semantic_slam.latent.model import DescriptorModel
from semantic_slam.messages.picture_files import decode_picture
from semantic_slam.perception.collaborators import FeatureExtractor, crop_features
from semantic_slam.perception.crops import box_fault


@dataclass(frozen=True)
class LookalikeQuery:
    """Look-alike query; ``settings`` are those of the beliefs' run. The network is loaded with the first query."""

    settings: SemanticModelConfiguration

    def ask(
        self, belief: HybridBelief, image: Bytes, box: Array | None = None, elevation_rad: float = ELEVATION_RAD
    ) -> Lookalikes:
        """Objects of the map that look like an RGB image, or like the crop of the (4,) box in it. Raises InputError."""
        if belief.descriptors.shape[1] != self._model.num_dimensions:
            raise InputError(
                f"the belief has descriptors of {belief.descriptors.shape[1]} components, the latent space has"
                f" {self._model.num_dimensions}; run with semantic_model.kind: latent and the same semantic_model.path"
            )
        height, width = image.shape[:2]
        box = np.array([0.0, 0.0, width, height]) if box is None else box
        fault = box_fault(box, width, height)
        if fault:
            raise InputError(f"{fault} ({', '.join(f'{value:g}' for value in box)} in {width} x {height}); correct it")
        feature = crop_features(self._extractor, image, box[None])[0]
        return lookalikes(
            self._model, feature, belief.descriptors, belief.descriptor_covariances, belief.existence, elevation_rad
        )

    @cached_property
    def _model(self) -> DescriptorModel:
        model = load_latent_model(self.settings)
        if model is None:
            raise InputError(
                f"semantic_model.kind is {self.settings.kind}: beliefs have no descriptors; run with kind: latent"
            )
        return model

    @cached_property
    def _extractor(self) -> FeatureExtractor:
        extractor = load_extractor(self.settings)
        assert extractor is not None  # there is one whenever there is a model, which is loaded first
        return extractor


def picture(data: bytes, origin: str) -> Bytes:
    """(height, width, 3) RGB pixels of an encoded image; raises InputError that names ``origin``."""
    pixels = decode_picture(data, cv2.IMREAD_COLOR, origin)
    if pixels is None:
        raise InputError(f"{origin}: not a picture; give a png or jpeg")
    return np.asarray(cv2.cvtColor(pixels, cv2.COLOR_BGR2RGB), dtype=np.uint8)
