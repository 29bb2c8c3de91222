"""Plug-in registries: names a configuration may use, from this package or from entry points of other packages.

An entry is written ``module:attribute`` and imported on demand. Another package adds one in its metadata,
for example ``[project.entry-points."semantic_slam.associations"]`` with ``nearest = "my_package.nearest:Nearest"``.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from typing import Any

from semantic_slam.errors import InputError


@dataclass(frozen=True)
class Registry:
    """Names of one kind of plug-in, and where each implementation is found."""

    what: str  # name of the kind, in error messages
    group: str  # entry-point group for other packages
    own: tuple[tuple[str, str], ...]  # name, module:attribute

    @property
    def own_names(self) -> tuple[str, ...]:
        """The names that this package defines."""
        return tuple(dict(self.own))

    def names(self) -> tuple[str, ...]:
        """All available names, those of this package first."""
        return (*self.own_names, *(name for name in _foreign(self.group) if name not in self.own_names))

    def load(self, name: str) -> Any:
        """Import the plug-in of that name. Raises InputError when there is none, or when the import fails."""
        own = dict(self.own)
        found = EntryPoint(name, own[name], self.group) if name in own else _foreign(self.group).get(name)
        if found is None:
            raise InputError(f"{self.what} '{name}' is not known; choose one of {', '.join(self.names())}")
        if name in own:
            return found.load()
        try:
            return found.load()
        except Exception as fault:  # importing another package may raise anything
            raise InputError(
                f"{self.what} '{name}': {found.value} does not load ({fault!r}); mend the package that announces it"
            ) from fault


@cache
def _foreign(group: str) -> Mapping[str, EntryPoint]:
    return {point.name: point for point in entry_points(group=group)}


def _table(**own: str) -> tuple[tuple[str, str], ...]:
    return tuple(own.items())


ASSOCIATIONS = Registry(
    "association",
    "semantic_slam.associations",
    _table(
        enumerated="semantic_slam.inference.association.enumerated:EnumeratedAssociation",
        given="semantic_slam.inference.open_world.named.association:NamedAssociation",
        open="semantic_slam.inference.open_world.keyframe.open_association:OpenAssociation",
    ),
)
"""Values of ``association``: classes as inference/association/strategy.py describes them."""

CLASS_MODELS = Registry(
    "class model",
    "semantic_slam.class_models",
    _table(
        none="semantic_slam.class_models.kind:NONE",
        parametric="semantic_slam.class_models.viewpoint_models:PARAMETRIC",
        gp_independent="semantic_slam.class_models.viewpoint_models:GP_INDEPENDENT",
        gp_correlated="semantic_slam.class_models.viewpoint_models:GP_CORRELATED",
        latent="semantic_slam.class_models.latent_space:LATENT",
        detector="semantic_slam.class_models.detector:DETECTOR",
        embedding="semantic_slam.class_models.embedding:EMBEDDING",
        detector_embedding="semantic_slam.class_models.detector_embedding:DETECTOR_EMBEDDING",
    ),
)
"""Values of ``semantic_model.kind``: a ClassModelKind of semantic_slam/class_models/kind.py each."""

OBSERVATIONS = Registry(
    "observation",
    "semantic_slam.observations",
    _table(
        range_bearing="semantic_slam.inference.world.planar_sensing:range_bearing",
        points="semantic_slam.inference.world.planar_sensing:points",
    ),
)
"""Values of ``observation``: builders as inference/world/sensing.py describes them."""

SPATIAL_OBSERVATIONS = Registry(
    "with state_space: spatial observation",
    "semantic_slam.spatial_observations",
    _table(
        range_bearing="semantic_slam.inference.world.body_sensing:range_bearing",
        points="semantic_slam.inference.world.spatial_sensing:points",
    ),
)
"""Values of ``observation`` with ``state_space: spatial``: builders as inference/world/sensing.py describes them."""

SEMANTICS = Registry(
    "semantics",
    "semantic_slam.semantics",
    _table(
        none="semantic_slam.inference.semantics.interface:NoSemantics",
        independent_views="semantic_slam.inference.semantics.independent_views:IndependentViews",
        correlated_views="semantic_slam.inference.semantics.correlated_views:CorrelatedViews",
        class_tables="semantic_slam.inference.semantics.class_tables:ClassTables",
        descriptor_views="semantic_slam.inference.semantics.descriptors.descriptor_views:DescriptorViews",
        descriptor_tables="semantic_slam.inference.semantics.descriptors.descriptor_tables:DescriptorTables",
        detector_labels="semantic_slam.inference.semantics.detector.detector_labels:DetectorLabels",
        embedding_views="semantic_slam.inference.semantics.embeddings.embedding_views:EmbeddingViews",
        labels_and_vectors="semantic_slam.inference.semantics.labels_and_vectors:LabelsAndVectors",
    ),
)
"""How views weigh and are recorded: classes as inference/semantics/interface.py describes them."""
